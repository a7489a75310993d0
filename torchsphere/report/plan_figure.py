"""One page for a plan: what the camera sees, what the force will look like, what blur and modes cost."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from torchsphere.plan.camera_modes import best
from torchsphere.plan.expected import MOST_BLUR_PX
from torchsphere.plan.free_flight import Flight
from torchsphere.plan.plan import Plan
from torchsphere.report.figures import COLOURS, STYLES, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Width of the background that is shown around the ball, in radii.
AROUND = 0.15

#: The region of interest of the correlation, share of the radius.
REGION = 0.95


def plan_figure(path: Path, plan: Plan) -> None:
    """Draw the plan as PNG."""
    figure = new_figure(figsize=(11.0, 8.0), dpi=130)
    axes = figure.subplots(2, 2)
    if plan.flight is not None:
        _velocity(axes[0, 0], plan.flight)
        _scatter_of_force(axes[1, 0], plan.flight)
    else:
        _image(axes[0, 0], plan)
        _blur(axes[1, 0], plan)
    _force(axes[0, 1], plan)
    if plan.verdicts:
        _modes(axes[1, 1], plan)
    else:
        _methods(axes[1, 1], plan)
    setup = plan.setup
    figure.suptitle(
        f"{setup.speed_m_s:.3g} m/s, {setup.frame_rate:g} frames/s, {setup.px_per_mm:.3g} px/mm, ball of "
        f"{setup.diameter_mm:g} mm and {setup.mass_g:g} g; {plan.origin}",
        fontsize=10,
    )
    figure.savefig(path)


def _image(axis: Axes, plan: Plan) -> None:
    assert plan.seen is not None  # there is an image where there is no recording
    x, y, radius = plan.seen.circle
    image = plan.seen.image.numpy()
    axis.imshow(image, cmap="gray", vmin=0, vmax=max(float(image.max()), 1.0))
    angle = np.linspace(0, 2 * np.pi, 361)
    axis.plot(
        x + REGION * radius * np.cos(angle),
        y + REGION * radius * np.sin(angle),
        color=COLOURS[1],
        lw=1,
        label="region of interest",
    )
    reach = (1 + AROUND) * radius
    axis.set(xlim=(x - reach, x + reach), ylim=(y + reach, y - reach), xlabel="x (px)", ylabel="y (px)")
    axis.legend(fontsize=8, loc="upper right")
    axis.set_title(f"Ball as filmed: radius {radius:.0f} px, motion blur {plan.setup.blur_px:.1f} px", fontsize=9)


def _blur(axis: Axes, plan: Plan) -> None:
    if len(plan.cost_of_blur):
        axis.plot(*plan.cost_of_blur.T, "o-", color=COLOURS[0], label="one side of the ball")
        axis.set_ylim(bottom=0)
    axis.axvline(plan.setup.blur_px, color=COLOURS[1], ls="--", label=f"this test: {plan.setup.blur_px:.1f} px")
    axis.axvline(MOST_BLUR_PX, color="0.5", ls=":", label=f"the paper's limit: {MOST_BLUR_PX:g} px")
    axis.set(xlabel="motion blur (px)", ylabel="sd of a step along the flight (px)")
    axis.set_title("What the exposure costs", fontsize=9)
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)


def _force(axis: Axes, plan: Plan) -> None:
    found = plan.rehearsal
    axis.set_title("The force along the flight, rehearsed with the expected errors", fontsize=9)
    axis.grid(alpha=0.3)
    if found is None:
        axis.text(0.5, 0.5, "contact too long for the rehearsal", ha="center", transform=axis.transAxes)
        return
    time = 1e6 * found.time_s
    value, sd = -1e-3 * found.force_along_N, 1e-3 * found.sd_force_along_N
    fine = np.linspace(0, plan.target.contact_s, 200)
    pulse = 1e-3 * found.peak_N * np.sin(np.pi * fine / plan.target.contact_s)
    axis.plot(1e6 * fine, pulse, color="0.5", lw=3, alpha=0.6, label="true")
    axis.plot(time, value, ".-", color=COLOURS[0], ms=5, lw=1, label="smoother, at the frames")
    axis.fill_between(time, value - 2 * sd, value + 2 * sd, color=COLOURS[0], alpha=0.25, lw=0, label="2 sd")
    reach = 1e6 * plan.target.contact_s
    axis.set(xlim=(-0.5 * reach, 1.5 * reach), xlabel="time from first touch (us)", ylabel="force (kN)")
    axis.legend(fontsize=8)


def _methods(axis: Axes, plan: Plan) -> None:
    """Standard deviations by way of differentiation, velocity left and force right."""
    found, plain = plan.rehearsal, plan.differences
    columns = [("differences", plain.velocity_m_s[:2], plain.force_N[:2])]
    if plan.flight is None:
        # Along and across the flight are the image's axes where it flies along one.
        axis.set_title("Standard deviation at a frame", fontsize=9)
    else:
        axis.set_title("Standard deviation at a frame, from the recording", fontsize=9)
    if found is not None:
        columns += [
            (f"smoother,\n{where}", found.velocity_m_s[k], found.force_N[k])
            for k, where in enumerate(("flight", "contact"))
        ]
    place = np.arange(len(columns), dtype=float)
    axis.bar(place - 0.18, [c[1].max() for c in columns], 0.32, color=COLOURS[0], label="velocity (m/s)")
    other = axis.twinx()
    other.bar(
        place + 0.18, [1e-3 * c[2].max() for c in columns], 0.32, color=COLOURS[1], label="force (kN)", hatch="//"
    )
    for part, heights in ((axis, [c[1].max() for c in columns]), (other, [1e-3 * c[2].max() for c in columns])):
        part.set_yscale("log")
        # Room below the lowest bar, so that it is one, and for the legend above the highest.
        part.set_ylim(min(heights) / 3, 5 * max(heights))
    axis.set_xticks(place, [c[0] for c in columns])
    axis.set_ylabel("sd of velocity (m/s)")
    other.set_ylabel("sd of force (kN)")
    handles = [part.get_legend_handles_labels() for part in (axis, other)]
    axis.legend(handles[0][0] + handles[1][0], handles[0][1] + handles[1][1], fontsize=8)


def _modes(axis: Axes, plan: Plan) -> None:
    chosen = best(plan.verdicts)
    for verdict in plan.verdicts:
        if verdict.rehearsal is None or verdict.reason:
            continue
        place = 1e-3 * verdict.mode.fps_max, 1e-3 * verdict.error_N
        axis.plot(*place, "o", color=COLOURS[0], mfc=COLOURS[0] if verdict is chosen else "white", ms=7)
        size = f"{verdict.mode.width_px} x {verdict.mode.height_px}"
        axis.annotate(size, place, xytext=(0, 7), textcoords="offset points", fontsize=8, ha="center")
    axis.margins(0.15)
    axis.set_ylim(bottom=0)
    axis.set(xlabel="frames/s (thousands)", ylabel="error of the force in contact (kN)")
    left_out = sum(bool(verdict.reason) for verdict in plan.verdicts)
    axis.set_title(f"The camera's modes; filled: best; {left_out} of no use are not drawn", fontsize=9)
    axis.grid(alpha=0.3)


def _velocity(axis: Axes, flight: Flight) -> None:
    time = 1e3 * (np.arange(len(flight.increment)) + 0.5) / flight.setup.frame_rate
    velocity = flight.velocity_m_s
    for k, name in enumerate(("$v_x$", "$v_y$")):
        mean, std = np.nanmean(velocity[:, k]), np.nanstd(velocity[:, k], ddof=1)
        label = f"{name} - {mean:.2f}: sd {std:.3g}"
        axis.plot(time, velocity[:, k] - mean, STYLES[k], color=COLOURS[k], lw=1.2, label=label)
    axis.set(xlabel="time (ms)", ylabel="velocity from its mean (m/s)")
    axis.set_title("Free flight, from one frame to the next", fontsize=9)
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)


def _scatter_of_force(axis: Axes, flight: Flight) -> None:
    force = 1e-3 * flight.force_N
    time = 1e3 * (np.arange(len(force)) + 1) / flight.setup.frame_rate
    for k, name in enumerate(("$F_x$", "$F_y$")):
        label = f"{name}: sd {np.nanstd(force[:, k], ddof=1):.3g}"
        axis.plot(time, force[:, k], STYLES[k], color=COLOURS[k], lw=1.2, label=label)
    axis.set(xlabel="time (ms)", ylabel="force (kN)")
    axis.set_title("Force by plain differences, where there is none", fontsize=9)
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
