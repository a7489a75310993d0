"""Resolution against frame rate (section 3.2 of the paper), over the modes of a camera."""

from __future__ import annotations

import csv
import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from torchsphere.planning.example_image import Example
from torchsphere.planning.expected import Differences, Setup, differences, increment_covariance
from torchsphere.planning.rehearsal import Rehearsal, Target, rehearse

COLUMNS = ("width_px", "height_px", "fps_max")

#: Fewest images during the contact that resolve its force (docs/constants.md).
MIN_CONTACT_FRAMES = 5.0

#: Fewest images of the whole ball in flight before the target (docs/constants.md).
MIN_FRAMES_IN_VIEW = 4

#: Least radius of a ball that is measured reliably, px (docs/constants.md).
MIN_RADIUS_PX = 10.0

#: Gives examples of the ball at a radius in px.
ExampleSource = Callable[[float], Sequence[Example]]


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
        """Error of the force in contact, the larger of the stated and the true error of the rehearsal."""
        if self.rehearsal is None or self.reason:
            return math.inf
        return float(max(self.rehearsal.force_N[1, 0], self.rehearsal.force_error_N[1]))


def read_modes(path: Path) -> list[Mode]:
    """Modes from a CSV table; raises ValueError, with the number of an invalid line, or OSError if it is unreadable."""
    expected = ", ".join(COLUMNS)
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.DictReader(stream, skipinitialspace=True)
            missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
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
