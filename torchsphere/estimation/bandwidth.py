"""Which frequencies of the motion a way of differentiating lets through."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torchsphere.estimation.filter_bank import UNKNOWN
from torchsphere.estimation.process_model import ABSENT, STATES, STEADY, transitions

Array = NDArray[np.float64]

#: Amplitude that counts as passed: half of the power, -3 dB.
PASSED = 0.5**0.5

#: Frequencies up to the highest at which the response is found.
FREQUENCIES = 2000

#: Frames on either side of one whose response is measured.
REACH = 60


def cutoff(weights: Array, offsets: Array, derivative: int) -> float:
    """Highest frequency at which a derivative's amplitude has fallen by no more than 3 dB.

    Parameters
    ----------
    weights : ndarray
        (w,), of the values around one: its impulse response, reversed.
    offsets : ndarray
        Their times (w,), s.
    derivative : int
        1 or 2.
    """
    step = float(np.median(np.diff(offsets)))
    frequency = 0.5 / step * np.linspace(0.0, 1.0, FREQUENCIES + 1)[1:]
    circular = 2 * np.pi * frequency
    places = np.rint(offsets / step).astype(np.int64)
    if np.array_equal(places * step, offsets) and np.ptp(places) < 2 * FREQUENCIES:
        # Of even times it is a Fourier transform, which takes a hundredth of the time.
        impulses = np.zeros(2 * FREQUENCIES)
        impulses[places % len(impulses)] = weights
        response = np.fft.rfft(impulses)[1:]
    else:
        response = np.exp(1j * circular[:, None] * offsets) @ weights
    gain = np.abs(response) / circular**derivative
    passing = np.flatnonzero(gain >= PASSED)
    return float(frequency[passing[-1]]) if len(passing) else 0.0


def smoother_weights(
    times: Array,
    variance: Array,
    window: tuple[float, float],
    flight: float,
    contact: tuple[float, float | None],
    at: int,
) -> tuple[Array, slice]:
    """Weights (2, w) of the poses in velocity and acceleration at frame ``at``, and which frames they are of.

    Parameters
    ----------
    times, variance : ndarray
        (n,), frames; variance of the poses, infinite where there is none.
    window : tuple of float
        Contact interval.
    flight : float
        Its intensity.
    contact : tuple
        Its intensity, and the spring of the smooth process, None of the rough one.
    at : int
        Frame.
    """
    part = slice(max(at - REACH, 0), at + REACH + 1)
    intensity, spring = contact
    interval = np.array([[window]])
    moves = transitions(times[None, part], interval, None if spring is None else np.array([[spring]]))
    matrices = moves.matrix[0, 0]
    added = intensity * moves.contact[0, 0] + flight * moves.flight[0, 0]
    if spring is None:
        # The rough process' snap is none, but must not be known exactly.
        added += ABSENT * transitions(times[None, part], interval, np.zeros((1, 1))).contact[0, 0]
    later = np.arange(STEADY, STATES)
    added[:, later, later] += moves.idle[0, 0][:, None]
    impulses, noise = np.eye(len(times[part])), variance[part]
    mean, spread = np.zeros((STATES, len(noise))), np.diag([UNKNOWN] * STEADY + [1.0] * (STATES - STEADY))
    passed = []
    for i in range(len(noise)):
        if i:
            mean, spread = matrices[i - 1] @ mean, matrices[i - 1] @ spread @ matrices[i - 1].T + added[i - 1]
        if np.isfinite(noise[i]):
            gain = spread[:, :1] / (spread[0, 0] + noise[i])
            mean = mean + gain * (impulses[i] - mean[0])
            keep = np.eye(STATES) - gain * np.eye(STATES)[0]
            spread = keep @ spread @ keep.T + noise[i] * gain @ gain.T
        passed.append((mean, spread))
    for i in range(len(noise) - 2, at - part.start - 1, -1):
        before, spread = passed[i]
        ahead = matrices[i] @ spread @ matrices[i].T + added[i]
        size = np.sqrt(np.diag(ahead))
        scaled = np.linalg.solve(ahead / np.outer(size, size), (matrices[i] @ spread) / size[:, None])
        gain = (scaled / size[:, None]).T
        mean = before + gain @ (mean - matrices[i] @ before)
    return mean[1:3], part
