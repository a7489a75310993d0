"""Panels above each other over one axis of time: curves with bands, and below each a strip with the deviations.

A good measurement's band is thinner than its curve, so that only the strip tells how well it was made.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.report.explanations import why_empty
from torchsphere.report.figure_style import COLOURS, DPI, STYLES, new_figure
from torchsphere.report.time_series import Abscissa, Panel, abscissa
from torchsphere.results.reader import TRANSLATION_KNOWN, ResultFolder

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Width of a figure, a page's text width, its margins left and right, and those above and below its axes, inches.
WIDTH, LEFT, RIGHT, TOP, BOTTOM = 7.0, 0.82, 0.14, 0.58, 0.5

#: Heights of a panel, of one that is empty, of a strip, and of the gaps before a strip and before a panel, inches.
PANEL, EMPTY, STRIP, SEAM, GAP = 1.4, 0.5, 0.4, 0.06, 0.32

#: Colour of the contact, and of frames that were not measured.
CONTACT, MISSING = "#F0E442", "0.87"

#: Lines at the ticks of another axis, as matplotlib draws a grid.
GRID: dict[str, Any] = {"color": "#b0b0b0", "alpha": 0.3, "lw": 0.8, "zorder": 0.5}

#: Where a label stands left of its axis, in the axis's widths: as far from all, which is faster than to align them.
LABEL_AT = -0.102


def stacked(result: ResultFolder, shown: Sequence[Panel], title: str) -> Figure:
    """The panels in their order, then, in ``Figure.axes``, the strips of those that state a standard deviation."""
    where = abscissa(result)
    known = [bool(np.isfinite(panel.values).any()) for panel in shown]
    striped = [k and p.sd is not None and bool(np.isfinite(p.sd).any()) for k, p in zip(known, shown, strict=True)]
    figure, axes, strips = _laid_out(known, striped)
    for axis, panel, filled in zip(axes, shown, known, strict=True):
        if filled:
            _curves(axis, where, panel)
            _shade(axis, result, where)
            named(axis, panel.label)
        else:
            emptied(axis, why_empty(result, panel.key), panel.label)
    for axis, panel in zip(strips, (p for p, s in zip(shown, striped, strict=True) if s), strict=True):
        _deviations(axis, where, panel)
        _shade(axis, result, where)
    if any(known):
        time_axis([*axes, *strips], where)
        components = max(len(panel.names) for panel, filled in zip(shown, known, strict=True) if filled)
        _legend(axes[known.index(True)], result, components)
    titled(figure, title + ("; bands: 2 sd; strips: sd, in the same unit" if strips else ""))
    return figure


def _laid_out(known: Sequence[bool], striped: Sequence[bool]) -> tuple[Figure, list[Axes], list[Axes]]:
    heights = [PANEL if k else EMPTY for k in known]
    height = TOP + sum(heights) + sum(striped) * (SEAM + STRIP) + GAP * (len(known) - 1) + BOTTOM
    figure = new_figure(figsize=(WIDTH, height), dpi=DPI, layout=None)
    axes: list[Axes] = []
    places: list[float] = []
    top = height - TOP
    for one, strip in zip(heights, striped, strict=True):
        axes.append(added(figure, top - one, one))
        top -= one
        if strip:
            top -= SEAM + STRIP
            places.append(top)
        top -= GAP
    return figure, axes, [added(figure, place, STRIP) for place in places]


def added(figure: Figure, bottom: float, height: float, left: float = LEFT) -> Axes:
    """Axes of that height and that far above the figure's lower edge, inches."""
    width, whole = figure.get_size_inches()
    axis = figure.add_axes((left / width, bottom / whole, (width - left - RIGHT) / width, height / whole))
    axis.grid(alpha=0.3)
    axis.tick_params(labelsize=9)
    return axis


def titled(figure: Figure, title: str) -> None:
    """A title above the first panel's legend."""
    width, height = figure.get_size_inches()
    figure.text(LEFT / width, 1 - 0.12 / height, title, fontsize=10, va="top")


def named(axis: Axes, label: str) -> None:
    """A label at the place that all of them have."""
    axis.set_ylabel(label, fontsize=9)
    axis.yaxis.set_label_coords(LABEL_AT, 0.5)


def emptied(axis: Axes, why: str, label: str) -> None:
    """A sentence in place of what an axis lacks, no ticks, and the label above it."""
    axis.grid(False)
    axis.set_yticks([])
    axis.xaxis.set_visible(False)
    axis.set_facecolor("0.96")
    axis.text(0.5, 0.5, why, transform=axis.transAxes, ha="center", va="center", fontsize=8, color="0.25")
    axis.set_title(label, fontsize=9, loc="left", y=1.0, pad=3)


def time_axis(axes: Sequence[Axes], where: Abscissa) -> None:
    """The abscissa's limits for all, whatever was measured; ticks and its label below the lowest.

    The others have lines at the lowest's ticks and no ticks of their own, the dearest part of drawing with matplotlib.
    """
    first, last = float(where.values[0]), float(where.values[-1])
    spare = 0.02 * (last - first) or 0.5
    limits = first - spare, last + spare
    lowest = min(axes, key=lambda axis: axis.get_position().y0)
    ticks = lowest.xaxis.get_major_locator().tick_values(*limits)
    for axis in axes:
        axis.set_xlim(*limits)
        if axis is not lowest:
            axis.xaxis.set_visible(False)
        if axis is not lowest and axis.lines:
            axis.vlines(ticks, 0, 1, transform=axis.get_xaxis_transform(), **GRID)
    lowest.xaxis.set_visible(True)
    lowest.set_xlabel(where.label, fontsize=9)
    figure = lowest.get_figure(root=True)
    assert figure is not None
    lowest.xaxis.set_label_coords(0.5, -0.28 / (lowest.get_position().height * figure.get_size_inches()[1]))


def _curves(axis: Axes, where: Abscissa, panel: Panel) -> None:
    for k, value in enumerate(panel.values.T):
        axis.plot(where.values, value, STYLES[k], color=COLOURS[k], lw=1.2)
        if panel.sd is not None:
            sd = 2 * panel.sd[:, k]
            axis.fill_between(where.values, value - sd, value + sd, color=COLOURS[k], alpha=0.25, lw=0)


def _deviations(axis: Axes, where: Abscissa, panel: Panel) -> None:
    assert panel.sd is not None
    for k in range(len(panel.names)):
        axis.plot(where.values, panel.sd[:, k], STYLES[k], color=COLOURS[k], lw=1.0)
    axis.set_ylim(0, 1.15 * float(np.nanmax(panel.sd)) or 1.0)
    axis.locator_params(axis="y", nbins=2)
    axis.tick_params(axis="y", labelsize=8)
    named(axis, "sd")


def _legend(axis: Axes, result: ResultFolder, components: int) -> None:
    """Axes of the ball's motion by line, and what is shaded: once for all panels, above the first, never over data."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    lines = zip("xyz"[:components], STYLES, COLOURS, strict=False)
    handles: list[Any] = [Line2D([], [], ls=style, color=colour, lw=1.2, label=n) for n, style, colour in lines]
    if result.contact_s is not None and abscissa(result).per_second is not None:
        handles.append(Patch(color=CONTACT, alpha=0.35, lw=0, label="contact"))
    if failed(result).any():
        handles.append(Patch(color=MISSING, lw=0, label="not measured"))
    place: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.1}
    axis.legend(handles=handles, fontsize=8, ncols=5, frameon=False, **place)


def failed(result: ResultFolder) -> NDArray[np.bool_]:
    """Frames (n,) in which the motion was not measured."""
    return np.asarray(~np.isin(result.status, TRANSLATION_KNOWN))


def _shade(axis: Axes, result: ResultFolder, where: Abscissa) -> None:
    """The contact, and the runs of frames in which the motion was not measured."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], failed(result), [False])).astype(int)))
    half = 0.5 * float(np.median(np.diff(where.values))) if len(where.values) > 1 else 0.5
    for start, stop in edges.reshape(-1, 2):
        axis.axvspan(where.values[start] - half, where.values[stop - 1] + half, color=MISSING, lw=0)
    if result.contact_s is not None and where.per_second is not None:
        axis.axvspan(*(where.per_second * t for t in result.contact_s), color=CONTACT, alpha=0.35, lw=0)
