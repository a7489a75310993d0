"""Figures of a result against time: motion, rotation, quality of the measurement."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from torchsphere.report.explanations import not_in_si, why_empty
from torchsphere.report.figure_style import COLOURS, DPI, new_figure
from torchsphere.report.stacked_panels import (
    BOTTOM,
    GAP,
    PANEL,
    TOP,
    WIDTH,
    added,
    emptied,
    named,
    stacked,
    time_axis,
    titled,
)
from torchsphere.report.time_series import abscissa, panels
from torchsphere.results.reader import ResultFolder

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Height for each status in the figure of the quality, and its left margin, which the longest name fills, inches.
ROW, NAMES = 0.3, 1.45

#: Colour of Okabe and Ito for each status, and the height of its mark in a figure without colour.
STATUS_COLOURS = {
    "ok": "#009E73",
    "weak_texture": "#56B4E9",
    "low_correlation": "#E69F00",
    "not_converged": "#CC79A7",
    "out_of_frame": "#999999",
    "lost": "#D55E00",
}


def motion_figure(result: ResultFolder) -> Figure:
    """Position, velocity, force or acceleration, and spin, each with its standard deviation below it."""
    shown = [panel for panel in panels(result) if panel.key not in ("turned", "zncc")]
    figure = stacked(result, shown, f"Motion of the ball, {_frame(result)}")
    lacking = not_in_si(result)
    about = result.summary.get("differentiation")
    if about and np.isfinite(shown[1].values).any():
        _remark(figure.axes[1], _differentiation(about, shown[2].title))
    below = figure.axes[1 if result.motion is None else 2]
    # An empty panel has its label in that place, and is empty for another reason.
    if lacking and below.lines:
        _remark(below, lacking)
    return figure


def rotation_figure(result: ResultFolder) -> Figure:
    """Angles turned since the first frame, and spin: the paper's figure 9."""
    shown = [panel for panel in panels(result) if panel.key in ("turned", "spin")]
    figure = stacked(result, shown[::-1], f"Rotation of the ball, {_frame(result)}")
    if figure.axes[0].lines:
        _remark(figure.axes[0], "sums of the steps from one frame to the next")
    return figure


def quality_figure(result: ResultFolder) -> Figure:
    """Correlation coefficient and status of every frame."""
    where = abscissa(result)
    there = [name for name in STATUS_COLOURS if (result.status == name).any()]
    below = ROW * len(there) + 0.1
    height = TOP + PANEL + GAP + below + BOTTOM
    figure = new_figure(figsize=(WIDTH, height), dpi=DPI, layout=None)
    above = added(figure, BOTTOM + below + GAP, PANEL, left=NAMES)
    marks = added(figure, BOTTOM, below, left=NAMES)
    _correlation(above, result)
    for level, name in enumerate(there):
        at = where.values[result.status == name]
        marks.plot(at, np.full(len(at), level), "|", color=STATUS_COLOURS[name], ms=12, mew=1.5)
    marks.set_yticks(range(len(there)), [f"{n.replace('_', ' ')}: {(result.status == n).sum()}" for n in there])
    marks.set_ylim(len(there) - 0.4, -0.6)
    marks.set_title("Status of each frame", fontsize=9, loc="left", y=1.0)
    time_axis([above, marks], where)
    titled(figure, "How well each image matches the one before it")
    return figure


def _correlation(axis: Axes, result: ResultFolder) -> None:
    panel = next(panel for panel in panels(result) if panel.key == "zncc")
    if not np.isfinite(panel.values).any():
        emptied(axis, why_empty(result, panel.key), "correlation (ZNCC)")
        return
    axis.plot(abscissa(result).values, panel.values[:, 0], ".-", color=COLOURS[0], lw=1, ms=3, label="ZNCC")
    least = result.summary["settings"].get("min_zncc")
    # Where all match well the limit is far below, and would flatten what there is to see.
    if least is not None and np.nanmin(panel.values) < least + 0.15:
        axis.axhline(least, color="0.4", ls=":", lw=1, label=f"least that is believed, {least:g}")
        axis.legend(loc="lower right", bbox_to_anchor=(1, 1), fontsize=8, ncols=2, frameon=False, borderaxespad=0.1)
    axis.ticklabel_format(axis="y", useOffset=False)
    named(axis, "correlation (ZNCC)")
    axis.yaxis.set_label_coords(-0.145, 0.5)


def _frame(result: ResultFolder) -> str:
    return "lab frame (y up)" if result.lab_frame and result.motion is not None else "camera frame (y down)"


def _remark(axis: Axes, text: str) -> None:
    # With its place given, matplotlib does not measure all labels to find one.
    axis.set_title(text, fontsize=8, loc="left", color="0.35", y=1.0, pad=4)


def _differentiation(about: dict[str, Any], second: str) -> str:
    """How velocity and the ``second`` derivative were made, and up to which frequency they pass what happened."""
    names = {
        "bandwidth_contact_translation_Hz": " in contact",
        "bandwidth_flight_translation_Hz": " in flight",
        "bandwidth_Hz": "",
    }
    name = next((name for name in names if name in about), None)
    band = None if name is None else about[name]
    if name is None or band is None or band.get("rate") is None or band.get("acceleration") is None:
        return str(about["method"])
    rate, acceleration = (1e-3 * band[key] for key in ("rate", "acceleration"))
    return f"{about['method']}; bandwidth{names[name]} {rate:.2g} kHz (velocity), {acceleration:.2g} kHz ({second})"
