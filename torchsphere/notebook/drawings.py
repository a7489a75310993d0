"""Small drawings for a notebook, in a grey and in colours that suit a light and a dark one."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from torchsphere.report.figure_style import CONTACT, STATUS_COLOURS, new_figure
from torchsphere.runtime.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Blue, vermilion and green as in the figures of the report, in tones for a white and for a black ground.
COLOURS = ("#1f8fd6", "#e0692a", "#12a67c")

#: Grey of words and axes, width of a drawing, and heights of a chart, a path and a strip, inches.
GREY, WIDTH, CHART, PATH, STRIP = "0.5", 3.6, 1.4, 1.9, 0.12

#: Pixels per inch of the file, and of the page that shows it.
DPI, SHOWN_DPI = 120, 90


@dataclass(frozen=True)
class Curve:
    """Values (n,) and their standard deviations, with a name."""

    name: str
    values: Array
    sd: Array


def picture(data: bytes, label: str, width: int | None = None) -> str:
    """A PNG file as an image in HTML; ``width`` in px of the page."""
    size = "" if width is None else f' width="{width}"'
    return f'<img alt="{label}"{size} src="data:image/png;base64,{base64.b64encode(data).decode()}">'


def chart(
    title: str, x: Array, curves: Sequence[Curve], x_label: str, shaded: tuple[float, float] | None = None
) -> str:
    """Curves with bands of two standard deviations over ``x``, and a span of it ``shaded``."""
    known = [curve for curve in curves if np.isfinite(curve.values).any()]
    if not known or len(x) < 2:
        return ""
    figure, axis = _empty(CHART)
    if shaded is not None:
        axis.axvspan(*shaded, color=CONTACT, alpha=0.3, lw=0)
    for curve, colour in zip(known, COLOURS, strict=False):
        axis.plot(x, curve.values, color=colour, lw=1.2, label=curve.name)
        band = curve.values - 2 * curve.sd, curve.values + 2 * curve.sd
        axis.fill_between(x, *band, color=colour, alpha=0.25, lw=0)
    axis.set(xlim=(x[0], x[-1]), ylim=_limits(known))
    axis.set_xlabel(x_label, fontsize=7, color=GREY)
    axis.set_title(title, fontsize=8, loc="left", color=GREY)
    axis.legend(fontsize=7, frameon=False, labelcolor="linecolor", handlelength=0, ncols=3, loc="lower right").set(
        bbox_to_anchor=(1, 1)
    )
    return _shown(figure, title)


def _limits(curves: Sequence[Curve]) -> tuple[float, float]:
    """Limits of the values with their bands; the bands add at most the span of the values on each side."""
    low, high = (float(f([f(curve.values) for curve in curves])) for f in (np.nanmin, np.nanmax))
    span = (high - low) or abs(high) or 1.0
    widest = max(2 * float(np.nanmax(np.nan_to_num(curve.sd), initial=0.0)) for curve in curves)
    spare = min(widest, span) + 0.06 * span
    return low - spare, high + spare


def path(position: Array, radius: float, title: str) -> str:
    """The path of a ball's centre (n, 2), px, with its outline at the start and at the end."""
    from matplotlib.patches import Circle

    known = position[np.isfinite(position[:, 0])]
    if not len(known):
        return ""
    figure, axis = _empty(PATH)
    axis.plot(*known.T, color=COLOURS[0], lw=1.5)
    ends = ((known[0], "start", COLOURS[2]), (known[-1], "end", COLOURS[1]))
    for centre, name, colour in ends if len(known) > 1 else ((known[0], "", COLOURS[1]),):
        axis.add_patch(Circle(centre, radius, ec=colour, fc=(colour, 0.15)))
        axis.annotate(name, centre, ha="center", va="top", fontsize=7, color=colour)
    low, high = known.min(0) - 1.15 * radius, known.max(0) + 1.15 * radius
    axis.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]), aspect="equal")
    axis.axis("off")
    return _shown(figure, title)


def strip(status: NDArray[np.str_]) -> str:
    """A strip with the status of every frame."""
    from matplotlib.colors import to_rgb

    figure, axis = _empty(STRIP)
    axis.imshow([[to_rgb(STATUS_COLOURS[name]) for name in status]], aspect="auto", interpolation="nearest")
    axis.axis("off")
    return _shown(figure, "status of every frame")


def _empty(height: float) -> tuple[Figure, Axes]:
    """A figure of this height, inches, without a ground, and its axes in grey."""
    figure = new_figure(figsize=(WIDTH, height), dpi=DPI, facecolor="none")
    axis = figure.add_subplot(facecolor="none")
    axis.tick_params(labelsize=7, color=GREY, labelcolor=GREY)
    axis.spines[:].set_color(GREY)
    return figure, axis


def _shown(figure: Figure, label: str) -> str:
    return picture(as_png(figure), label, round(WIDTH * SHOWN_DPI))


def as_png(figure: Figure) -> bytes:
    """A figure as a PNG file."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()
