"""Figures of a result against time: motion, rotation, quality of the measurement."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.report.figures import COLOURS, DPI, STYLES, new_figure
from torchsphere.report.folder import TRANSLATION_KNOWN, ResultFolder
from torchsphere.report.panels import Abscissa, Panel, abscissa, panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Width of a figure, and height of one of its panels, inches: a page's text width.
WIDTH, HEIGHT = 7.0, 1.9

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
    """Position, velocity, force or acceleration, and spin, with bands of two standard deviations."""
    shown = [panel for panel in panels(result) if panel.key not in ("turned", "zncc")]
    figure = _stack(result, shown, f"Motion of the ball, {_frame(result)}; bands: 2 sd")
    about = result.summary.get("differentiation")
    if about:
        figure.axes[1].set_title(_differentiation(about), fontsize=8, loc="left", color="0.35")
    return figure


def rotation_figure(result: ResultFolder) -> Figure:
    """Angles turned since the first frame, and spin: the paper's figure 9."""
    shown = [panel for panel in panels(result) if panel.key in ("turned", "spin")]
    title = f"Rotation of the ball, {_frame(result)}; angles: sums of the steps; bands: 2 sd"
    return _stack(result, shown[::-1], title)


def quality_figure(result: ResultFolder) -> Figure:
    """Correlation coefficient and status of every frame."""
    where = abscissa(result)
    figure, axes = _figure(2)
    panel = next(panel for panel in panels(result) if panel.key == "zncc")
    least = result.summary["settings"].get("min_zncc")
    axes[0].plot(where.values, panel.values[:, 0], ".-", color=COLOURS[0], lw=1, ms=3, label="ZNCC")
    # Where all match well the limit is far below, and would flatten what there is to see.
    if least is not None and np.nanmin(panel.values, initial=1.0) < least + 0.15:
        axes[0].axhline(least, color="0.4", ls=":", lw=1, label=f"least that is believed, {least:g}")
    axes[0].set_ylabel("correlation (ZNCC)")
    axes[0].ticklabel_format(axis="y", useOffset=False)
    axes[0].set_title("How well each image matches the one before it", fontsize=10, loc="left", pad=18)
    if not np.isfinite(panel.values).any():
        axes[0].text(0.5, 0.5, "not measured", transform=axes[0].transAxes, ha="center", va="center", color="0.35")
    _legend(axes[0])
    there = [name for name in STATUS_COLOURS if (result.status == name).any()]
    for level, name in enumerate(there):
        at = where.values[result.status == name]
        axes[1].plot(at, np.full(len(at), level), "|", color=STATUS_COLOURS[name], ms=14, mew=1.5)
    axes[1].set_yticks(range(len(there)), [f"{n.replace('_', ' ')}: {(result.status == n).sum()}" for n in there])
    axes[1].set(ylim=(len(there) - 0.4, -0.6), xlabel=where.label)
    axes[1].set_title("Status of each frame", fontsize=10, loc="left")
    figure.subplots_adjust(left=0.2)
    return figure


def _frame(result: ResultFolder) -> str:
    return "lab frame (y up)" if result.lab_frame and result.motion is not None else "camera frame (y down)"


def _stack(result: ResultFolder, shown: list[Panel], title: str) -> Figure:
    where = abscissa(result)
    figure, axes = _figure(len(shown))
    for axis, panel in zip(axes, shown, strict=True):
        _draw(axis, where, panel)
        _mark_failures(axis, result, where)
        if result.contact_s is not None and where.per_second is not None:
            axis.axvspan(*(where.per_second * t for t in result.contact_s), color="#F0E442", alpha=0.35, lw=0)
            axis.fill_between([], [], color="#F0E442", alpha=0.35, lw=0, label="contact")
        _legend(axis)
    axes[-1].set_xlabel(where.label)
    axes[0].set_title(title, fontsize=10, loc="left", pad=18)
    return figure


def _figure(count: int) -> tuple[Figure, NDArray[Any]]:
    """A figure with ``count`` panels above each other; its margins are set, which is faster than to seek them."""
    height = HEIGHT * count + 0.9
    figure = new_figure(figsize=(WIDTH, height), dpi=DPI, layout=None)
    axes = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    figure.subplots_adjust(0.11, 0.5 / height, 0.98, 1 - 0.5 / height, hspace=0.28)
    figure.align_ylabels(axes)
    for axis in axes:
        axis.grid(alpha=0.3)
    return figure, axes


def _draw(axis: Axes, where: Abscissa, panel: Panel) -> None:
    for k, name in enumerate(panel.names):
        value = panel.values[:, k]
        axis.plot(where.values, value, STYLES[k], color=COLOURS[k], lw=1.2, label=name)
        if panel.sd is not None:
            sd = 2 * panel.sd[:, k]
            axis.fill_between(where.values, value - sd, value + sd, color=COLOURS[k], alpha=0.25, lw=0)
    axis.set_ylabel(panel.label)
    if not np.isfinite(panel.values).any():
        axis.text(0.5, 0.5, "not measured", transform=axis.transAxes, ha="center", va="center", color="0.35")
        axis.set_ylim(-1, 1)


def _legend(axis: Axes) -> None:
    axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), fontsize=8, ncols=5, frameon=False, borderaxespad=0.1)


def _mark_failures(axis: Axes, result: ResultFolder, where: Abscissa) -> None:
    """Shade the runs of frames in which the motion was not measured."""
    failed = ~np.isin(result.status, TRANSLATION_KNOWN)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], failed, [False])).astype(int)))
    half = 0.5 * float(np.median(np.diff(where.values)))
    for i, (start, stop) in enumerate(edges.reshape(-1, 2)):
        label = "not measured" if i == 0 else None
        axis.axvspan(where.values[start] - half, where.values[stop - 1] + half, color="0.87", lw=0, label=label)


def _differentiation(about: dict[str, Any]) -> str:
    """How velocity and acceleration were made, and up to which frequency they pass what happened."""
    names = ("bandwidth_contact_translation_Hz", "bandwidth_flight_translation_Hz", "bandwidth_Hz")
    band = next((about[name] for name in names if name in about), None)
    if band is None or band.get("rate") is None or band.get("acceleration") is None:
        return str(about["method"])
    rate, acceleration = (1e-3 * band[name] for name in ("rate", "acceleration"))
    return f"{about['method']}; passes {rate:.3g} kHz (velocity), {acceleration:.3g} kHz (force)"
