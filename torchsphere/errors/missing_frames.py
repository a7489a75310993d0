"""Images that are missing, or shown once more: there the ball goes a whole number of times as far, or stands still."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchsphere.errors.evidence import Evidence
from torchsphere.geometry.orientation import rotation_vectors
from torchsphere.motion.findings import Findings
from torchsphere.motion.track import Track
from torchsphere.runtime.arrays import Array
from torchsphere.runtime.warning_levels import severe

#: Largest relative difference of steps that count as equal (docs/constants.toml).
MAX_DIFFERENCE = 0.1

#: Least length of the neighbouring steps, in standard deviations (docs/constants.toml).
MIN_LENGTH_SD = 20.0

#: Steps on either side of one that say how far the ball goes from image to image (docs/constants.toml).
REACH = 3

#: Most gaps that a sentence names.
MAX_NAMED_GAPS = 5

#: The parts of a step: px sideways, and px that the surface turns by.
TRANSLATION, ROTATION = slice(0, 2), slice(2, 5)


@dataclass(frozen=True)
class Steps:
    """Ways (m, 5) between m + 1 measured frames, px, whatever frames between them were lost."""

    way: Array
    times: Array  # (m,), in frame intervals
    sd: Array  # (5,), of one step, px
    later: NDArray[np.intp]  # (m,), the frames that they lead to

    @property
    def each(self) -> Array:
        """Steps (m, 5) per frame interval."""
        return self.way / self.times[:, None]


def missing_frames(track: Track) -> tuple[tuple[int, int], ...]:
    """Frames before which images seem to be missing, and how many: ((frame, images), ...).

    -1 for a frame in which the ball stands still on its way, as it shows the one before once more, and less for one of
    an earlier time than that.
    """
    steps = _steps(track)
    found = _out_of_pace(steps)
    # Where every image is shown twice, one that stands still is no copy in place of the next.
    copies = [pair for pair in _copies(steps) if not pair & found]
    return tuple(sorted(found.union(*copies)))


def _out_of_pace(steps: Steps) -> set[tuple[int, int]]:
    """Steps of a whole number of intervals, other than their own, of a ball that goes alike before and after."""
    found, each = set(), steps.each
    for i, (way, times) in enumerate(zip(steps.way, steps.times, strict=True)):
        before, after = each[max(i - REACH, 0) : i], each[i + 1 : i + 1 + REACH]
        expected = np.median(each[max(i - REACH, 0) : i + 1 + REACH], axis=0)
        if not (
            _is_measurable(expected, steps.sd)
            and any(_is_equal(step, expected) for step in before)
            and any(_is_equal(step, expected) for step in after)
        ):
            continue
        ratio = _ratio(way, expected)
        if ratio != round(times) and _is_equal(way - (ratio - 1) * expected, expected, of=max(abs(ratio), 1)):
            first = steps.later[i] - round(times) + 1 if ratio < times else steps.later[i]
            found.add((int(first), ratio - round(times)))
    return found


def _copies(steps: Steps) -> list[set[tuple[int, int]]]:
    """Images that were replaced by the one before or after: the ball stands still, and then goes twice as far.

    Also within a contact, where no two steps are alike: the way of both is that of a smooth motion, but one has it all.
    """
    found = []
    for i in range(2, len(steps.way) - 3):
        outer, pair = steps.each[[i - 2, i - 1, i + 2, i + 3]], steps.each[i : i + 2]
        # A cubic through the outer four.
        both = 1.5 * (outer[1] + outer[2]) - 0.5 * (outer[0] + outer[3])
        bend = (outer[2] - outer[1]) / 3
        expected = 0.5 * np.stack((both - bend, both + bend))
        for still, moving in ((0, 1), (1, 0)):
            if (
                _is_equal(pair[moving], both)
                and _is_measurable(expected[still], steps.sd)
                and _is_equal(expected[still] - pair[still], expected[still])
                # A ball that turns round stands still, too: its step is expected to be short.
                and _ratio(both, expected[still]) in (1, 2, 3)
            ):
                found.append({(int(steps.later[i + still]), -1), (int(steps.later[i + moving]), 1)})
    return found


def pace_changes(track: Track) -> tuple[tuple[int, float], ...]:
    """Frames from which all steps are a whole number of times as far as those before, or a part: ((frame, times), ...).

    A ball that is struck may go twice as fast, but it does not spin twice as fast about the same axis in the same step.
    """
    steps, changes = _steps(track), []
    for i in range(2, len(steps.way) - 1):
        (first, before), (after, last) = steps.each[i - 2 : i], steps.each[i : i + 2]
        if not (_is_equal(first, before) and _is_equal(after, last)):
            continue
        short, long = sorted((0.5 * (first + before), 0.5 * (after + last)), key=lambda step: float(step @ step))
        ratio = _ratio(long, short)
        if ratio >= 2 and all(
            _is_measurable(short[part], steps.sd[part]) and _is_equal(long[part] / ratio, short[part])
            for part in (TRANSLATION, ROTATION)
        ):
            changes.append((int(steps.later[i]) - 1, float(ratio) if after @ after > before @ before else 1 / ratio))
    return tuple(changes)


def _steps(track: Track) -> Steps:
    """The steps between the frames whose pose is known."""
    known = np.flatnonzero(np.isfinite(track.position).all(1) & np.isfinite(track.orientation).all((1, 2)))
    turned = rotation_vectors(track.orientation[known[1:]], track.orientation[known[:-1]])
    to_px = np.array([1.0, 1.0, *3 * [track.circle.radius]])
    variance = np.diagonal(track.covariance, axis1=1, axis2=2)
    measured = variance[np.isfinite(variance).all(1)]
    return Steps(
        way=np.concatenate((np.diff(track.position[known], axis=0), turned), 1) * to_px,
        # A gap that the images' own times state is not missing.
        times=np.diff(np.concatenate(([0.0], np.cumsum(track.durations)))[known]),
        sd=to_px * (np.sqrt(np.median(measured, axis=0)) if len(measured) else np.full(5, np.nan)),
        later=known[1:],
    )


def _is_measurable(step: Array, sd: Array) -> bool:
    return bool(np.linalg.norm(step) > MIN_LENGTH_SD * np.linalg.norm(sd))


def _is_equal(step: Array, other: Array, of: float = 1.0) -> bool:
    """Whether two steps differ by little, where ``of`` times the ``other`` one is what was measured."""
    return bool(np.linalg.norm(step - other) < MAX_DIFFERENCE * of * np.linalg.norm(other))


def _ratio(step: Array, unit: Array) -> int:
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
            f"Images seem to show an earlier one once more, {len(frames)} in all (frames {numbers}{more}), as the ball "
            "stands still there, or goes back, amid its way: the recording was stretched to another frame rate, lost "
            "images were replaced by others, or the images are not in order. Times, velocities and forces are wrong; "
            "export it from the camera's own file again."
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
