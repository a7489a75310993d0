"""A plan in words and numbers: advice in sentences, text for the terminal, and the table for ``plan.json``."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from torchsphere.planning.expected import MAX_BLUR_PX, MAX_NOISE_ONLY_DEG
from torchsphere.planning.free_flight import Flight, mean_and_sd
from torchsphere.planning.plan import MIN_CONTACT_FRAMES, MIN_FRAMES_IN_VIEW, Assessment, Plan, best
from torchsphere.planning.rehearsal import Rehearsal
from torchsphere.runtime.setting_names import as_options
from torchsphere.settings.limits import unit_warnings

#: Error of the force as a share of its peak in the paper (table 3).
PAPER_SHARE = 0.015

#: Relative difference of two modes' errors below which they are equally good (docs/constants.toml).
EQUAL_SHARE = 0.15

#: Axes of the image, and of the flight.
AXES = (("x", "along"), ("y", "across"))

#: Heading and row of the modes' table.
MODE_HEADING = ("width", "height", "frames/s", "R (px)", "in view", "sd v (m/s)", "force err (kN)")
MODE_ROW = "{:>6} {:>6} {:>9} {:>7} {:>8} {:>11} {:>15}"

#: Mean and standard deviation of table 3: m/s, m/s, kN, kN.
PAPER = ("72.32 +- 0.36", "0.72 +- 0.27", "0.07 +- 0.90", "0.02 +- 0.64")


def cautions(plan: Plan) -> tuple[str, ...]:
    """Sentences on values that may be in another unit, or that come from a motion other than free flight."""
    setup = plan.setup
    units = unit_warnings(setup.diameter_mm, setup.mass_g, f"`diameter_mm` = {setup.diameter_mm:g}")
    return tuple(map(as_options, (*units, *(plan.flight.warnings if plan.flight else ()))))


def remarks(plan: Plan) -> list[str]:
    """Sentences on changes of the test, the most important first: the first sentence is the advice."""
    setup, sentences = plan.setup, list(cautions(plan))
    if setup.blur_px > MAX_BLUR_PX:
        exposure = MAX_BLUR_PX * setup.m_per_px / setup.speed_m_s
        sentences.append(
            f"Shorten the exposure to {1e6 * exposure:.3g} us or less: the motion blur of {setup.blur_px:.1f} px is "
            f"above the paper's {MAX_BLUR_PX:g} px."
        )
    sentences += _mode_remarks(plan)
    in_view = None if plan.width_px is None else setup.frames_in_view(plan.width_px)
    if in_view is not None and in_view < MIN_FRAMES_IN_VIEW:
        sentences.append(
            f"Film faster, or a wider field: only {in_view} images show the whole ball, and {MIN_FRAMES_IN_VIEW} are "
            "needed."
        )
    sentences += _contact_remarks(plan)
    if setup.turn_deg > MAX_NOISE_ONLY_DEG:
        sentences.append(
            f"Film faster, or rely on the map of the ball: a turn of {setup.turn_deg:.1f} deg per frame adds errors to "
            "steps from pairs that are not in these figures."
        )
    if plan.rehearsal is not None and not plan.rehearsal.found:
        sentences.append("The contact does not stand out from the noise: film a larger or better lit ball.")
    return [*sentences, *_precision_remarks(plan)]


def _mode_remarks(plan: Plan) -> list[str]:
    """The best of the camera's modes, and those that are equally good."""
    if not plan.assessments:
        return []
    chosen = best(plan.assessments)
    if chosen is None:
        return ["None of the camera's modes resolves the force of this test; see the table for why."]
    equal = ", ".join(
        f"{other.mode.width_px} x {other.mode.height_px} at {other.mode.fps_max:g}"
        for other in plan.assessments
        if other is not chosen and other.error_N < (1 + EQUAL_SHARE) * chosen.error_N
    )
    mode = chosen.mode
    return [
        f"Film with {mode.width_px} x {mode.height_px} px at {mode.fps_max:g} frames/s (ball of "
        f"{chosen.setup.radius_px:.0f} px radius): of the camera's modes it has the least error of the force in "
        f"contact, {1e-3 * chosen.error_N:.2g} kN"
        + (f" ({equal} frames/s is within {100 * EQUAL_SHARE:g} % of that)." if equal else ".")
    ]


def _contact_remarks(plan: Plan) -> list[str]:
    """Whether the contact is too short for the frame rate."""
    setup, target = plan.setup, plan.target
    frames = target.contact_s * setup.frame_rate
    if frames >= MIN_CONTACT_FRAMES:
        return []
    length = f"lasts {frames:.1f} frames"
    if plan.rehearsal is not None and plan.rehearsal.is_between_frames:
        length = f"falls between two frames, {1e6 / setup.frame_rate:.3g} us apart, so that none shows its force"
    # Rounded up to hundreds; the inner rounding ignores the last digits of the quotient.
    rate = 100 * math.ceil(round(MIN_CONTACT_FRAMES / target.contact_s / 100, 6))
    return [
        f"Film at {rate} frames/s or more to resolve the force: a contact of {1e6 * target.contact_s:.3g} us "
        f"({target.origin}) {length}; impulse and speeds are measured all the same."
    ]


def _precision_remarks(plan: Plan) -> list[str]:
    """The precision of the force."""
    rehearsal = plan.rehearsal
    if rehearsal is None:
        return ["The contact lasts too many frames for the rehearsal; smooth or film at a lower rate."]
    if not rehearsal.found or rehearsal.contact_frames < MIN_CONTACT_FRAMES:
        return []
    share = rehearsal.typical_force_error_N[1] / rehearsal.peak_N
    is_good = share <= PAPER_SHARE
    return [
        f"The set-up {'suits' if is_good else 'does not suit'} the test: the force in contact is known to "
        f"{100 * share:.2g} % of its peak of {1e-3 * rehearsal.peak_N:.3g} kN (the paper's: {100 * PAPER_SHARE:g} %)"
        + ("." if is_good else "; a larger image of the ball, a sharper pattern or less noise helps.")
    ]


def text(plan: Plan) -> str:
    """Test, uncertainty, modes and advice, as lines for the terminal."""
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
            measured = f"{mean[k]:>10.4g} {sd[k]:>10.3g}" if np.isfinite(sd[k]) else f"{'not measured':>21}"
            lines.append(f"{f'{name} {axis} ({unit})':<28} {measured}   {next(paper)}")
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
        random, common = rehearsal.force_parts_N.random, rehearsal.force_parts_N.common
        rows.append(("  part of the single frames", np.nan, *(1e-3 * random[:, 0])))
        rows.append(("  part common to all frames", np.nan, *(1e-3 * common[:, 0])))
        rows.append((f"  true error, rms of {rehearsal.recordings}", np.nan, *(1e-3 * rehearsal.force_error_N)))
        rows.append(("  true error, median", np.nan, *(1e-3 * rehearsal.typical_force_error_N)))
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


def as_table(plan: Plan) -> dict[str, Any]:
    """The plan as numbers and words, for ``plan.json``."""
    setup, rehearsal, flight = plan.setup, plan.rehearsal, plan.flight
    advice, *others = remarks(plan)
    return {
        "advice": advice,
        "remarks": others,
        "source": plan.origin,
        "setup": dataclasses.asdict(setup),
        "radius_px": setup.radius_px,
        "increment_px_rad": setup.increment,
        "turn_deg_per_frame": setup.turn_deg,
        "blur_px": setup.blur_px,
        "blur_limit_px": MAX_BLUR_PX,
        "frames_in_view": None if plan.width_px is None else setup.frames_in_view(plan.width_px),
        "increment_covariance_px_rad": plan.covariance,
        "increment_sd_px_rad": np.sqrt(np.diagonal(plan.covariance)),
        "sd_by_differences": dataclasses.asdict(plan.differences),
        "target": dataclasses.asdict(plan.target),
        "rehearsal": None if rehearsal is None else _rehearsal_table(rehearsal),
        "cost_of_blur_px": plan.cost_of_blur,
        "modes": [_mode_table(assessment) for assessment in plan.assessments],
        "free_flight": None if flight is None else _flight_table(flight),
    }


def _rehearsal_table(rehearsal: Rehearsal) -> dict[str, Any]:
    curves = ("time_s", "true_force_N", "force_along_N", "sd_force_along_N")
    numbers = {key: value for key, value in dataclasses.asdict(rehearsal).items() if key not in curves}
    about = "flight, contact; columns along and across the flight, spin x, y, z; the squares of both parts add up"
    return {"rows": about} | numbers


def _mode_table(assessment: Assessment) -> dict[str, Any]:
    plain, rehearsal = assessment.differences, assessment.rehearsal
    return dataclasses.asdict(assessment.mode) | {
        "reason_against": assessment.reason,
        "px_per_mm": assessment.setup.px_per_mm,
        "frames_in_view": assessment.frames_in_view,
        "sd_by_differences": None if plain is None else dataclasses.asdict(plain),
        "force_error_in_contact_N": assessment.error_N,
        "sd_force_in_contact_N": None if rehearsal is None else rehearsal.force_N[1, 0],
        "sd_velocity_in_flight_m_s": None if rehearsal is None else rehearsal.velocity_m_s[0, 0],
    }


def _flight_table(flight: Flight) -> dict[str, Any]:
    values = {"velocity_m_s": flight.velocity_m_s, "force_N": flight.force_N, "spin_rad_s": flight.spin_rad_s}
    table: dict[str, Any] = {"increments": int(np.isfinite(flight.increment).all(1).sum())}
    for name, value in values.items():
        mean, sd = mean_and_sd(value)
        table[name] = {"mean": mean, "std": sd}
    return table | {"stated_sd_increment_px_rad": flight.stated}
