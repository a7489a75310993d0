"""The figure of an accelerometer over the acceleration of a track."""

from __future__ import annotations

from typing import TYPE_CHECKING

from torchsphere.instruments.signals import Alignment
from torchsphere.report.figure_style import COLOURS, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def alignment_figure(found: Alignment) -> Figure:
    """Both signals above, and their difference below, over the track's time."""
    figure = new_figure(figsize=(8.0, 5.0), dpi=130)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    time = 1e3 * found.time_s
    above.plot(time, found.sensor_m_s2, color=COLOURS[1], lw=1.2, label="accelerometer, mean over a frame")
    above.plot(time, found.track_m_s2, ".", color=COLOURS[0], ms=4, label="track")
    above.set_ylabel("acceleration (m/s²)")
    above.legend()
    below.axhline(0, color="0.6", lw=0.8)
    below.plot(time, found.sensor_m_s2 - found.track_m_s2, color="0.3", lw=1)
    below.set_ylabel("difference")
    below.set_xlabel("time (ms)")
    return figure
