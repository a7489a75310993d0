"""The figure of a plan: the image of the ball, the expected force, and the cost of blur and camera modes."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from torchsphere.planning.expected import MAX_BLUR_PX
from torchsphere.planning.free_flight import Flight
from torchsphere.planning.plan import Plan, best
from torchsphere.planning.rehearsal import MAX_CONTACT_FRAMES, Rehearsal
from torchsphere.report.figure_style import COLOURS, STYLES, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import SubplotSpec

#: Width of the background around the ball, radii.
BACKGROUND = 0.15

#: Region of interest of the correlation, share of the radius.
REGION = 0.95

#: Room above curves for their legend, share of their range.
LEGEND_ROOM = 0.3

#: Letters in a line of the heading.
HEADING_LETTERS = 130

Values = NDArray[np.floating]


def plan_figure(plan: Plan) -> Figure:
    """The figure of a plan.

    Left: the image of the ball and the cost of blur, or velocity and force of a measured flight. Right: the expected
    force, and below it the camera's modes or the methods of differentiation.
    """
    figure = new_figure(figsize=(11.0, 8.0), dpi=130)
    grid = figure.add_gridspec(2, 2)
    upper, lower = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[1, 0])
    if plan.flight is not None:
        _flight(upper, lower, plan.flight)
    else:
        _image(upper, plan)
        _blur(lower, plan)
    _force(figure, grid[0, 1], plan)
    if plan.assessments:
        _modes(figure.add_subplot(grid[1, 1]), plan)
    else:
        _methods(figure, grid[1, 1], plan)
    setup = plan.setup
    heading = (
        f"{setup.speed_m_s:.3g} m/s, {setup.frame_rate:g} frames/s, {setup.px_per_mm:.3g} px/mm, ball of "
        f"{setup.diameter_mm:g} mm and {setup.mass_g:g} g; {plan.origin}"
    )
    figure.suptitle(textwrap.fill(heading, HEADING_LETTERS), fontsize=10)
    return figure


def _image(axis: Axes, plan: Plan) -> None:
    assert plan.example is not None  # there is an image where there is no recording
    x, y, radius = plan.example.circle
    image = plan.example.image.numpy()
    axis.imshow(image, cmap="gray", vmin=0, vmax=max(float(image.max()), 1.0))
    angle = np.linspace(0, 2 * np.pi, 361)
    region = REGION * radius
    axis.plot(x + region * np.cos(angle), y + region * np.sin(angle), color=COLOURS[1], lw=1.2)
    reach = (1 + BACKGROUND) * radius
    axis.set(xlim=(x - reach, x + reach), ylim=(y + reach, y - reach), xlabel="x (px)", ylabel="y (px)")
    about = f"Ball as filmed: radius {radius:.0f} px, motion blur {plan.setup.blur_px:.1f} px; circle: region measured"
    axis.set_title(about, fontsize=9)


def _blur(axis: Axes, plan: Plan) -> None:
    if len(plan.cost_of_blur):
        axis.plot(*plan.cost_of_blur.T, "o-", color=COLOURS[0], ms=5, label="one side of the ball")
        axis.set_ylim(0, (1 + LEGEND_ROOM) * float(np.nanmax(plan.cost_of_blur[:, 1])))
    axis.axvline(plan.setup.blur_px, color=COLOURS[1], ls="--", label=f"this test: {plan.setup.blur_px:.1f} px")
    axis.axvline(MAX_BLUR_PX, color="0.5", ls=":", label=f"the paper's limit: {MAX_BLUR_PX:g} px")
    axis.set(xlabel="motion blur (px)", ylabel="sd of a step along the flight (px)")
    axis.set_title("What the exposure costs", fontsize=9)
    axis.legend(fontsize=8, loc="upper left", ncols=3, framealpha=1)
    axis.grid(alpha=0.3)


def _force(figure: Figure, place: SubplotSpec, plan: Plan) -> None:
    """The rehearsed force, and below it its error on a scale of its own."""
    found = plan.rehearsal
    is_between = found is not None and found.is_between_frames
    end = ": the contact falls between two frames" if is_between else ", rehearsed with the expected errors"
    title = f"The force along the flight{end}"
    if found is None:
        axis = figure.add_subplot(place, xticks=[], yticks=[])
        axis.set_title(title, fontsize=9)
        why = f"not rehearsed: more than {MAX_CONTACT_FRAMES} frames in contact;\ngive a lower --fps or --contact-us"
        axis.text(0.5, 0.5, why, ha="center", va="center", fontsize=9, color="0.25", transform=axis.transAxes)
        return
    parts = place.subgridspec(2, 1, height_ratios=(2.4, 1))
    axis = figure.add_subplot(parts[0])
    axis.set_title(title, fontsize=9)
    time = 1e6 * found.time_s
    fine = np.linspace(0, plan.target.contact_s, 200)
    pulse = 1e-3 * found.peak_N * np.sin(np.pi * fine / plan.target.contact_s)
    axis.plot(1e6 * fine, pulse, color="0.6", lw=3, label="true")
    axis.plot(time, -1e-3 * found.force_along_N, ".-", color=COLOURS[0], ms=5, lw=1, label="smoother, at the frames")
    # A contact shorter than a frame may lie between two frames: both must be visible.
    reach = 1e6 * max(plan.target.contact_s, 1 / plan.setup.frame_rate)
    axis.set(xlim=(-0.5 * reach, 1.5 * reach), ylabel="force (kN)")
    axis.set_ylim(top=(1 + LEGEND_ROOM) * axis.get_ylim()[1])
    axis.legend(fontsize=8, loc="upper left", ncols=2)
    axis.grid(alpha=0.3)
    axis.tick_params(labelbottom=False)
    _force_error(figure.add_subplot(parts[1], sharex=axis), found)


def _force_error(axis: Axes, found: Rehearsal) -> None:
    time = 1e6 * found.time_s
    error, sd = -1e-3 * (found.force_along_N - found.true_force_N), 1e-3 * found.sd_force_along_N
    axis.fill_between(time, -2 * sd, 2 * sd, color=COLOURS[0], alpha=0.25, lw=0, label="2 sd as stated")
    axis.plot(time, error, ".-", color=COLOURS[0], ms=5, lw=1, label="smoother - true")
    low, high = axis.get_xlim()
    seen = (time > low) & (time < high)
    most = float(np.nanmax(np.abs(np.concatenate((error[seen], 2 * sd[seen])))))
    axis.set(xlabel="time from first touch (µs)", ylabel="error (kN)", ylim=(-1.2 * most, 2.0 * most))
    axis.legend(fontsize=8, loc="upper left", ncols=2)
    axis.grid(alpha=0.3)


def _methods(figure: Figure, place: SubplotSpec, plan: Plan) -> None:
    """Standard deviations of velocity and force by method of differentiation; a decade has the same height in both."""
    found, plain = plan.rehearsal, plan.differences
    names = ["differences"]
    velocity, force = [float(plain.velocity_m_s[:2].max())], [1e-3 * float(plain.force_N[:2].max())]
    if found is not None:
        for k, where in enumerate(("flight", "contact")):
            names.append(f"smoother,\n{where}")
            velocity.append(float(found.velocity_m_s[k].max()))
            force.append(1e-3 * float(found.force_N[k].max()))
    # Two decades or more, so that the axis of a single bar is readable.
    span = max(100.0, *(np.nanmax(heights) / np.nanmin(heights) for heights in (velocity, force)))
    parts = place.subgridspec(1, 2)
    source = "" if plan.flight is None else "recording's, "
    for k, (name, unit, heights) in enumerate((("velocity", "m/s", velocity), ("force", "kN", force))):
        axis = figure.add_subplot(parts[k])
        _bars(axis, names, heights, span, COLOURS[k])
        axis.set_ylabel(f"sd of {name} ({unit})")
        # Two axes: of the image for differences, along and across the flight for the smoother.
        axis.set_title(f"Sd of the {name} at a frame,\n{source}larger of two axes", fontsize=9)


def _bars(axis: Axes, names: Sequence[str], heights: Sequence[float], span: float, colour: str) -> None:
    """Bars with their numbers, on a logarithmic axis that covers a ratio of ``span`` and some room."""
    bars = axis.bar(range(len(names)), heights, 0.6, color=colour)
    axis.bar_label(bars, ["" if np.isnan(height) else f"{height:.2g}" for height in heights], fontsize=8, padding=2)
    # A missing bar has no height, so that the height of its text is a share of the axis.
    transform = axis.get_xaxis_transform()
    for place in (i for i, height in enumerate(heights) if np.isnan(height)):
        axis.text(place, 0.03, "no frame\nin contact", fontsize=8, color="0.25", ha="center", transform=transform)
    axis.set_xlim(-0.45, len(names) - 0.55)
    axis.set_yscale("log")
    middle = float(np.sqrt(np.nanmin(heights) * np.nanmax(heights)))
    axis.set_ylim(middle / np.sqrt(span) / 3, 2 * middle * np.sqrt(span))
    axis.set_xticks(range(len(names)), names, fontsize=8)
    axis.grid(alpha=0.3, axis="y")
    axis.set_axisbelow(True)


def _modes(axis: Axes, plan: Plan) -> None:
    chosen = best(plan.assessments)
    of_use = [v for v in plan.assessments if v.rehearsal is not None and not v.reason]
    for verdict in of_use:
        place = 1e-3 * verdict.mode.fps_max, 1e-3 * verdict.error_N
        axis.plot(*place, "o", color=COLOURS[0], mfc=COLOURS[0] if verdict is chosen else "white", ms=7)
        size = f"{verdict.mode.width_px} x {verdict.mode.height_px} px"
        axis.annotate(size, place, xytext=(0, 7), textcoords="offset points", fontsize=8, ha="center")
    left_out = len(plan.assessments) - len(of_use)
    not_drawn = f"; {left_out} of no use not drawn" if left_out else ""
    axis.set_title(f"The camera's modes; filled: best{not_drawn}", fontsize=9)
    if not of_use:
        axis.set(xticks=[], yticks=[])
        axis.text(0.5, 0.5, "no mode is of use: plan.json says why", ha="center", transform=axis.transAxes)
        return
    axis.margins(x=0.2)
    axis.set_ylim(0, (1 + LEGEND_ROOM) * 1e-3 * max(verdict.error_N for verdict in of_use))
    axis.set(xlabel="frame rate (1000 frames/s)", ylabel="error of the force in contact (kN)")
    axis.grid(alpha=0.3)


def _flight(upper: Axes, lower: Axes, flight: Flight) -> None:
    """Velocity and force of a free flight over time; the force should be zero."""
    rate, velocity, force = flight.setup.frame_rate, flight.velocity_m_s, 1e-3 * flight.force_N
    mean = np.nanmean(velocity, axis=0)
    names = [f"$v_{axis}$ - {m:.2f} m/s" for axis, m in zip("xy", mean, strict=False)]
    _scatter(upper, 1e3 * (np.arange(len(velocity)) + 0.5) / rate, velocity[:, :2] - mean[:2], names, "m/s")
    upper.set_ylabel("velocity from its mean (m/s)")
    upper.set_title("Free flight, from one frame to the next", fontsize=9)
    _scatter(lower, 1e3 * (np.arange(len(force)) + 1) / rate, force[:, :2], ["$F_x$", "$F_y$"], "kN")
    lower.set_ylabel("force (kN)")
    lower.set_title("Force by plain differences, where there is none", fontsize=9)
    for axis in (upper, lower):
        axis.set_xlim(0, 1e3 * (len(velocity) + 1) / rate)


def _scatter(axis: Axes, time: Values, values: Values, names: Sequence[str], unit: str) -> None:
    """Two components that should be zero, with their standard deviations in the legend."""
    if np.isfinite(values).all(1).sum() < 2:
        axis.set(xlabel="time (ms)", yticks=[])
        why = "not measured: no two steps follow each other"
        axis.text(0.5, 0.5, why, ha="center", va="center", fontsize=9, color="0.25", transform=axis.transAxes)
        return
    for k, name in enumerate(names):
        label = f"{name}: sd {np.nanstd(values[:, k], ddof=1):.2g} {unit}"
        axis.plot(time, values[:, k], STYLES[k], color=COLOURS[k], lw=1.2, label=label)
    most = 1.1 * float(np.nanmax(np.abs(values)))
    axis.set(xlabel="time (ms)", ylim=(-most, (1 + LEGEND_ROOM) * most))
    axis.legend(fontsize=8, loc="upper right", ncols=2)
    axis.grid(alpha=0.3)
