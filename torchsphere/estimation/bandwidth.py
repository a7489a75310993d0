"""Bandwidth of a derivative: the frequencies of the motion that the smoother or a local polynomial passes."""

from __future__ import annotations

import numpy as np

from torchsphere.estimation.process_model import FLIGHT_STATES, PRIOR_VARIANCE, STATES, transitions
from torchsphere.estimation.process_noise import added_covariance
from torchsphere.runtime.arrays import Array

#: Amplitude at the cutoff frequency: half of the power, -3 dB.
HALF_POWER = 0.5**0.5

#: Frequencies up to the highest at which the response is computed.
FREQUENCIES = 2000

#: Frames on either side whose weights are computed (docs/constants.toml).
RESPONSE_FRAMES = 60


def cutoffs(weights: Array, offsets: Array) -> dict[str, float]:
    """Cutoff frequencies of rate and acceleration from the weights (2, w) of values at ``offsets`` (w,)."""
    return {name: cutoff(weights[k], offsets, k + 1) for k, name in enumerate(("rate", "acceleration"))}


def cutoff(weights: Array, offsets: Array, derivative: int) -> float:
    """Highest frequency at which the amplitude of a derivative, 1 or 2, has fallen by no more than 3 dB.

    ``weights`` (w,) of the values at the times ``offsets`` (w,) are the reversed impulse response.
    """
    step = float(np.median(np.diff(offsets)))
    frequency = 0.5 / step * np.linspace(0.0, 1.0, FREQUENCIES + 1)[1:]
    circular = 2 * np.pi * frequency
    samples = np.rint(offsets / step).astype(np.int64)
    if np.array_equal(samples * step, offsets) and np.ptp(samples) < 2 * FREQUENCIES:
        # For even times a Fourier transform takes a hundredth of the time.
        impulses = np.zeros(2 * FREQUENCIES)
        impulses[samples % len(impulses)] = weights
        response = np.fft.rfft(impulses)[1:]
    else:
        response = np.exp(1j * circular[:, None] * offsets) @ weights
    gain = np.abs(response) / circular**derivative
    passing = np.flatnonzero(gain >= HALF_POWER)
    return float(frequency[passing[-1]]) if len(passing) else 0.0


def smoother_weights(
    times: Array,
    variance: Array,
    window: tuple[float, float],
    process: tuple[float, float, Array | None],
    at: int,
) -> tuple[Array, slice]:
    """Weights (2, w) of the poses in rate and acceleration at frame ``at``, and the w frames.

    ``times`` and ``variance`` (n,) are those of the poses, the variance infinite where there is no pose; ``process``
    holds the intensities in flight and in the contact ``window``, and the form (5,) or None for the rough process.
    """
    part = slice(max(at - RESPONSE_FRAMES, 0), at + RESPONSE_FRAMES + 1)
    flight, contact, form = process
    interval = np.array([[window]])
    steps = transitions(times[None, part], interval, None if form is None else form[None, None])
    matrices = steps.matrix[0, 0]
    added = added_covariance(steps, flight, contact, is_formed=form is not None)[0, 0]
    impulses, noise = np.eye(len(times[part])), variance[part]
    mean = np.zeros((STATES, len(noise)))
    covariance = np.diag([PRIOR_VARIANCE] * FLIGHT_STATES + [1.0] * (STATES - FLIGHT_STATES))
    # The state at ``at`` goes on beside the later states, to which it has the covariance ``across``.
    frame = at - part.start
    state, across = mean, covariance
    for i in range(len(noise)):
        if i:
            mean, covariance = matrices[i - 1] @ mean, matrices[i - 1] @ covariance @ matrices[i - 1].T + added[i - 1]
            across = across @ matrices[i - 1].T
        if np.isfinite(noise[i]):
            size = covariance[0, 0] + noise[i]
            gain = covariance[:, :1] / size
            state = state + across[:, :1] / size * (impulses[i] - mean[0])
            mean = mean + gain * (impulses[i] - mean[0])
            keep = np.eye(STATES) - gain * np.eye(STATES)[0]
            covariance = keep @ covariance @ keep.T + noise[i] * gain @ gain.T
            across = across @ keep.T
        if i <= frame:
            state, across = mean, covariance
    rate, acceleration = state[1], state[2] + steps.envelope[0, 0, frame] * state[FLIGHT_STATES]
    return np.stack((rate, acceleration)), part
