"""Figures over time: motion, rotation, and the quality of the measurement.

A figure is a stack of panels over one time axis: curves with bands, and below each panel a strip with its standard
deviations. The band of a good measurement is thinner than its curve; the strip shows it on a scale of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.correlation.frame_status import TRANSLATION_KNOWN
from torchsphere.report.explanations import missing_for_si, why_empty
from torchsphere.report.figure_style import COLOURS, CONTACT, DPI, LEGEND, MISSING, STATUS_COLOURS, STYLES, new_figure
from torchsphere.report.time_series import Abscissa, TimeSeries, abscissa, axis_label, time_series
from torchsphere.results.reader import ResultFolder

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Width of a figure (the text width of a page) and its margins, inches.
WIDTH, LEFT, RIGHT, TOP, BOTTOM = 7.0, 0.82, 0.14, 0.58, 0.5

#: Heights of a panel, an empty panel and a strip, and of the gaps above a strip and above a panel, inches.
PANEL, EMPTY, STRIP, STRIP_GAP, PANEL_GAP = 1.4, 0.5, 0.4, 0.06, 0.32

#: Vertical lines that look like matplotlib's grid.
GRID: dict[str, Any] = {"color": "#b0b0b0", "alpha": 0.3, "lw": 0.8, "zorder": 0.5}

#: Position of a label left of its axis, axis widths. A fixed position is faster than alignment.
LABEL_X = -0.102

#: Raw differences: small grey points below the curves, over bands and shades.
RAW: dict[str, Any] = {"color": "0.5", "ms": 4.0, "mew": 0, "zorder": 1.1}

#: Height of a row of status marks, and left margin of the quality figure for the longest name of a status, inches;
#: position of the label of the correlation, axis widths.
STATUS_ROW, STATUS_LEFT, CORRELATION_LABEL_X = 0.3, 1.45, -0.145


def motion_figure(result: ResultFolder) -> Figure:
    """Position, velocity, force or acceleration, and spin, each with its standard deviation below."""
    series = [quantity for quantity in time_series(result) if quantity.key not in ("turned", "zncc")]
    figure = _stacked_figure(result, series, f"Motion of the ball, {_frame(result)}")
    about = result.summary.get("differentiation")
    if about and not series[1].is_empty:
        _remark(figure.axes[1], _differentiation(about, series[2].title))
    remark = missing_for_si(result)
    axis = figure.axes[1 if result.motion is None else 2]
    # An empty panel has its label in the place of the remark.
    if remark and axis.lines:
        _remark(axis, remark)
    return figure


def rotation_figure(result: ResultFolder) -> Figure:
    """Angles turned since the first frame, and spin: figure 9 of the paper."""
    series = [quantity for quantity in time_series(result) if quantity.key in ("turned", "spin")]
    figure = _stacked_figure(result, series[::-1], f"Rotation of the ball, {_frame(result)}")
    if figure.axes[0].lines:
        _remark(figure.axes[0], "sums of the steps from one frame to the next")
    return figure


def quality_figure(result: ResultFolder) -> Figure:
    """Correlation coefficient and status of every frame."""
    time = abscissa(result)
    names = [name for name in STATUS_COLOURS if (result.status == name).any()]
    marks_height = STATUS_ROW * len(names) + 0.1
    height = TOP + PANEL + PANEL_GAP + marks_height + BOTTOM
    figure = new_figure(figsize=(WIDTH, height), dpi=DPI, layout=None)
    above = _add_panel(figure, BOTTOM + marks_height + PANEL_GAP, PANEL, STATUS_LEFT)
    marks = _add_panel(figure, BOTTOM, marks_height, STATUS_LEFT)
    _correlation(above, result)
    for level, name in enumerate(names):
        x = time.values[result.status == name]
        marks.plot(x, np.full(len(x), level), "|", color=STATUS_COLOURS[name], ms=12, mew=1.5)
    marks.set_yticks(range(len(names)), [f"{n.replace('_', ' ')}: {(result.status == n).sum()}" for n in names])
    marks.set_ylim(len(names) - 0.4, -0.6)
    marks.set_title("Status of each frame", fontsize=9, loc="left", y=1.0)
    _set_time_axis([above, marks], time)
    _set_title(figure, "How well each image matches the one before it")
    return figure


def _correlation(axis: Axes, result: ResultFolder) -> None:
    label, zncc = "correlation (ZNCC)", result.zncc
    if not np.isfinite(zncc).any():
        _write_reason(axis, why_empty(result, "zncc"), label)
        return
    axis.plot(abscissa(result).values, zncc, ".-", color=COLOURS[0], lw=1, ms=3, label="ZNCC")
    least = result.summary["settings"].get("min_zncc")
    # A limit far below all values would flatten the curve.
    if least is not None and np.nanmin(zncc) < least + 0.15:
        axis.axhline(least, color="0.4", ls=":", lw=1, label=f"least that is believed, {least:g}")
        axis.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, **LEGEND)
    axis.ticklabel_format(axis="y", useOffset=False)
    _set_label(axis, label, CORRELATION_LABEL_X)


def _frame(result: ResultFolder) -> str:
    return "lab frame (y up)" if result.lab_frame else "camera frame (y down)"


def _remark(axis: Axes, text: str) -> None:
    """Write a remark above a panel; with a fixed position matplotlib need not measure all labels."""
    axis.set_title(text, fontsize=8, loc="left", color="0.35", y=1.0, pad=4)


def _differentiation(about: dict[str, Any], second: str) -> str:
    """Method of differentiation and its bandwidth; ``second`` names the second derivative."""
    bandwidths = {
        "bandwidth_contact_translation_Hz": " in contact",
        "bandwidth_flight_translation_Hz": " in flight",
        "bandwidth_Hz": "",
    }
    name = next((name for name in bandwidths if name in about), "bandwidth_Hz")
    band = about.get(name) or {}
    if band.get("rate") is None or band.get("acceleration") is None:
        return str(about["method"])
    rate, acceleration = f"{1e-3 * band['rate']:.2g}", f"{1e-3 * band['acceleration']:.2g}"
    return f"{about['method']}; bandwidth{bandwidths[name]} {rate} kHz (velocity), {acceleration} kHz ({second})"


def _stacked_figure(result: ResultFolder, series: Sequence[TimeSeries], title: str) -> Figure:
    """A panel for each series, then a strip for each series that has a standard deviation."""
    time = abscissa(result)
    figure, panels, strips = _layout(series)
    for axis, quantity in zip(panels, series, strict=True):
        if quantity.is_empty:
            _write_reason(axis, why_empty(result, quantity.key), axis_label(quantity))
        else:
            _curves(axis, time, quantity)
            _raw_points(axis, time, quantity)
            _shade(axis, result, time)
            _set_label(axis, axis_label(quantity))
    for axis, quantity in zip(strips, (quantity for quantity in series if quantity.has_sd), strict=True):
        _deviations(axis, time, quantity)
        _shade(axis, result, time)
    filled = [(axis, quantity) for axis, quantity in zip(panels, series, strict=True) if not quantity.is_empty]
    if filled:
        _set_time_axis([*panels, *strips], time)
        has_raw = any(quantity.raw is not None for _, quantity in filled)
        _legend(filled[0][0], result, max(len(quantity.components) for _, quantity in filled), has_raw=has_raw)
    _set_title(figure, title + ("; bands: 2 sd; strips: sd, in the same unit" if strips else ""))
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
        panels.append(_add_panel(figure, top - panel_height, panel_height))
        top -= panel_height
        if quantity.has_sd:
            top -= STRIP_GAP + STRIP
            strip_bottoms.append(top)
        top -= PANEL_GAP
    return figure, panels, [_add_panel(figure, bottom, STRIP) for bottom in strip_bottoms]


def _add_panel(figure: Figure, bottom: float, height: float, left: float = LEFT) -> Axes:
    """Axes of this height, ``bottom`` above the lower edge of the figure, inches."""
    width, whole = figure.get_size_inches()
    axis = figure.add_axes((left / width, bottom / whole, (width - left - RIGHT) / width, height / whole))
    axis.grid(alpha=0.3)
    axis.tick_params(labelsize=9)
    return axis


def _set_title(figure: Figure, title: str) -> None:
    """Write the title above the legend of the first panel."""
    width, height = figure.get_size_inches()
    figure.text(LEFT / width, 1 - 0.12 / height, title, fontsize=10, va="top")


def _set_label(axis: Axes, label: str, x: float = LABEL_X) -> None:
    """Write the label left of its axis, at the position that all labels share."""
    axis.set_ylabel(label, fontsize=9)
    axis.yaxis.set_label_coords(x, 0.5)


def _write_reason(axis: Axes, why: str, label: str) -> None:
    """Write the reason into an empty panel, without ticks and with its label above."""
    axis.grid(False)
    axis.set_yticks([])
    axis.xaxis.set_visible(False)
    axis.set_facecolor("0.96")
    axis.text(0.5, 0.5, why, transform=axis.transAxes, ha="center", va="center", fontsize=8, color="0.25")
    axis.set_title(label, fontsize=9, loc="left", y=1.0, pad=3)


def _set_time_axis(axes: Sequence[Axes], time: Abscissa) -> None:
    """Give all axes the limits of the time, and the lowest axis its ticks and its label.

    The other axes have vertical lines at these ticks, and no ticks: ticks are the slowest part of matplotlib.
    """
    first, last = float(time.values[0]), float(time.values[-1])
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
    lowest.set_xlabel(axis_label(time), fontsize=9)
    figure = lowest.get_figure(root=True)
    assert figure is not None
    lowest.xaxis.set_label_coords(0.5, -0.28 / (lowest.get_position().height * figure.get_size_inches()[1]))


def _curves(axis: Axes, time: Abscissa, series: TimeSeries) -> None:
    for k, value in enumerate(series.values.T):
        axis.plot(time.values, value, STYLES[k], color=COLOURS[k], lw=1.2)
        if series.sd is not None:
            sd = 2 * series.sd[:, k]
            axis.fill_between(time.values, value - sd, value + sd, color=COLOURS[k], alpha=0.25, lw=0)


def _raw_points(axis: Axes, time: Abscissa, series: TimeSeries) -> None:
    """Draw raw differences as points below the curves, within the limits that curves and bands have set."""
    if series.raw is None or time.per_second is None:
        return
    low, high = axis.get_ylim()
    for values in series.raw.values.T:
        shown = (values >= low) & (values <= high)
        axis.plot(time.per_second * series.raw.time_s[shown], values[shown], ".", **RAW)
    axis.set_ylim(low, high)


def _deviations(axis: Axes, time: Abscissa, series: TimeSeries) -> None:
    assert series.sd is not None
    for k, sd in enumerate(series.sd.T):
        axis.plot(time.values, sd, STYLES[k], color=COLOURS[k], lw=1.0)
    axis.set_ylim(0, 1.15 * float(np.nanmax(series.sd)) or 1.0)
    axis.locator_params(axis="y", nbins=2)
    axis.tick_params(axis="y", labelsize=8)
    _set_label(axis, "sd")


def _legend(axis: Axes, result: ResultFolder, components: int, *, has_raw: bool) -> None:
    """A legend above the first panel, for all panels: components by line, raw points, and the meaning of the shades."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    lines = zip("xyz"[:components], STYLES, COLOURS, strict=False)
    handles: list[Any] = [Line2D([], [], ls=style, color=colour, lw=1.2, label=n) for n, style, colour in lines]
    if has_raw:
        handles.append(Line2D([], [], ls="", marker=".", label="raw differences", **RAW | {"ms": 6.0}))
    if result.contact_s is not None and abscissa(result).per_second is not None:
        handles.append(Patch(color=CONTACT, alpha=0.35, lw=0, label="contact"))
    if _not_measured(result).any():
        handles.append(Patch(color=MISSING, lw=0, label="not measured"))
    axis.legend(handles=handles, loc="lower right", bbox_to_anchor=(1, 1), ncols=6, **LEGEND)


def _not_measured(result: ResultFolder) -> NDArray[np.bool_]:
    """Frames (n,) whose translation was not measured."""
    return np.asarray(~np.isin(result.status, TRANSLATION_KNOWN))


def _shade(axis: Axes, result: ResultFolder, time: Abscissa) -> None:
    """Shade the contact, and each run of frames that were not measured."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], _not_measured(result), [False])).astype(int)))
    half = 0.5 * float(np.median(np.diff(time.values))) if len(time.values) > 1 else 0.5
    for start, stop in edges.reshape(-1, 2):
        axis.axvspan(time.values[start] - half, time.values[stop - 1] + half, color=MISSING, lw=0)
    if result.contact_s is not None and time.per_second is not None:
        axis.axvspan(*(time.per_second * t for t in result.contact_s), color=CONTACT, alpha=0.35, lw=0)
