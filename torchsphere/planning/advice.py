"""What to mind and what to change about a test, by its plan: in sentences."""

from __future__ import annotations

import math

from torchsphere.planning.camera_modes import LEAST_CONTACT_FRAMES, LEAST_IN_VIEW, Verdict, best
from torchsphere.planning.expected import MOST_BLUR_PX, NOISE_ONLY_UP_TO_DEG
from torchsphere.planning.plan import Plan
from torchsphere.settings.limits import implausible

#: Share of the peak force that its error may be: 1.5 % is the paper's (table 3).
PAPER_SHARE = 0.015

#: Modes whose errors differ by less are as good: the rehearsal itself is not known better.
TIE = 0.15


def cautions(plan: Plan) -> tuple[str, ...]:
    """What makes the plan's numbers others than they are taken for."""
    setup = plan.setup
    odd = implausible(setup.diameter_mm, setup.mass_g, f"--diameter-mm {setup.diameter_mm:g}")
    return (*odd, *(plan.flight.warnings if plan.flight else ()))


def remarks(plan: Plan) -> list[str]:
    """What to mind or to change, the weightiest first; never empty. The first is the advice."""
    setup, found = plan.setup, plan.rehearsal
    # Where the numbers are not what they are taken for, all the rest counts less.
    said = list(cautions(plan))
    if setup.blur_px > MOST_BLUR_PX:
        exposure = MOST_BLUR_PX * setup.m_per_px / setup.speed_m_s
        said.append(
            f"Shorten the exposure to {1e6 * exposure:.3g} us or less: the motion blur of {setup.blur_px:.1f} px is "
            f"above the paper's {MOST_BLUR_PX:g} px."
        )
    said += _about_modes(plan)
    in_view = None if plan.width_px is None else setup.frames_in_view(plan.width_px)
    if in_view is not None and in_view < LEAST_IN_VIEW:
        said.append(
            f"Film faster, or a wider field: only {in_view} images show the whole ball, and {LEAST_IN_VIEW} are needed."
        )
    frames = plan.target.contact_s * setup.frame_rate
    if frames < LEAST_CONTACT_FRAMES:
        # Rounded up to hundreds, but not for the last digits of a quotient.
        rate = 100 * math.ceil(round(LEAST_CONTACT_FRAMES / plan.target.contact_s / 100, 6))
        said.append(
            f"Film at {rate} frames/s or more to resolve the force: a contact of {1e6 * plan.target.contact_s:.3g} us "
            f"({plan.target.origin}) {_how_short(plan, frames)}; impulse and speeds are measured all the same."
        )
    if setup.turn_deg > NOISE_ONLY_UP_TO_DEG:
        said.append(
            f"Film faster, or track with --map on: a turn of {setup.turn_deg:.1f} deg per frame adds errors that are "
            "not in these figures."
        )
    if found is not None and not found.found:
        said.append("The contact does not stand out from the noise: film a larger or better lit ball.")
    return [*said, *_verdict(plan)]


def _how_short(plan: Plan, frames: float) -> str:
    if plan.rehearsal is None or not plan.rehearsal.is_between_frames:
        return f"lasts {frames:.1f} frames"
    return f"falls between two frames, {1e6 / plan.setup.frame_rate:.3g} us apart, so that none shows its force"


def _about_modes(plan: Plan) -> list[str]:
    if not plan.verdicts:
        return []
    chosen = best(plan.verdicts)
    if chosen is None:
        return ["None of the camera's modes resolves the force of this test; see the table for why."]
    assert chosen.setup is not None  # a mode of use has been tried
    mode = chosen.mode
    return [
        f"Film with {mode.width_px} x {mode.height_px} px at {mode.fps_max:g} frames/s (ball of "
        f"{chosen.setup.radius_px:.0f} px radius): of the camera's modes it has the least error of the force in "
        f"contact, {1e-3 * chosen.error_N:.2g} kN{_as_good(plan, chosen)}."
    ]


def _as_good(plan: Plan, chosen: Verdict) -> str:
    """The modes that are as good, in words."""
    others = [
        f"{v.mode.width_px} x {v.mode.height_px} at {v.mode.fps_max:g}"
        for v in plan.verdicts
        if v is not chosen and v.error_N < (1 + TIE) * chosen.error_N
    ]
    return f" ({', '.join(others)} frames/s is within {100 * TIE:g} % of that)" if others else ""


def _verdict(plan: Plan) -> list[str]:
    """How good the force will be."""
    found = plan.rehearsal
    if found is None:
        return ["The contact lasts too many frames for the rehearsal; smooth or film at a lower rate."]
    if not found.found or found.contact_frames < LEAST_CONTACT_FRAMES:
        return []
    share = max(found.force_N[1, 0], found.force_error_N[1]) / found.peak_N
    good = share <= PAPER_SHARE
    return [
        f"The set-up {'suits' if good else 'does not suit'} the test: the force in contact is known to "
        f"{100 * share:.2g} % of its peak of {1e-3 * found.peak_N:.3g} kN (the paper's: {100 * PAPER_SHARE:g} %)"
        + ("." if good else "; a larger image of the ball, a sharper pattern or less noise helps.")
    ]
