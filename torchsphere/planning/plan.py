"""The a priori analysis of a test, as the paper asks for it (sections 3 and 5.2): all of it together."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchsphere.planning.camera_modes import Look, Mode, Verdict, judge
from torchsphere.planning.example_image import Example, blurred, rescaled
from torchsphere.planning.expected import Differences, Setup, differences, increment_covariance
from torchsphere.planning.free_flight import Flight
from torchsphere.planning.rehearsal import Rehearsal, Target, rehearse

#: Widths of the motion blur whose cost is shown, px: the paper's figure 3 goes from 2 to 20.
BLURS_PX = (0.0, 1.0, 2.0, 3.5, 5.0, 7.0, 10.0, 14.0, 20.0)

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
