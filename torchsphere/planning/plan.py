"""The a priori analysis of a test (sections 3 and 5.2 of the paper), with the camera's modes compared.

A mode of a camera is a compromise of resolution against frame rate (section 3.2).
"""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from torchsphere.planning.example_image import Example, blurred, rescaled
from torchsphere.planning.expected import Differences, Setup, differences, increment_covariance, require_noise
from torchsphere.planning.free_flight import Flight
from torchsphere.planning.rehearsal import Rehearsal, Target, rehearse
from torchsphere.runtime import steps
from torchsphere.runtime.arrays import Array

#: Fewest images during the contact that resolve its force (docs/constants.toml).
MIN_CONTACT_FRAMES = 5.0

#: Fewest images of the whole ball in flight before the target (docs/constants.toml).
MIN_FRAMES_IN_VIEW = 4

#: Least radius of a ball that is measured reliably, px (docs/constants.toml).
MIN_RADIUS_PX = 10.0

#: Lengths of the motion blur whose cost is shown, px: the paper's figure 3 goes from 2 to 20.
BLURS_PX = (0.0, 1.0, 2.0, 3.5, 5.0, 7.0, 10.0, 14.0, 20.0)

MODE_COLUMNS = ("width_px", "height_px", "fps_max")

#: Gives examples of the ball at a radius in px.
ExampleSource = Callable[[float], Sequence[Example]]
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Mode:
    """A mode of a camera: size of its images, px, and highest frame rate, 1/s."""

    width_px: int
    height_px: int
    fps_max: float


@dataclass(frozen=True)
class Assessment:
    """Expected precision of a test with a mode."""

    mode: Mode
    setup: Setup  # the test with this mode
    frames_in_view: int
    reason: str  # why the mode is of no use, in words; empty if it is of use
    differences: Differences | None = None
    rehearsal: Rehearsal | None = None

    @property
    def error_N(self) -> float:  # noqa: N802  (N is newton)
        """Typical true error of the force in contact in the rehearsal; infinite if the mode is of no use."""
        if self.rehearsal is None or self.reason:
            return math.inf
        return float(self.rehearsal.typical_force_error_N[1])


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
    steps.tell("computing the uncertainty of a step on examples of the ball")
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
    steps.tell("computing the cost of motion blur")
    cost = _cost_of_blur(examples[0], setup)
    return dataclasses.replace(plan, cost_of_blur=cost, example=blurred(example, setup.blur))


def from_flight(flight: Flight, target: Target, width_px: int | None = None) -> Plan:
    """Plan a test from a recording of a free flight by the same set-up; raises ValueError if it does not scatter."""
    require_noise(flight.covariance, flight.setup.radius_px, flight.origin)
    plan = _plan(flight.setup, target, flight.covariance, flight.origin)
    return dataclasses.replace(plan, width_px=width_px, flight=flight)


def _plan(setup: Setup, target: Target, covariance: Array, origin: str) -> Plan:
    """The parts of a plan that follow from the covariance of an increment."""
    plain = differences(covariance, setup.frame_rate, setup.m_per_px, setup.mass_kg)
    steps.tell("rehearsing the measurement of an impact")
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


def read_modes(path: Path) -> list[Mode]:
    """Modes from a CSV table; raises ValueError, with the number of an invalid line, or OSError if it is unreadable."""
    expected = ", ".join(MODE_COLUMNS)
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.DictReader(stream, skipinitialspace=True)
            missing = [name for name in MODE_COLUMNS if name not in (reader.fieldnames or ())]
            if missing:
                raise ValueError(f"{path}: has no column {', '.join(missing)}; expected a CSV with {expected}")
            modes = [_mode(path, reader.line_num, row) for row in reader]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path}: is no CSV table in UTF-8 ({error}); expected the columns {expected}") from error
    if not modes:
        raise ValueError(f"{path}: lists no mode; expected a line per mode with {expected}")
    return modes


def _mode(path: Path, line: int, row: dict[str, str]) -> Mode:
    try:
        width, height, rate = int(row["width_px"]), int(row["height_px"]), float(row["fps_max"])
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}, line {line}: expected two whole numbers and a frame rate") from error
    if width < 1 or height < 1 or not (math.isfinite(rate) and rate > 0):
        raise ValueError(f"{path}, line {line}: expected sizes of 1 px or more and a positive frame rate")
    return Mode(width, height, rate)


def assess(
    mode: Mode,
    examples: ExampleSource,
    setup: Setup,
    target: Target,
    *,
    field_mm: float | None = None,
    is_blurred: bool = False,
) -> Assessment:
    """Expected precision of the test with a mode at its highest frame rate.

    Frame rate and scale of ``setup`` become those of the mode; an exposure longer than the frame interval is cut.
    ``field_mm`` is the width of the field of view if the optics keep it, else they keep the px per mm. ``is_blurred``
    says that the examples show the test's motion blur. Raises ValueError as `increment_covariance`.
    """
    scale = setup.px_per_mm if field_mm is None else mode.width_px / field_mm
    shutter = min(math.inf if setup.shutter_s is None else setup.shutter_s, 1 / mode.fps_max)
    setup = dataclasses.replace(setup, frame_rate=mode.fps_max, px_per_mm=scale, shutter_s=shutter)
    in_view = setup.frames_in_view(mode.width_px)
    reason = _misfit(mode, setup.radius_px, in_view)
    if reason:
        return Assessment(mode, setup, in_view, reason)
    covariance = increment_covariance(examples(setup.radius_px), setup, is_blurred=is_blurred)
    plain = differences(covariance, setup.frame_rate, setup.m_per_px, setup.mass_kg)
    frames = target.contact_s * setup.frame_rate
    try:
        rehearsal = rehearse(covariance, setup, target)
    except ValueError:
        return Assessment(mode, setup, in_view, f"{frames:.0f} images during the contact are too many", plain)
    if frames < MIN_CONTACT_FRAMES:
        reason = f"{frames:.1f} images during the contact only"
    elif not rehearsal.found:
        reason = "the contact does not stand out from the noise"
    return Assessment(mode, setup, in_view, reason, plain, rehearsal)


def _misfit(mode: Mode, radius_px: float, frames_in_view: int) -> str:
    """Reason why the images of a mode cannot show the ball; empty if they can."""
    if radius_px < MIN_RADIUS_PX:
        return f"the ball's radius is {radius_px:.1f} px only"
    if 2 * radius_px > min(mode.width_px, mode.height_px):
        return f"the ball of {2 * radius_px:.0f} px does not fit"
    return f"{frames_in_view} images in view only" if frames_in_view < MIN_FRAMES_IN_VIEW else ""


def best(assessments: Sequence[Assessment]) -> Assessment | None:
    """The mode with the least error of the force in contact; None if no mode is of use."""
    usable = [assessment for assessment in assessments if math.isfinite(assessment.error_N)]
    return min(usable, key=lambda assessment: assessment.error_N, default=None)
