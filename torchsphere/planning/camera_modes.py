"""The trade of resolution against frame rate (section 3.2 of the paper), over the modes of a camera."""

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

#: Images during the contact that its force needs: half a sine of duration T is made of frequencies up to about 1.5 / T,
#: and the smoother passes in contact up to 0.27 of the frame rate.
LEAST_CONTACT_FRAMES = 5.0

#: Images of the whole ball that a flight needs before the target.
LEAST_IN_VIEW = 4

#: Least radius of a ball that is measured reliably, px: the smallest of `experiments.accuracy`.
LEAST_RADIUS_PX = 10.0

#: Examples of the ball at a radius in px.
Look = Callable[[float], Sequence[Example]]


@dataclass(frozen=True)
class Mode:
    """A mode of a camera: size of its images, px, and highest frame rate, 1/s."""

    width_px: int
    height_px: int
    fps_max: float


@dataclass(frozen=True)
class Verdict:
    """What a mode is worth for a test.

    Attributes
    ----------
    mode : Mode
    setup : Setup or None
        The test with this mode.
    frames_in_view : int
    differences : Differences or None
    rehearsal : Rehearsal or None
    reason : str
        Why the mode is of no use, in words; empty where it is.
    """

    mode: Mode
    setup: Setup | None
    frames_in_view: int
    differences: Differences | None
    rehearsal: Rehearsal | None
    reason: str

    @property
    def error_N(self) -> float:  # noqa: N802  (N is newton)
        """Error of the force in contact, the stated or the true one of the rehearsal, whichever is larger."""
        if self.rehearsal is None or self.reason:
            return math.inf
        return float(max(self.rehearsal.force_N[1, 0], self.rehearsal.force_error_N[1]))


def read_modes(path: Path) -> list[Mode]:
    """Modes from a CSV table with the columns width_px, height_px, fps_max.

    Raises
    ------
    ValueError, OSError
        With the line that cannot be used.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            reader = csv.DictReader(stream, skipinitialspace=True)
            missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
            if missing:
                raise ValueError(
                    f"{path}: has no column {', '.join(missing)}; expected a CSV with {', '.join(COLUMNS)}"
                )
            modes = [_mode(path, reader.line_num, row) for row in reader]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path}: is no CSV table ({error}); expected the columns {', '.join(COLUMNS)}") from error
    if not modes:
        raise ValueError(f"{path}: lists no mode; expected a line per mode with {', '.join(COLUMNS)}")
    return modes


def _mode(path: Path, line: int, row: dict[str, str]) -> Mode:
    try:
        width, height, rate = int(row["width_px"]), int(row["height_px"]), float(row["fps_max"])
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}, line {line}: expected two whole numbers and a frame rate") from error
    if width < 1 or height < 1 or not (math.isfinite(rate) and rate > 0):
        raise ValueError(f"{path}, line {line}: expected sizes of 1 px or more and a positive frame rate")
    return Mode(width, height, rate)


def judge(
    mode: Mode, look: Look, setup: Setup, target: Target, *, field_mm: float | None = None, is_blurred: bool = False
) -> Verdict:
    """What a mode at its highest frame rate is worth for the test.

    Parameters
    ----------
    mode : Mode
    look : callable
        Examples of the ball.
    setup : Setup
        The test; frame rate and scale are the mode's, and an exposure longer than its interval is cut.
    target : Target
    field_mm : float, optional
        Width of the field of view, which the optics keep; by default they keep the px per mm.
    is_blurred : bool
        The examples show the test's motion blur.

    Raises
    ------
    ValueError
        If the texture does not carry the modes.
    """
    scale = setup.px_per_mm if field_mm is None else mode.width_px / field_mm
    longest = math.inf if setup.shutter_s is None else setup.shutter_s
    own = dataclasses.replace(setup, frame_rate=mode.fps_max, px_per_mm=scale, shutter_s=min(longest, 1 / mode.fps_max))
    in_view = own.frames_in_view(mode.width_px)
    for wrong, reason in (
        (own.radius_px < LEAST_RADIUS_PX, f"the ball's radius is {own.radius_px:.1f} px only"),
        (
            2 * own.radius_px > min(mode.width_px, mode.height_px),
            f"the ball of {2 * own.radius_px:.0f} px does not fit",
        ),
        (in_view < LEAST_IN_VIEW, f"{in_view} images in view only"),
    ):
        if wrong:
            return Verdict(mode, own, in_view, None, None, reason)
    covariance = increment_covariance(look(own.radius_px), own, is_blurred=is_blurred)
    plain = differences(covariance, own.frame_rate, own.m_per_px, own.mass_kg)
    frames = target.contact_s * own.frame_rate
    reason = "" if frames >= LEAST_CONTACT_FRAMES else f"{frames:.1f} images during the contact only"
    try:
        rehearsal = rehearse(covariance, own, target)
    except ValueError:
        return Verdict(mode, own, in_view, plain, None, f"{frames:.0f} images during the contact are too many")
    if not reason and not rehearsal.found:
        reason = "the contact does not stand out from the noise"
    return Verdict(mode, own, in_view, plain, rehearsal, reason)


def best(verdicts: Sequence[Verdict]) -> Verdict | None:
    """The mode with the least error of the force in contact; None where none is of use."""
    usable = [verdict for verdict in verdicts if math.isfinite(verdict.error_N)]
    return min(usable, key=lambda verdict: verdict.error_N, default=None)
