"""Figures over time: motion, rotation, and the quality of the measurement."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from torchsphere.report import stacked_panels as panels
from torchsphere.report.explanations import missing_for_si, why_empty
from torchsphere.report.figure_style import COLOURS, DPI, STATUS_COLOURS, new_figure
from torchsphere.report.time_series import abscissa, time_series
from torchsphere.results.reader import ResultFolder

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Height of a row of the status marks, inches.
STATUS_ROW = 0.3

#: Left margin of the quality figure, which holds the longest name of a status, inches; x of its label, axis widths.
STATUS_LEFT, CORRELATION_LABEL_X = 1.45, -0.145


def motion_figure(result: ResultFolder) -> Figure:
    """Position, velocity, force or acceleration, and spin, each with its standard deviation below."""
    series = [quantity for quantity in time_series(result) if quantity.key not in ("turned", "zncc")]
    figure = panels.stacked_figure(result, series, f"Motion of the ball, {_frame(result)}")
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
    figure = panels.stacked_figure(result, series[::-1], f"Rotation of the ball, {_frame(result)}")
    if figure.axes[0].lines:
        _remark(figure.axes[0], "sums of the steps from one frame to the next")
    return figure


def quality_figure(result: ResultFolder) -> Figure:
    """Correlation coefficient and status of every frame."""
    where = abscissa(result)
    names = [name for name in STATUS_COLOURS if (result.status == name).any()]
    marks_height = STATUS_ROW * len(names) + 0.1
    height = panels.TOP + panels.PANEL + panels.PANEL_GAP + marks_height + panels.BOTTOM
    figure = new_figure(figsize=(panels.WIDTH, height), dpi=DPI, layout=None)
    above = panels.add_panel(figure, panels.BOTTOM + marks_height + panels.PANEL_GAP, panels.PANEL, STATUS_LEFT)
    marks = panels.add_panel(figure, panels.BOTTOM, marks_height, STATUS_LEFT)
    _correlation(above, result)
    for level, name in enumerate(names):
        x = where.values[result.status == name]
        marks.plot(x, np.full(len(x), level), "|", color=STATUS_COLOURS[name], ms=12, mew=1.5)
    marks.set_yticks(range(len(names)), [f"{n.replace('_', ' ')}: {(result.status == n).sum()}" for n in names])
    marks.set_ylim(len(names) - 0.4, -0.6)
    marks.set_title("Status of each frame", fontsize=9, loc="left", y=1.0)
    panels.set_time_axis([above, marks], where)
    panels.set_title(figure, "How well each image matches the one before it")
    return figure


def _correlation(axis: Axes, result: ResultFolder) -> None:
    label, zncc = "correlation (ZNCC)", result.zncc
    if not np.isfinite(zncc).any():
        panels.write_reason(axis, why_empty(result, "zncc"), label)
        return
    axis.plot(abscissa(result).values, zncc, ".-", color=COLOURS[0], lw=1, ms=3, label="ZNCC")
    least = result.summary["settings"].get("min_zncc")
    # A limit far below all values would flatten the curve.
    if least is not None and np.nanmin(zncc) < least + 0.15:
        axis.axhline(least, color="0.4", ls=":", lw=1, label=f"least that is believed, {least:g}")
        axis.legend(loc="lower right", bbox_to_anchor=(1, 1), fontsize=8, ncols=2, frameon=False, borderaxespad=0.1)
    axis.ticklabel_format(axis="y", useOffset=False)
    panels.set_label(axis, label, CORRELATION_LABEL_X)


def _frame(result: ResultFolder) -> str:
    return "lab frame (y up)" if result.lab_frame else "camera frame (y down)"


def _remark(axis: Axes, text: str) -> None:
    """Write a remark above a panel; its fixed position spares matplotlib the measuring of all labels."""
    axis.set_title(text, fontsize=8, loc="left", color="0.35", y=1.0, pad=4)


def _differentiation(about: dict[str, Any], second: str) -> str:
    """The method that gave velocity and the ``second`` derivative, and its bandwidth."""
    bandwidths = {
        "bandwidth_contact_translation_Hz": " in contact",
        "bandwidth_flight_translation_Hz": " in flight",
        "bandwidth_Hz": "",
    }
    name = next((name for name in bandwidths if name in about), None)
    band = None if name is None else about[name]
    if name is None or band is None or band.get("rate") is None or band.get("acceleration") is None:
        return str(about["method"])
    rate, acceleration = (1e-3 * band[key] for key in ("rate", "acceleration"))
    return (
        f"{about['method']}; bandwidth{bandwidths[name]} {rate:.2g} kHz (velocity), {acceleration:.2g} kHz ({second})"
    )
