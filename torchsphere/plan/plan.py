"""The a priori analysis of a test, as the paper asks for it (sections 3 and 5.2): all of it together, and advice."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.plan.camera_modes import LEAST_CONTACT_FRAMES, LEAST_IN_VIEW, Look, Mode, Verdict, best, judge
from torchsphere.plan.example_image import Example, blurred, rescaled
from torchsphere.plan.expected import (
    MOST_BLUR_PX,
    NOISE_ONLY_UP_TO_DEG,
    Differences,
    Setup,
    differences,
    increment_covariance,
)
from torchsphere.plan.free_flight import Flight, spread
from torchsphere.plan.rehearsal import Rehearsal, Target, rehearse

#: Widths of the motion blur whose cost is shown, px: the paper's figure 3 goes from 2 to 20.
BLURS_PX = (0.0, 1.0, 2.0, 3.5, 5.0, 7.0, 10.0, 14.0, 20.0)

#: Share of the peak force that its error may be: 1.5 % is the paper's (table 3).
PAPER_SHARE = 0.015

#: Modes whose errors differ by less are as good: the rehearsal itself is not known better.
TIE = 0.15

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Plan:
    """What to expect of a test.

    Attributes
    ----------
    setup : Setup
    origin : str
        What the uncertainty was taken from.
    target : Target
    covariance : ndarray
        Of an increment (5, 5), px and rad.
    differences : Differences
        Standard deviations without smoothing.
    rehearsal : Rehearsal or None
        With the smoother; None where the contact is too long for it.
    width_px : int or None
        Of the image.
    cost_of_blur : ndarray
        (m, 2): width of the blur, and standard deviation of the increment along the flight, px; empty for a recording.
    seen : Example or None
        The example as the test will show it.
    verdicts : tuple of Verdict
        The camera's modes.
    flight : Flight or None
        The recording that the uncertainty was measured on.
    """

    setup: Setup
    origin: str
    target: Target
    covariance: Array
    differences: Differences
    rehearsal: Rehearsal | None
    width_px: int | None
    cost_of_blur: Array
    seen: Example | None
    verdicts: tuple[Verdict, ...] = ()
    flight: Flight | None = None


def from_images(
    look: Look,
    setup: Setup,
    target: Target,
    *,
    width_px: int | None = None,
    modes: Sequence[Mode] = (),
    field_mm: float | None = None,
    is_blurred: bool = False,
    progress: Progress | None = None,
) -> Plan:
    """Plan a test from what the ball looks like.

    Parameters
    ----------
    look : callable
        Examples of the ball at a radius in px.
    setup : Setup
    target : Target
    width_px : int, optional
        Of the image, for the frames in view.
    modes : sequence of Mode
        Of the camera, to choose from.
    field_mm : float, optional
        Field of view that all modes share; by default they share the px per mm.
    is_blurred : bool
        The examples show the test's motion blur.
    progress : callable, optional
        Called as ``progress(done, total)``.

    Raises
    ------
    ValueError
        If the texture does not carry the modes.
    """
    total = 2 + len(modes)
    tell = progress or (lambda done, total: None)
    examples = look(setup.radius_px)
    covariance = increment_covariance(examples, setup, is_blurred=is_blurred)
    tell(1, total)
    seen = rescaled(examples[0], setup.radius_px)
    made = _planned(setup, target, covariance, examples[0].origin)
    tell(2, total)
    verdicts = []
    for done, mode in enumerate(modes, 3):
        verdicts.append(judge(mode, look, setup, target, field_mm=field_mm, is_blurred=is_blurred))
        tell(done, total)
    return dataclasses.replace(
        made,
        width_px=width_px,
        cost_of_blur=np.zeros((0, 2)) if is_blurred else _cost_of_blur(examples[0], setup),
        seen=seen if is_blurred else blurred(seen, setup.blur),
        verdicts=tuple(verdicts),
    )


def from_flight(flight: Flight, target: Target, width_px: int | None = None) -> Plan:
    """Plan a test from a recording of a free flight by the same set-up."""
    made = _planned(flight.setup, target, flight.covariance, flight.origin)
    return dataclasses.replace(made, width_px=width_px, flight=flight)


def _planned(setup: Setup, target: Target, covariance: Array, origin: str) -> Plan:
    plain = differences(covariance, setup.frame_rate, setup.m_per_px, setup.mass_kg)
    try:
        rehearsal = rehearse(covariance, setup, target)
    except ValueError:
        rehearsal = None
    return Plan(setup, origin, target, covariance, plain, rehearsal, None, np.zeros((0, 2)), None)


def _cost_of_blur(example: Example, setup: Setup) -> Array:
    """Blur and standard deviation of the increment along the flight (m, 2), px, up to what the interval allows."""
    per_second = setup.speed_m_s / setup.m_per_px
    angle = math.radians(setup.direction_deg)
    along = np.array([math.cos(angle), math.sin(angle)])
    cost = []
    for width in BLURS_PX:
        exposure = max(width, 1e-6) / per_second
        if exposure * setup.frame_rate > 1:
            break
        try:
            covariance = increment_covariance([example], dataclasses.replace(setup, shutter_s=exposure))
        except ValueError:
            break
        cost.append((width, math.sqrt(along @ covariance[:2, :2] @ along)))
    return np.array(cost).reshape(-1, 2)


def cautions(plan: Plan) -> tuple[str, ...]:
    """What makes the plan's numbers others than they are taken for."""
    return plan.flight.warnings if plan.flight else ()


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


def as_table(plan: Plan) -> dict[str, Any]:
    """All of the plan as numbers and words, for ``plan.json``."""
    setup = plan.setup
    found, flight = plan.rehearsal, plan.flight
    return {
        "advice": remarks(plan)[0],
        "remarks": remarks(plan)[1:],
        "source": plan.origin,
        "setup": dataclasses.asdict(setup),
        "radius_px": setup.radius_px,
        "increment_px_rad": setup.increment,
        "turn_deg_per_frame": setup.turn_deg,
        "blur_px": setup.blur_px,
        "blur_limit_px": MOST_BLUR_PX,
        "frames_in_view": None if plan.width_px is None else setup.frames_in_view(plan.width_px),
        "increment_covariance_px_rad": plan.covariance,
        "increment_sd_px_rad": np.sqrt(np.diagonal(plan.covariance)),
        "sd_by_differences": dataclasses.asdict(plan.differences),
        "target": dataclasses.asdict(plan.target),
        "rehearsal": None if found is None else _numbers_of(found),
        "cost_of_blur_px": plan.cost_of_blur,
        "modes": [_mode_table(verdict) for verdict in plan.verdicts],
        "free_flight": None if flight is None else _flight_table(flight),
    }


def _numbers_of(found: Rehearsal) -> dict[str, Any]:
    curves = ("time_s", "true_force_N", "force_along_N", "sd_force_along_N")
    numbers = {key: value for key, value in dataclasses.asdict(found).items() if key not in curves}
    return {"rows": "flight, contact; columns along and across the flight, spin x, y, z"} | numbers


def _mode_table(verdict: Verdict) -> dict[str, Any]:
    setup, found = verdict.setup, verdict.rehearsal
    return dataclasses.asdict(verdict.mode) | {
        "reason_against": verdict.reason,
        "px_per_mm": None if setup is None else setup.px_per_mm,
        "frames_in_view": verdict.frames_in_view,
        "sd_by_differences": None if verdict.differences is None else dataclasses.asdict(verdict.differences),
        "force_error_in_contact_N": verdict.error_N,
        "sd_force_in_contact_N": None if found is None else found.force_N[1, 0],
        "sd_velocity_in_flight_m_s": None if found is None else found.velocity_m_s[0, 0],
    }


def _flight_table(flight: Flight) -> dict[str, Any]:
    values = {"velocity_m_s": flight.velocity_m_s, "force_N": flight.force_N, "spin_rad_s": flight.spin_rad_s}
    table: dict[str, Any] = {"increments": int(np.isfinite(flight.increment).all(1).sum())}
    for name, value in values.items():
        mean, std = spread(value)
        table[name] = {"mean": mean, "std": std}
    return table | {"stated_sd_increment_px_rad": flight.stated}
