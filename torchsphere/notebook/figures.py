"""The figures of the report, of a track, a motion, an impact or a result folder, as matplotlib figures."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.motion.track import Track
from torchsphere.notebook.drawings import as_png
from torchsphere.notebook.measured import measurement, result_folder, track_of, with_force
from torchsphere.report.draw import IMAGE_FIGURES, NUMBER_FIGURES
from torchsphere.results.reader import ResultFolder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Figures of a track or a motion, whose images are not there, and without an impact.
OF_NUMBERS = ("motion", "rotation", "quality")


def plot(subject: Track | Kinematics | Impact, kind: str) -> Figure:
    """A figure of the report; ValueError if there is no such figure of this result."""
    if isinstance(subject, Impact):
        return drawn(result_folder(with_force(subject)), kind)
    if kind not in OF_NUMBERS:
        raise ValueError(f"plot({kind!r}): expected one of {', '.join(OF_NUMBERS)}")
    if isinstance(subject, Track):
        return drawn(result_folder(measurement(subject)), kind)
    # The impacts take a second, and these figures do not show them.
    return drawn(result_folder(replace(measurement(track_of(subject)), motion=subject)), kind)


def drawn(result: ResultFolder, kind: str) -> Figure:
    """A figure of a result folder, which a notebook shows by itself; ValueError if the result does not have it."""
    known = NUMBER_FIGURES | IMAGE_FIGURES
    if kind not in known:
        raise ValueError(f"plot({kind!r}): expected one of {', '.join(known)}")
    if kind == "force_path" and result.force_path is None:
        raise ValueError(f"{result.path}: no impact of this result has a force, so there is no figure of it")
    figure = known[kind](result)
    # A figure that pyplot did not make is shown by a notebook only with this method.
    figure.__dict__["_repr_png_"] = partial(as_png, figure)
    return figure
