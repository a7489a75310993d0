"""A plan as text for the terminal."""

from __future__ import annotations

import numpy as np

from torchsphere.planning.advice import cautions, remarks
from torchsphere.planning.camera_modes import best
from torchsphere.planning.expected import MAX_BLUR_PX
from torchsphere.planning.free_flight import Flight, mean_and_sd
from torchsphere.planning.plan import Plan

#: Axes of the image, and of the flight.
AXES = (("x", "along"), ("y", "across"))

#: Heading and row of the modes' table.
MODE_HEADING = ("width", "height", "frames/s", "R (px)", "in view", "sd v (m/s)", "force err (kN)")
MODE_ROW = "{:>6} {:>6} {:>9} {:>7} {:>8} {:>11} {:>15}"

#: Mean and standard deviation of table 3: m/s, m/s, kN, kN.
PAPER = ("72.32 +- 0.36", "0.72 +- 0.27", "0.07 +- 0.90", "0.02 +- 0.64")


def text(plan: Plan) -> str:
    """Test, uncertainty, modes, advice."""
    setup, target, warnings = plan.setup, plan.target, cautions(plan)
    step = float(np.hypot(*setup.increment[:2]))
    lines = [
        *(f"caution {sentence}" for sentence in warnings),
        f"test    {setup.speed_m_s:.4g} m/s, {setup.frame_rate:g} frames/s, ball of {setup.radius_px:.1f} px radius",
        f"        {step:.2f} px and {setup.turn_deg:.2f} deg per frame; {plan.origin}",
    ]
    if setup.shutter_s is not None:
        relation = "within" if setup.blur_px <= MAX_BLUR_PX else "above"
        lines.append(f"blur    {setup.blur_px:.2f} px, {relation} the paper's {MAX_BLUR_PX:g} px")
    if plan.width_px is not None:
        lines.append(f"view    {setup.frames_in_view(plan.width_px)} frames show the whole ball in {plan.width_px} px")
    lines.append(f"contact {1e6 * target.contact_s:.3g} us ({target.origin}), restitution {target.restitution:g}")
    if plan.flight is not None:
        lines += _flight_lines(plan.flight)
    lines += _uncertainty_lines(plan)
    if plan.assessments:
        lines += _mode_lines(plan)
    advice, *notes = [sentence for sentence in remarks(plan) if sentence not in warnings]
    return "\n".join((*lines, "", f"advice  {advice}", *(f"note    {sentence}" for sentence in notes)))


def _flight_lines(flight: Flight) -> list[str]:
    """The paper's table 3 for this set-up."""
    lines = ["", f"{'free flight, frame to frame':<28} {'mean':>10} {'sd':>10}   the paper's table 3"]
    paper = iter(PAPER)
    for name, unit, values in (("velocity", "m/s", flight.velocity_m_s), ("force", "kN", 1e-3 * flight.force_N)):
        mean, sd = mean_and_sd(values)
        for k, axis in enumerate("xy"):
            lines.append(f"{f'{name} {axis} ({unit})':<28} {mean[k]:>10.4g} {sd[k]:>10.3g}   {next(paper)}")
    mean, sd = mean_and_sd(flight.spin_rad_s)
    return lines + [f"{f'spin {a} (rad/s)':<28} {mean[k]:>10.4g} {sd[k]:>10.3g}" for k, a in enumerate("xyz")]


def _uncertainty_lines(plan: Plan) -> list[str]:
    """Standard deviations of a step, and of velocity, spin and force at a frame by differences and by the smoother."""
    sd, plain, rehearsal = np.sqrt(np.diagonal(plan.covariance)), plan.differences, plan.rehearsal
    steps = zip(("dx", "dy", "wx", "wy", "wz"), (*sd[:2], *np.degrees(sd[2:])), strict=True)
    shown = [f"{name} {value:.3g} {'px' if name[0] == 'd' else 'deg'}" for name, value in steps]
    lines = ["", "sd of a step from frame to frame: " + ", ".join(shown)]
    lines.append(f"{'sd at a frame':<32} {'differences':>12} {'smoother: flight':>18} {'contact':>10}")
    velocity = force = spin = np.full((2, 3), np.nan)
    if rehearsal is not None:
        velocity, force, spin = rehearsal.velocity_m_s, rehearsal.force_N, rehearsal.spin_rad_s
    # Differences are in the image's axes, the smoother's values along and across the flight.
    rows = [(f"velocity {a} / {b} (m/s)", plain.velocity_m_s[k], *velocity[:, k]) for k, (a, b) in enumerate(AXES)]
    rows += [(f"spin {a} (rad/s)", plain.spin_rad_s[k], *spin[:, k]) for k, a in enumerate("xyz")]
    rows += [
        (f"force {a} / {b} (kN)", 1e-3 * plain.force_N[k], *(1e-3 * force[:, k]))
        for k, (a, b) in reversed([*enumerate(AXES)])
    ]
    if rehearsal is not None:
        rows.append(("its true error in rehearsal (kN)", np.nan, *(1e-3 * rehearsal.force_error_N)))
    for name, *values in rows:
        cells = ("" if np.isnan(value) else f"{value:.3g}" for value in values)
        lines.append("{:<32} {:>12} {:>18} {:>10}".format(name, *cells).rstrip())
    if rehearsal is not None and rehearsal.is_between_frames:
        lines.append("contact: no numbers, as it falls between two frames")
    return lines


def _mode_lines(plan: Plan) -> list[str]:
    """A line for each of the camera's modes."""
    lines, chosen = ["", MODE_ROW.format(*MODE_HEADING)], best(plan.assessments)
    for assessment in plan.assessments:
        mode, rehearsal, reason = assessment.mode, assessment.rehearsal, assessment.reason
        cells = MODE_ROW.format(
            mode.width_px,
            mode.height_px,
            f"{mode.fps_max:g}",
            f"{assessment.setup.radius_px:.1f}",
            assessment.frames_in_view,
            "" if rehearsal is None else f"{rehearsal.velocity_m_s[0, 0]:.3g}",
            "" if reason else f"{1e-3 * assessment.error_N:.3g}",
        )
        lines.append(f"{cells}  {reason or ('best' if assessment is chosen else '')}".rstrip())
    return lines
