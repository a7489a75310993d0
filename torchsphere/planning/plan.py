"""The a priori analysis of a test, as in sections 3 and 5.2 of the paper: all parts together."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from torchsphere.planning.camera_modes import Assessment, ExampleSource, Mode, assess
from torchsphere.planning.example_image import Example, blurred, rescaled
from torchsphere.planning.expected import Differences, Setup, differences, increment_covariance
from torchsphere.planning.free_flight import Flight
from torchsphere.planning.rehearsal import Rehearsal, Target, rehearse

#: Lengths of the motion blur whose cost is shown, px: the paper's figure 3 goes from 2 to 20.
BLURS_PX = (0.0, 1.0, 2.0, 3.5, 5.0, 7.0, 10.0, 14.0, 20.0)

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Plan:
    """Expected precision of a test."""

    setup: Setup
    origin: str  # source of the uncertainty, in words
    target: Target
    covariance: Array  # covariance of an increment (5, 5), px and rad
    differences: Differences  # standard deviations without smoothing
    rehearsal: Rehearsal | None  # simulated measurement with the smoother; None if the contact is too long for it
    width_px: int | None = None
    # Length of the blur and standard deviation of the increment along the flight (m, 2), px; empty for a recording.
    cost_of_blur: Array = field(default_factory=lambda: np.zeros((0, 2)))
    example: Example | None = None  # as the test will show it
    assessments: tuple[Assessment, ...] = ()  # of the camera's modes
    flight: Flight | None = None  # the recording on which the uncertainty was measured


def from_images(
    source: ExampleSource,
    setup: Setup,
    target: Target,
    *,
    width_px: int | None = None,
    modes: Sequence[Mode] = (),
    field_mm: float | None = None,
    is_blurred: bool = False,
    progress: Progress | None = None,
) -> Plan:
    """Plan a test from example images of the ball, with the image's width for the frames in view.

    The other settings are those of `assess`; ``progress`` is called with the finished and the total number of steps.
    Raises ValueError if the texture does not determine all modes of motion.
    """
    total = 2 + len(modes)
    report = progress or (lambda done, total: None)
    examples = source(setup.radius_px)
    covariance = increment_covariance(examples, setup, is_blurred=is_blurred)
    report(1, total)
    example = rescaled(examples[0], setup.radius_px)
    plan = _plan(setup, target, covariance, examples[0].origin)
    report(2, total)
    assessments = []
    for done, mode in enumerate(modes, 3):
        assessments.append(assess(mode, source, setup, target, field_mm=field_mm, is_blurred=is_blurred))
        report(done, total)
    plan = dataclasses.replace(plan, width_px=width_px, example=example, assessments=tuple(assessments))
    if is_blurred:
        return plan
    cost = _cost_of_blur(examples[0], setup)
    return dataclasses.replace(plan, cost_of_blur=cost, example=blurred(example, setup.blur))


def from_flight(flight: Flight, target: Target, width_px: int | None = None) -> Plan:
    """Plan a test from a recording of a free flight by the same set-up."""
    plan = _plan(flight.setup, target, flight.covariance, flight.origin)
    return dataclasses.replace(plan, width_px=width_px, flight=flight)


def _plan(setup: Setup, target: Target, covariance: Array, origin: str) -> Plan:
    """The parts of a plan that follow from the covariance of an increment."""
    plain = differences(covariance, setup.frame_rate, setup.m_per_px, setup.mass_kg)
    try:
        rehearsal = rehearse(covariance, setup, target)
    except ValueError:
        rehearsal = None
    return Plan(setup, origin, target, covariance, plain, rehearsal)


def _cost_of_blur(example: Example, setup: Setup) -> Array:
    """`Plan.cost_of_blur` for exposures up to the frame interval."""
    per_second = setup.speed_m_s / setup.m_per_px
    angle = math.radians(setup.direction_deg)
    along = np.array([math.cos(angle), math.sin(angle)])
    cost = []
    for blur in BLURS_PX:
        exposure = max(blur, 1e-6) / per_second
        if exposure * setup.frame_rate > 1:
            break
        try:
            covariance = increment_covariance([example], dataclasses.replace(setup, shutter_s=exposure))
        except ValueError:
            break
        cost.append((blur, math.sqrt(along @ covariance[:2, :2] @ along)))
    return np.array(cost).reshape(-1, 2)
