"""Stacked panels over one time axis: curves with bands, and below each panel a strip with its standard deviations.

The band of a good measurement is thinner than its curve. The strip shows it on a scale of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.report.explanations import why_empty
from torchsphere.report.figure_style import COLOURS, DPI, STYLES, new_figure
from torchsphere.report.time_series import Abscissa, TimeSeries, abscissa, axis_label
from torchsphere.results.reader import TRANSLATION_KNOWN, ResultFolder

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Width of a figure (the text width of a page) and its margins, inches.
WIDTH, LEFT, RIGHT, TOP, BOTTOM = 7.0, 0.82, 0.14, 0.58, 0.5

#: Heights of a panel, an empty panel and a strip, and of the gaps above a strip and above a panel, inches.
PANEL, EMPTY, STRIP, STRIP_GAP, PANEL_GAP = 1.4, 0.5, 0.4, 0.06, 0.32

#: Colours of the contact and of frames that were not measured.
CONTACT, MISSING = "#F0E442", "0.87"

#: Vertical lines that look like matplotlib's grid.
GRID: dict[str, Any] = {"color": "#b0b0b0", "alpha": 0.3, "lw": 0.8, "zorder": 0.5}

#: Position of a label left of its axis, in widths of the axis. A fixed position is faster than alignment.
LABEL_X = -0.102


def stacked_figure(result: ResultFolder, series: Sequence[TimeSeries], title: str) -> Figure:
    """A panel for each series, and a strip for each that states a standard deviation.

    ``Figure.axes`` has the panels first, then the strips.
    """
    where = abscissa(result)
    figure, panels, strips = _layout(series)
    for axis, quantity in zip(panels, series, strict=True):
        if quantity.is_empty:
            write_reason(axis, why_empty(result, quantity.key), axis_label(quantity))
        else:
            _curves(axis, where, quantity)
            _shade(axis, result, where)
            set_label(axis, axis_label(quantity))
    for axis, quantity in zip(strips, (quantity for quantity in series if quantity.has_sd), strict=True):
        _deviations(axis, where, quantity)
        _shade(axis, result, where)
    filled = [(axis, quantity) for axis, quantity in zip(panels, series, strict=True) if not quantity.is_empty]
    if filled:
        set_time_axis([*panels, *strips], where)
        _legend(filled[0][0], result, max(len(quantity.components) for _, quantity in filled))
    set_title(figure, title + ("; bands: 2 sd; strips: sd, in the same unit" if strips else ""))
    return figure


def _layout(series: Sequence[TimeSeries]) -> tuple[Figure, list[Axes], list[Axes]]:
    """The figure with its panels and strips, from top to bottom."""
    heights = [EMPTY if quantity.is_empty else PANEL for quantity in series]
    strips = sum(quantity.has_sd for quantity in series)
    height = TOP + sum(heights) + strips * (STRIP_GAP + STRIP) + PANEL_GAP * (len(series) - 1) + BOTTOM
    figure = new_figure(figsize=(WIDTH, height), dpi=DPI, layout=None)
    panels: list[Axes] = []
    strip_bottoms: list[float] = []
    top = height - TOP
    for quantity, panel_height in zip(series, heights, strict=True):
        panels.append(add_panel(figure, top - panel_height, panel_height))
        top -= panel_height
        if quantity.has_sd:
            top -= STRIP_GAP + STRIP
            strip_bottoms.append(top)
        top -= PANEL_GAP
    return figure, panels, [add_panel(figure, bottom, STRIP) for bottom in strip_bottoms]


def add_panel(figure: Figure, bottom: float, height: float, left: float = LEFT) -> Axes:
    """Axes of this height, ``bottom`` above the lower edge of the figure, inches."""
    width, whole = figure.get_size_inches()
    axis = figure.add_axes((left / width, bottom / whole, (width - left - RIGHT) / width, height / whole))
    axis.grid(alpha=0.3)
    axis.tick_params(labelsize=9)
    return axis


def set_title(figure: Figure, title: str) -> None:
    """Write the title above the legend of the first panel."""
    width, height = figure.get_size_inches()
    figure.text(LEFT / width, 1 - 0.12 / height, title, fontsize=10, va="top")


def set_label(axis: Axes, label: str, x: float = LABEL_X) -> None:
    """Write the label left of its axis, at the position that all labels share."""
    axis.set_ylabel(label, fontsize=9)
    axis.yaxis.set_label_coords(x, 0.5)


def write_reason(axis: Axes, why: str, label: str) -> None:
    """Write in an empty panel why it is empty, without ticks and with its label above."""
    axis.grid(False)
    axis.set_yticks([])
    axis.xaxis.set_visible(False)
    axis.set_facecolor("0.96")
    axis.text(0.5, 0.5, why, transform=axis.transAxes, ha="center", va="center", fontsize=8, color="0.25")
    axis.set_title(label, fontsize=9, loc="left", y=1.0, pad=3)


def set_time_axis(axes: Sequence[Axes], where: Abscissa) -> None:
    """Give all axes the limits of the abscissa, and the lowest its ticks and its label.

    The others have vertical lines at these ticks, and no ticks: drawing ticks is the slowest part of matplotlib.
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
    lowest.set_xlabel(axis_label(where), fontsize=9)
    figure = lowest.get_figure(root=True)
    assert figure is not None
    lowest.xaxis.set_label_coords(0.5, -0.28 / (lowest.get_position().height * figure.get_size_inches()[1]))


def _curves(axis: Axes, where: Abscissa, series: TimeSeries) -> None:
    for k, value in enumerate(series.values.T):
        axis.plot(where.values, value, STYLES[k], color=COLOURS[k], lw=1.2)
        if series.sd is not None:
            sd = 2 * series.sd[:, k]
            axis.fill_between(where.values, value - sd, value + sd, color=COLOURS[k], alpha=0.25, lw=0)


def _deviations(axis: Axes, where: Abscissa, series: TimeSeries) -> None:
    assert series.sd is not None
    for k, sd in enumerate(series.sd.T):
        axis.plot(where.values, sd, STYLES[k], color=COLOURS[k], lw=1.0)
    axis.set_ylim(0, 1.15 * float(np.nanmax(series.sd)) or 1.0)
    axis.locator_params(axis="y", nbins=2)
    axis.tick_params(axis="y", labelsize=8)
    set_label(axis, "sd")


def _legend(axis: Axes, result: ResultFolder, components: int) -> None:
    """One legend for all panels, above the first: the components by line, and the meaning of the shades."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    lines = zip("xyz"[:components], STYLES, COLOURS, strict=False)
    handles: list[Any] = [Line2D([], [], ls=style, color=colour, lw=1.2, label=n) for n, style, colour in lines]
    if result.contact_s is not None and abscissa(result).per_second is not None:
        handles.append(Patch(color=CONTACT, alpha=0.35, lw=0, label="contact"))
    if _not_measured(result).any():
        handles.append(Patch(color=MISSING, lw=0, label="not measured"))
    place: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0), "borderaxespad": 0.1}
    axis.legend(handles=handles, fontsize=8, ncols=5, frameon=False, **place)


def _not_measured(result: ResultFolder) -> NDArray[np.bool_]:
    """Frames (n,) whose translation was not measured."""
    return np.asarray(~np.isin(result.status, TRANSLATION_KNOWN))


def _shade(axis: Axes, result: ResultFolder, where: Abscissa) -> None:
    """Shade the contact, and each run of frames that were not measured."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], _not_measured(result), [False])).astype(int)))
    half = 0.5 * float(np.median(np.diff(where.values))) if len(where.values) > 1 else 0.5
    for start, stop in edges.reshape(-1, 2):
        axis.axvspan(where.values[start] - half, where.values[stop - 1] + half, color=MISSING, lw=0)
    if result.contact_s is not None and where.per_second is not None:
        axis.axvspan(*(where.per_second * t for t in result.contact_s), color=CONTACT, alpha=0.35, lw=0)
