"""Advice on a test by its plan, in sentences."""

from __future__ import annotations

import math

from torchsphere.planning.camera_modes import MIN_CONTACT_FRAMES, MIN_FRAMES_IN_VIEW, best
from torchsphere.planning.expected import MAX_BLUR_PX, MAX_NOISE_ONLY_DEG
from torchsphere.planning.plan import Plan
from torchsphere.settings.limits import implausible

#: Error of the force as a share of its peak in the paper (table 3).
PAPER_SHARE = 0.015

#: Relative difference of two modes' errors below which they are equally good (docs/constants.md).
EQUAL_SHARE = 0.15


def cautions(plan: Plan) -> tuple[str, ...]:
    """Sentences on values that may be in another unit, or measured on a motion that is no free flight."""
    setup = plan.setup
    units = implausible(setup.diameter_mm, setup.mass_g, f"--diameter-mm {setup.diameter_mm:g}")
    return (*units, *(plan.flight.warnings if plan.flight else ()))


def remarks(plan: Plan) -> list[str]:
    """Sentences on what to change, the weightiest first: the first one is the advice. Never empty."""
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
            f"Film faster, or track with --map on: a turn of {setup.turn_deg:.1f} deg per frame adds errors that are "
            "not in these figures."
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
    share = max(rehearsal.force_N[1, 0], rehearsal.force_error_N[1]) / rehearsal.peak_N
    is_good = share <= PAPER_SHARE
    return [
        f"The set-up {'suits' if is_good else 'does not suit'} the test: the force in contact is known to "
        f"{100 * share:.2g} % of its peak of {1e-3 * rehearsal.peak_N:.3g} kN (the paper's: {100 * PAPER_SHARE:g} %)"
        + ("." if is_good else "; a larger image of the ball, a sharper pattern or less noise helps.")
    ]
