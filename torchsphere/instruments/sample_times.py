"""Times of samples: clock times, times that count from a date, and times that a logger rounded, as even times in s."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from torchsphere.instruments.delay import MIN_SAMPLES
from torchsphere.instruments.units import TIME
from torchsphere.runtime.arrays import Array

#: Largest relative difference of the intervals of even times.
MAX_UNEVENNESS = 0.01

#: Times that count from 1970, s: those of 2001 to 2096 (docs/constants.toml).
EPOCH_S = (1e9, 4e9)

#: Fewest unusual steps by which rounding is told from gaps (docs/constants.toml).
MIN_ODD_STEPS = 3

#: Largest last digit of rounded times as a share of their duration (docs/constants.toml).
MAX_DIGIT = 2e-3

#: A time of day, which may stand behind a date: hours, minutes, seconds, then half of the day, and zone.
_CLOCK = re.compile(r"(?:^|[ T])(?:(\d{1,2}):)?(\d{1,2}):(\d{1,2}(?:\.\d+)?)\s*(?:[AP]M)?\s*(?:Z|[+-]\d\d:?\d\d)?$")

#: Half a day, s: clocks of 12 and of 24 hours both go on after it.
_HALF_DAY_S = 43200.0

#: Decimals of a number, and its exponent.
_DECIMALS = re.compile(r"(?:\.(\d*))?(?:[eE]([+-]?\d+))?$")


def is_clock_time(text: str) -> bool:
    """Whether a text is a time of day, with or without a date."""
    return _CLOCK.search(text) is not None


def clock_times(texts: Sequence[str]) -> tuple[Array, list[str]]:
    """Times (n,), s after the first, of times of day, and the texts of their seconds; ValueError for other texts."""
    seconds, rests = np.empty(len(texts)), []
    for k, text in enumerate(texts):
        found = _CLOCK.search(text)
        if found is None:
            raise ValueError(text)
        hours, minutes, rest = found.groups(default="0")
        seconds[k] = 3600 * int(hours) + 60 * int(minutes) + float(rest)
        rests.append(rest)
    return np.concatenate(([0.0], np.cumsum(np.diff(seconds) % _HALF_DAY_S))), rests


def epoch_unit(first: float) -> str | None:
    """The unit in which a time counts from 1970; None if it does not in any."""
    low, high = EPOCH_S
    return next((unit for unit, factor in TIME.factors.items() if low <= first * factor < high), None)


def last_digits(texts: Sequence[str], times: Array) -> Array:
    """Values (n,) of the last digits of numbers: as written, and as the logger and NumPy keep them."""
    found = [match.groups(default="") for match in map(_DECIMALS.search, texts) if match is not None]
    written = np.array([10.0 ** (int(exponent or 0) - len(decimals)) for decimals, exponent in found])
    single = times.astype(np.float32)
    by_logger = np.spacing(np.abs(single)) if (np.abs(single - times) <= written / 2).all() else 0.0
    return written + by_logger + np.spacing(np.abs(times))


def evened(times: Array, digits: Array) -> Array | None:
    """Even times (n,) in place of rounded ones; None if rounding at the ``digits`` (n,) does not explain the steps.

    Rounding moves each time by half of its last digit at most, up or down; what is cut off moves all by half a digit.
    The line through the times adds three standard deviations of its own by such errors. One gap of a digit looks the
    same, so that a few unusual steps are gaps.
    """
    count, steps = len(times), np.diff(times)
    index = np.arange(count) - (count - 1) / 2
    interval = float(index @ (times - times.mean())) / float(index @ index)
    line = times.mean() + interval * index
    odd = np.abs(steps - np.median(steps)) > MAX_UNEVENNESS * np.median(steps)
    explained = (np.abs(times - line) <= digits * (0.5 + 1.5 / np.sqrt(count))).all() and odd.sum() >= MIN_ODD_STEPS
    return line if explained and np.median(digits) <= MAX_DIGIT * (line[-1] - line[0]) else None


def uneven_step(times: Array) -> int | None:
    """The step of times (n,) that differs most from even intervals, by the sample after it; None for even times."""
    steps = np.diff(times)
    median = float(np.median(steps))
    off = np.abs(steps - median)
    return int(off.argmax()) + 1 if median <= 0 or off.max() > MAX_UNEVENNESS * median else None


def even_interval(times: Array, name: str) -> float:
    """The interval of times (n,); raises unless they rise evenly."""
    steps = np.diff(np.asarray(times, dtype=np.float64))
    if steps.ndim != 1:
        raise ValueError(f"{name}: expected times (n,), got an array {np.shape(times)}")
    if len(steps) < MIN_SAMPLES - 1 or not np.isfinite(steps).all() or (steps <= 0).any():
        raise ValueError(f"{name}: expected {MIN_SAMPLES} or more finite, rising times")
    if uneven_step(times) is not None:
        raise ValueError(f"{name}: expected even intervals, got {steps.min():g} to {steps.max():g} s; resample them")
    return float((times[-1] - times[0]) / len(steps))
