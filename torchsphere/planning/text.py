"""A plan as text for the terminal."""

from __future__ import annotations

import numpy as np

from torchsphere.planning import camera_modes, free_flight
from torchsphere.planning.advice import cautions, remarks
from torchsphere.planning.expected import MOST_BLUR_PX
from torchsphere.planning.free_flight import Flight
from torchsphere.planning.plan import Plan

#: Axes of the image, and of the flight.
AXES = (("x", "along"), ("y", "across"))

#: Columns of the modes' table, and their widths.
HEAD = ("width", "height", "frames/s", "R (px)", "in view", "sd v (m/s)", "force err (kN)")
WIDTHS = (6, 6, 9, 7, 8, 11, 15)

#: Mean and standard deviation of table 3: m/s, m/s, kN, kN.
PAPER = ("72.32 +- 0.36", "0.72 +- 0.27", "0.07 +- 0.90", "0.02 +- 0.64")


def text(plan: Plan) -> str:
    """Test, uncertainty, modes, advice."""
    setup = plan.setup
    step = float(np.hypot(*setup.increment[:2]))
    doubts = cautions(plan)
    lines = [
        *(f"caution {sentence}" for sentence in doubts),
        f"test    {setup.speed_m_s:.4g} m/s, {setup.frame_rate:g} frames/s, ball of {setup.radius_px:.1f} px radius",
        f"        {step:.2f} px and {setup.turn_deg:.2f} deg per frame; {plan.origin}",
    ]
    if setup.shutter_s is not None:
        within = "within" if setup.blur_px <= MOST_BLUR_PX else "above"
        lines.append(f"blur    {setup.blur_px:.2f} px, {within} the paper's {MOST_BLUR_PX:g} px")
    if plan.width_px is not None:
        lines.append(f"view    {setup.frames_in_view(plan.width_px)} frames show the whole ball in {plan.width_px} px")
    target = plan.target
    lines.append(f"contact {1e6 * target.contact_s:.3g} us ({target.origin}), restitution {target.restitution:g}")
    if plan.flight is not None:
        lines += _of_flight(plan.flight)
    lines += _of_uncertainty(plan)
    if plan.verdicts:
        lines += _of_modes(plan)
    advice, *more = [sentence for sentence in remarks(plan) if sentence not in doubts]
    return "\n".join((*lines, "", f"advice  {advice}", *(f"note    {sentence}" for sentence in more)))


def _of_flight(flight: Flight) -> list[str]:
    """The paper's table 3 for this set-up."""
    lines = ["", f"{'free flight, frame to frame':<28} {'mean':>10} {'sd':>10}   the paper's table 3"]
    paper = iter(PAPER)
    for name, unit, values, factor in (
        ("velocity", "m/s", flight.velocity_m_s, 1.0),
        ("force", "kN", flight.force_N, 1e-3),
    ):
        mean, std = free_flight.spread(values)
        for k, axis in enumerate("xy"):
            label = f"{name} {axis} ({unit})"
            lines.append(f"{label:<28} {factor * mean[k]:>10.4g} {factor * std[k]:>10.3g}   {next(paper)}")
    mean, std = free_flight.spread(flight.spin_rad_s)
    lines += [f"{f'spin {a} (rad/s)':<28} {mean[k]:>10.4g} {std[k]:>10.3g}" for k, a in enumerate("xyz")]
    return lines


def _of_uncertainty(plan: Plan) -> list[str]:
    sd, plain, found = np.sqrt(np.diagonal(plan.covariance)), plan.differences, plan.rehearsal
    steps = zip(("dx", "dy", "wx", "wy", "wz"), (*sd[:2], *np.degrees(sd[2:])), strict=True)
    shown = [f"{name} {value:.3g} {'px' if name[0] == 'd' else 'deg'}" for name, value in steps]
    lines = ["", "sd of a step from frame to frame: " + ", ".join(shown)]
    lines.append(f"{'sd at a frame':<32} {'differences':>12} {'smoother: flight':>18} {'contact':>10}")
    blank = np.full((2, 3), np.nan)
    velocity, force, spin = (blank,) * 3 if found is None else (found.velocity_m_s, found.force_N, found.spin_rad_s)
    # Differences in the image's axes, the smoother along and across the flight.
    rows = [(f"velocity {a} / {b} (m/s)", plain.velocity_m_s[k], *velocity[:, k]) for k, (a, b) in enumerate(AXES)]
    rows += [(f"spin {a} (rad/s)", plain.spin_rad_s[k], *spin[:, k]) for k, a in enumerate("xyz")]
    kilo = 1e-3 * plain.force_N, 1e-3 * force
    rows += [(f"force {a} / {b} (kN)", kilo[0][k], *kilo[1][:, k]) for k, (a, b) in reversed([*enumerate(AXES)])]
    if found is not None:
        rows.append(("its true error in rehearsal (kN)", np.nan, *(1e-3 * found.force_error_N)))
    widths = (12, 18, 10)
    for name, *values in rows:
        cells = " ".join(f"{_cell(value):>{width}}" for value, width in zip(values, widths, strict=True))
        lines.append(f"{name:<32} {cells}".rstrip())
    if found is not None and found.is_between_frames:
        lines.append("contact: no numbers, as it falls between two frames")
    return lines


def _cell(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.3g}"


def _of_modes(plan: Plan) -> list[str]:
    lines = ["", " ".join(f"{name:>{width}}" for name, width in zip(HEAD, WIDTHS, strict=True))]
    chosen = camera_modes.best(plan.verdicts)
    for verdict in plan.verdicts:
        mode, setup, found = verdict.mode, verdict.setup, verdict.rehearsal
        values = (
            f"{mode.width_px}",
            f"{mode.height_px}",
            f"{mode.fps_max:g}",
            "" if setup is None else f"{setup.radius_px:.1f}",
            f"{verdict.frames_in_view}",
            "" if found is None else f"{found.velocity_m_s[0, 0]:.3g}",
            "" if verdict.reason else f"{1e-3 * verdict.error_N:.3g}",
        )
        cells = " ".join(f"{value:>{width}}" for value, width in zip(values, WIDTHS, strict=True))
        lines.append(f"{cells}  {verdict.reason or ('best' if verdict is chosen else '')}".rstrip())
    return lines
