"""Figures with matplotlib, which is imported only when one is drawn."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.circle import Circle
from torchsphere.kinematics import Kinematics
from torchsphere.track import Track

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Blue, vermilion, green of Okabe and Ito, which colour-blind readers tell apart; also by line style.
COLOURS = ("#0072B2", "#D55E00", "#009E73")
STYLES = ("-", "--", "-.")


def new_figure(**settings: Any) -> Figure:
    """A figure without a window, whatever the user's matplotlib is set to."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(layout="constrained", **settings)
    FigureCanvasAgg(figure)
    return figure


def motion_figure(path: Path, track: Track, motion: Kinematics | None, first_frame: int) -> None:
    """Position, velocity, force where it is known, and rotation against time, with bands of two standard deviations.

    In SI units where they are known, otherwise in px and frames; the contact is shaded. PNG.
    """
    force = motion is not None and motion.force_N is not None
    figure = new_figure(figsize=(7.0, 10.0 if force else 8.0), dpi=150)
    axes = figure.subplots(4 if force else 3, 1, sharex=True)
    if motion is not None:
        _in_si(axes, motion)
    else:
        _in_px(axes, track, first_frame)
    for axis in axes:
        _mark_failures(axis, track, motion, first_frame)
        axis.grid(alpha=0.3)
        axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), fontsize=8, ncols=4, frameon=False, borderaxespad=0.1)
    figure.savefig(path)


def _in_si(axes: NDArray[Any], motion: Kinematics) -> None:
    time = 1e3 * motion.time_s
    up = "up" if motion.lab_frame else "down"
    _bands(axes[0], time, 1e3 * motion.position_m, 1e3 * motion.sd_position_m, ("x (right)", f"y ({up})"))
    _bands(axes[1], time, motion.velocity_m_s, motion.sd_velocity_m_s, ("$v_x$", "$v_y$"))
    names = ("$\\omega_x$", "$\\omega_y$", "$\\omega_z$")
    _bands(axes[-1], time, motion.spin_rad_s, motion.sd_spin_rad_s, names)
    labels = ["position (mm)", "velocity (m/s)", "spin (rad/s)"]
    if motion.force_N is not None and motion.sd_force_N is not None:
        _bands(axes[2], time, 1e-3 * motion.force_N, 1e-3 * motion.sd_force_N, ("$F_x$", "$F_y$"))
        labels.insert(2, "force (kN)")
    for axis, label in zip(axes, labels, strict=True):
        axis.set_ylabel(label)
        if motion.contact_s is not None:
            axis.axvspan(*(1e3 * motion.contact_s), color="#F0E442", alpha=0.35, lw=0, label="contact")
    axes[-1].set_xlabel("time (ms)")
    axes[1].set_title(_differentiation(motion), fontsize=8, loc="left", color="0.35")
    axes[0].set_title(
        f"Motion of the ball, {'lab' if motion.lab_frame else 'camera'} frame; bands: 2 sd", fontsize=10, loc="left"
    )


def _differentiation(motion: Kinematics) -> str:
    """How velocity and acceleration were made, and up to which frequency they pass what happened."""
    about = motion.about
    names = ("bandwidth_contact_translation_Hz", "bandwidth_flight_translation_Hz", "bandwidth_Hz")
    band = next((about[name] for name in names if name in about), None)
    if band is None:
        return str(about["method"])
    rate, acceleration = (1e-3 * band[name] for name in ("rate", "acceleration"))
    return f"{about['method']}; passes {rate:.3g} kHz (velocity), {acceleration:.3g} kHz (force)"


def _in_px(axes: NDArray[Any], track: Track, first_frame: int) -> None:
    frames = first_frame + np.arange(len(track.status))
    between = frames[1:] - 0.5
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2))
    nothing = np.zeros_like(track.position)
    _bands(axes[0], frames, track.position, nothing, ("x (right)", "y (down)"))
    _bands(axes[1], between, track.increment[:, :2], sd[:, :2], ("dx", "dy"))
    degrees = np.degrees(track.increment[:, 2:])
    _bands(axes[2], between, degrees, np.degrees(sd[:, 2:]), ("$w_x$", "$w_y$", "$w_z$"))
    for axis, label in zip(axes, ("position (px)", "step (px per frame)", "rotation (deg per frame)"), strict=True):
        axis.set_ylabel(label)
    axes[2].set_xlabel("frame")
    axes[0].set_title("Motion of the ball, camera frame; bands: 2 sd", fontsize=10, loc="left")


def _bands(axis: Axes, x: NDArray[Any], values: NDArray[Any], sd: NDArray[Any], names: tuple[str, ...]) -> None:
    for value, width, name, colour, style in zip(values.T, sd.T, names, COLOURS, STYLES, strict=False):
        axis.plot(x, value, style, color=colour, lw=1.2, label=name)
        axis.fill_between(x, value - 2 * width, value + 2 * width, color=colour, alpha=0.25, lw=0)


def _mark_failures(axis: Axes, track: Track, motion: Kinematics | None, first_frame: int) -> None:
    """Shade the frames in which something was not measured."""
    failed = np.flatnonzero(~np.isin(track.status, ("ok", "weak_texture")))
    unit = 1.0 if motion is None else 1e3 / motion.frame_rate
    for i, frame in enumerate(first_frame + failed):
        label = "not measured" if i == 0 else None
        axis.axvspan((frame - 0.5) * unit, (frame + 0.5) * unit, color="0.85", lw=0, label=label)


def preview_figure(path: Path, image: NDArray[np.float32], circle: Circle, title: str) -> None:
    """The image with the circle drawn on it and its numbers, ready to paste into ``--circle``, as PNG."""
    height, width = image.shape
    figure = new_figure(figsize=(8.0, 8.0 * height / width + 0.9), dpi=120)
    axis = figure.subplots()
    low, high = np.percentile(image, (0.5, 99.5))
    axis.imshow(image, cmap="gray", vmin=low, vmax=max(high, low + 1e-6))
    angle = np.linspace(0, 2 * np.pi, 361)
    x, y = circle.x + circle.radius * np.cos(angle), circle.y + circle.radius * np.sin(angle)
    axis.plot(x, y, color=COLOURS[1], lw=1.2)
    axis.plot(circle.x, circle.y, "+", color=COLOURS[1], ms=12)
    axis.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="x (px)", ylabel="y (px)")
    axis.set_title(title, fontsize=9)
    figure.savefig(path)
