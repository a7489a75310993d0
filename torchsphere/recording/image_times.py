"""Whose clock: the frame rate and the gaps that the times of the images themselves give.

A camera in external sync, a camera that was set anew, and an export of every tenth image keep the frame rate of the
set-up in the header. The times of the images say when they were taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torchsphere.runtime.arrays import Array
from torchsphere.settings.limits import FRAME_RATES

#: Longest time between two images of one recording, s; more is a damaged time (docs/constants.toml).
LONGEST_PAUSE_S = 86_400.0

#: Deviation of the images from an even spacing, share of it, that is jitter of the stamps (docs/constants.toml).
EVEN_WITHIN = 0.01

#: Deviation of an interval from the usual one, as a share of it, from which it is a gap or another rate.
IRREGULAR = 0.1

#: Relative difference of two frame rates that say the same (docs/constants.toml).
SAME_RATE = 1e-4

#: Steps of clocks that stamp images coarsely, s, and intervals that are enough to show such a step
#: (docs/constants.toml).
STAMPS_S, ENOUGH_INTERVALS = (1e-6, 1e-3), 8

#: Times that differ by less are the same, s: a clock of 32 bits per second, of which two serve as flags, rounds so.
TICK_S = 2.0**-29


@dataclass(frozen=True)
class Clock:
    """What the times of n images say."""

    frame_rate: float  # images per second, between two images without a gap
    relative_sd: float  # how well the stamps know it
    times: Array | None  # times (n,) since the first image, in intervals of that rate; None where evenly spaced
    gaps: tuple[tuple[int, float], ...]  # images after another interval than the usual, and that interval, s
    is_uneven: bool = False  # whether the usual intervals differ, too

    def agrees_with(self, frame_rate: float) -> bool:
        """Whether a header that states this ``frame_rate`` says the same."""
        return abs(self.frame_rate / frame_rate - 1) <= max(SAME_RATE, 3 * self.relative_sd)

    def counts_beside(self, stated: float | None) -> bool:
        """Whether this frame rate counts, not the one that a header has ``stated``.

        Of uneven images it always does: their times are in intervals of it, and what is uneven is not their stamps.
        """
        return stated is None or self.is_uneven or not self.agrees_with(stated)


def clock_of(times_s: Array) -> Clock | None:
    """The clock of images taken at ``times_s`` (n,); None for fewer than two, and for times that no recording has."""
    stamps = np.asarray(times_s, dtype=np.float64)
    intervals = np.diff(stamps)
    if not (len(intervals) and np.isfinite(intervals).all() and intervals.min() > 0):
        return None
    if intervals.max() > LONGEST_PAUSE_S:
        return None
    resolution, usual = _resolution(intervals), float(np.sort(intervals)[(len(intervals) - 1) // 2])
    regular = np.abs(intervals / usual - 1) <= max(IRREGULAR, 1.01 * resolution / usual)
    starts = np.concatenate(([0], np.flatnonzero(~regular) + 1))
    runs = [slice(int(a), int(b)) for a, b in zip(starts, [*starts[1:], len(stamps)], strict=True)]
    usual, sd = _mean_interval(stamps, runs, resolution)
    if not FRAME_RATES[0] <= 1 / usual <= FRAME_RATES[1]:
        return None
    # Half a step by the stamp, and as much by the interval that they give.
    within = max(EVEN_WITHIN, resolution / usual)
    times = (stamps - stamps[0]) / usual
    gaps = tuple((int(image), float(intervals[image - 1])) for image in starts[1:])
    is_even = all(_is_even(times[run], within) for run in runs)
    if is_even:
        times = _on_a_grid(times, runs, within)
    return Clock(1 / usual, sd / usual, None if is_even and not gaps else times, gaps, not is_even)


def _resolution(intervals: Array) -> float:
    """The step in which a clock counts, s: that of `STAMPS_S` of which all ``intervals`` are multiples; else 0.

    A camera that stamps its images in whole microseconds gives intervals of 28 and 29 us at 35,088 frames/s. Intervals
    that are all the same show no step. Where a few intervals cannot show it, it may be the smallest.
    """
    if len(intervals) >= ENOUGH_INTERVALS and np.ptp(intervals) < TICK_S:
        return 0.0
    found = [step for step in STAMPS_S if (np.abs(intervals - step * np.rint(intervals / step)) < TICK_S).all()]
    return max(found, default=0.0 if len(intervals) >= ENOUGH_INTERVALS else STAMPS_S[0])


def _mean_interval(stamps: Array, runs: list[slice], resolution: float) -> tuple[float, float]:
    """The interval between images, s, by one slope through the ``stamps`` of all ``runs``, and its sd."""
    steps = np.concatenate([np.arange(run.stop - run.start) - (run.stop - run.start - 1) / 2 for run in runs])
    about = np.concatenate([stamps[run] - stamps[run].mean() for run in runs])
    square = float(steps @ steps)
    slope = float(steps @ about) / square
    freedom = max(len(stamps) - len(runs) - 1, 1)
    scatter = float(np.square(about - slope * steps).sum()) / freedom
    return slope, float(np.sqrt((scatter + resolution**2 / 12) / square))


def _is_even(times: Array, within: float) -> bool:
    """Whether the ``times`` of a run, in intervals, are evenly spaced but for the jitter of the stamps."""
    off = times - times[0] - np.arange(len(times))
    return bool(np.abs(off - off.mean()).max() <= within)


def _on_a_grid(times: Array, runs: list[slice], within: float) -> Array:
    """The times with each run evenly spaced, and with a whole number of intervals across a gap that is nearly one."""
    placed = np.zeros_like(times)
    # The mean of a run's stamps is nearer to its true place than any of them.
    starts = [float((times[run] - np.arange(run.stop - run.start)).mean()) for run in runs]
    begin = 0.0
    for k, run in enumerate(runs):
        if k:
            apart = starts[k] - starts[k - 1]
            begin += round(apart) if abs(apart - round(apart)) <= within else apart
        placed[run] = begin + np.arange(run.stop - run.start)
    return placed


def frame_rate_note(clock: Clock, stated: float | None, origin: str) -> tuple[str, ...]:
    """A sentence if the header has ``stated`` another frame rate than the times of the images, which count."""
    if stated is None or clock.agrees_with(stated):
        return ()
    return (
        f"The images' own times ({origin}) give {clock.frame_rate:.8g} frames/s, and the header states {stated:.8g}: "
        "the images' times are used.",
    )


def spacing_notes(clock: Clock) -> tuple[str, ...]:
    """Sentences on gaps and on uneven spacing."""
    notes = []
    usual_ms = 1e3 / clock.frame_rate
    if clock.gaps:
        image, length = clock.gaps[0]
        count = len(clock.gaps)
        counted = "One interval between images is" if count == 1 else f"{count} intervals between images are"
        first = "but" if count == 1 else "the first of them"
        notes.append(
            f"{counted} not the usual {usual_ms:.4g} ms, {first} {1e3 * length:.4g} ms (before image {image}). Each "
            "image counts at its own time: a velocity across a gap is the way over the gap's time."
        )
    if clock.is_uneven:
        notes.append(
            f"The images are not evenly spaced; {usual_ms:.4g} ms is their mean interval. Each image counts at its own "
            "time."
        )
    return tuple(notes)
