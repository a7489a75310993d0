"""Figures of an accelerometer, and of the force by a bar's strain gauges, over a track."""

from __future__ import annotations

from typing import TYPE_CHECKING

from torchsphere.instruments.signals import Alignment
from torchsphere.instruments.strain_gauge import BarForce
from torchsphere.report.figure_style import COLOURS, new_figure
from torchsphere.runtime.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def alignment_figure(found: Alignment) -> Figure:
    """Both signals above, and their difference below, over the track's time."""
    figure, above = _compared(found.time_s, found.sensor_m_s2 - found.track_m_s2, "acceleration (m/s²)")
    time = 1e3 * found.time_s
    above.plot(time, found.sensor_m_s2, color=COLOURS[1], lw=1.2, label="accelerometer, mean over a frame")
    above.plot(time, found.track_m_s2, ".", color=COLOURS[0], ms=4, label="track")
    above.legend()
    return figure


def bar_figure(found: BarForce) -> Figure:
    """Both forces with bands of two standard deviations above, and their difference below, over the track's time."""
    figure, above = _compared(found.time_s, 1e-3 * (found.bar_N - found.track_N), "force on the ball (kN)")
    time = 1e3 * found.time_s
    curves = (
        (found.bar_N, found.sd_bar_N, "-", COLOURS[1], "bar, mean over a frame"),
        (found.track_N, found.sd_track_N, ".", COLOURS[0], "track"),
    )
    for force, sd, style, colour, label in curves:
        above.fill_between(time, 1e-3 * (force - 2 * sd), 1e-3 * (force + 2 * sd), color=colour, alpha=0.25, lw=0)
        above.plot(time, 1e-3 * force, style, color=colour, ms=4, lw=1.2, label=label)
    if found.valid_until_s is not None:
        for axis in figure.axes:
            axis.axvline(1e3 * found.valid_until_s, color="0.4", ls="--", lw=1)
        above.plot([], [], color="0.4", ls="--", lw=1, label="reflection arrives")
    above.legend()
    return figure


def _compared(time_s: Array, difference: Array, quantity: str) -> tuple[Figure, Axes]:
    """A figure with the ``difference`` of two courses over the time below, and axes above for both courses."""
    figure = new_figure(figsize=(8.0, 5.0), dpi=130)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    above.set_ylabel(quantity)
    below.axhline(0, color="0.6", lw=0.8)
    below.plot(1e3 * time_s, difference, color="0.3", lw=1)
    below.set(xlabel="time (ms)", ylabel="difference")
    return figure, above
