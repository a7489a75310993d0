"""Images missing between two frames: there the ball moves and turns a whole number of times as far as elsewhere."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from torchsphere.errors.evidence import Evidence
from torchsphere.motion.findings import Findings
from torchsphere.motion.track import Track
from torchsphere.runtime.warning_levels import severe

#: Largest relative difference of steps that count as equal (docs/constants.toml).
MAX_DIFFERENCE = 0.1

#: Least length of the neighbouring steps, in standard deviations (docs/constants.toml).
MIN_LENGTH_SD = 20.0

#: Most gaps that a sentence names.
MAX_NAMED_GAPS = 5

#: The parts of a step: px sideways, and px that the surface turns by.
TRANSLATION, ROTATION = slice(0, 2), slice(2, 5)


def missing_frames(track: Track) -> tuple[tuple[int, int], ...]:
    """Frames before which images seem to be missing, and how many: ((frame, images), ...).

    -1 for a frame in which the ball stands still between steps of one length: it shows the one before once more.
    """
    steps, sds = _steps(track)
    gaps = []
    for i in range(1, len(steps) - 1):
        before, step, after = steps[i - 1 : i + 2]
        expected = 0.5 * (before + after)
        if not (_is_measurable(expected, sds[i]) and _is_equal(before, after)):
            continue
        ratio = _ratio(step, expected)
        if (ratio >= 2 and _is_equal(step / ratio, expected)) or _is_equal(expected - step, expected):
            gaps.append((i + 1, ratio - 1))
    return tuple(gaps)


def pace_changes(track: Track) -> tuple[tuple[int, float], ...]:
    """Frames from which all steps are a whole number of times as far as those before, or a part: ((frame, times), ...).

    A ball that is struck may go twice as fast, but it does not spin twice as fast about the same axis in the same step.
    """
    steps, sds = _steps(track)
    changes = []
    for i in range(2, len(steps) - 1):
        (first, before), (after, last) = steps[i - 2 : i], steps[i : i + 2]
        if not (_is_equal(first, before) and _is_equal(after, last)):
            continue
        short, long = sorted((0.5 * (first + before), 0.5 * (after + last)), key=lambda step: float(step @ step))
        ratio = _ratio(long, short)
        if ratio >= 2 and all(
            _is_measurable(short[part], sds[i, part]) and _is_equal(long[part] / ratio, short[part])
            for part in (TRANSLATION, ROTATION)
        ):
            changes.append((i, float(ratio) if after @ after > before @ before else 1 / ratio))
    return tuple(changes)


def _steps(track: Track) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Steps (n, 5) with their standard deviations, px; those that were not measured are NaN, and equal nothing."""
    to_px = np.array([1.0, 1.0, *3 * [track.circle.radius]])
    # A gap that the images' own times state is not missing.
    steps = track.increment * to_px / track.durations[:, None]
    return steps, np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2)) * to_px


def _is_measurable(step: NDArray[np.float64], sd: NDArray[np.float64]) -> bool:
    return bool(np.linalg.norm(step) > MIN_LENGTH_SD * np.linalg.norm(sd))


def _is_equal(step: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    return bool(np.linalg.norm(step - other) < MAX_DIFFERENCE * np.linalg.norm(other))


def _ratio(step: NDArray[np.float64], unit: NDArray[np.float64]) -> int:
    """The whole number of times that a ``step`` goes as far as the ``unit``, along it."""
    return round(float(step @ unit) / float(unit @ unit))


def detect(track: Track, evidence: Evidence) -> Findings:
    """Where images seem to be missing, and how many."""
    return dataclasses.replace(track.findings, missing_frames=missing_frames(track), pace_changes=pace_changes(track))


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """Where images seem to be missing or shown once more, and from which frame on only every second one is there."""
    return [*_of_gaps(track), *_of_repeated(track), *_of_changes(track)]


def _of_repeated(track: Track) -> list[str]:
    frames = [track.first_frame + i for i, count in track.findings.missing_frames if count < 0]
    if not frames:
        return []
    numbers = ", ".join(str(frame) for frame in frames[:MAX_NAMED_GAPS])
    more = ", ..." if len(frames) > MAX_NAMED_GAPS else ""
    return [
        severe(
            f"Images seem to show the one before once more, {len(frames)} in all (frames {numbers}{more}), as the ball "
            "stands still there between steps of one length: the recording was stretched to another frame rate. Times, "
            "velocities and forces are wrong; export it from the camera's own file again."
        )
    ]


def _of_gaps(track: Track) -> list[str]:
    gaps = [(i, count) for i, count in track.findings.missing_frames if count > 0]
    if not gaps:
        return []
    numbers = ", ".join(f"{count} before frame {track.first_frame + i}" for i, count in gaps[:MAX_NAMED_GAPS])
    return [
        severe(
            "Images seem to be missing, as the ball moves and turns a whole number of times as far in one step as "
            f"in the steps next to it: {numbers}{', ...' if len(gaps) > MAX_NAMED_GAPS else ''}. Times, velocities "
            "and forces are wrong there; measure the parts between with `frames`."
        )
    ]


def _of_changes(track: Track) -> list[str]:
    changes = track.findings.pace_changes
    if not changes:
        return []
    numbers = ", ".join(
        f"{times:g} times as far from frame {track.first_frame + i} on"
        if times > 1
        else f"1/{1 / times:g} as far from frame {track.first_frame + i} on"
        for i, times in changes[:MAX_NAMED_GAPS]
    )
    return [
        severe(
            "The time between images seems to change, as the ball both moves and turns a whole number of times as far "
            f"per image as before: {numbers}{', ...' if len(changes) > MAX_NAMED_GAPS else ''}. Velocities and forces "
            "are wrong on one side; measure each part with `frames` and its own frame rate."
        )
    ]
