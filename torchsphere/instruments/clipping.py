"""Signals that reach the end of their range: samples that all have the largest, or the smallest, value."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from torchsphere.instruments.delay import MIN_SAMPLES
from torchsphere.runtime.arrays import Array
from torchsphere.runtime.warning_levels import severe

#: Fewest samples at the value at which a signal is clipped (docs/constants.toml).
MIN_CLIPPED = 3

#: Steps of a signal in which its top is looked at (docs/constants.toml).
TOP_STEPS = 4


def clipped(signal: Array) -> tuple[tuple[float, int], ...]:
    """The values at which a signal (n,) is clipped, and the numbers of samples that have them.

    A round top falls with the square of the time: of the samples in its ``TOP_STEPS`` highest steps half or fewer have
    the highest value, and noise makes them fewer. A clipped top has two thirds or more there. A value at which a signal
    begins or ends is where it rests.
    """
    values = np.unique(signal)
    step = float(np.diff(values).min(initial=np.inf))
    rest = (np.median(signal[:MIN_SAMPLES]), np.median(signal[-MIN_SAMPLES:]))
    # A converter slower than the logger repeats each value.
    repeats = int(np.diff(np.flatnonzero(np.diff(signal))).min(initial=len(signal)))
    found = []
    for level in (float(values[0]), float(values[-1])):
        count = int((signal == level).sum())
        top = int((np.abs(signal - level) < (TOP_STEPS - 0.5) * step).sum())
        if level not in rest and count >= MIN_CLIPPED * repeats and 3 * count > 2 * top:
            found.append((level, count))
    return tuple(found)


def clipping_warnings(signals: Mapping[str, Array], unit: str = "") -> tuple[str, ...]:
    """A sentence on each value at which signals (n,), by their names, are clipped."""
    return tuple(
        severe(
            f"{name} has the value {f'{level:.4g} {unit}'.strip()}, which it does not pass, in {count} samples: it is "
            "probably clipped, and peaks and changes computed from it are too small"
        )
        for name, signal in signals.items()
        for level, count in clipped(signal)
    )
