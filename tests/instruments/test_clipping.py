"""Pulses that reach the end of a range, and pulses that do not, at many noises, converters and lengths."""

import numpy as np
import pytest

from torchsphere.instruments.clipping import clipped, clipping_warnings


def pulse(length: int, noise: float, bits: int | None, end: float | None, seed: int) -> np.ndarray:
    """Half a sine of height -1 with noise, cut at a share of its height, by a converter with a range of 2.6."""
    rng = np.random.default_rng(seed)
    share = (np.arange(3 * length + 60) - 1.1 * length - 20 - rng.uniform()) / length
    signal = -np.sin(np.pi * np.clip(share, 0, 1)) + noise * rng.normal(size=len(share))
    if end is not None:
        signal = np.maximum(signal, -end)
    return signal if bits is None else np.round(signal * 2**bits / 2.6) * 2.6 / 2**bits


@pytest.mark.parametrize("bits", [None, 8, 12, 16])
@pytest.mark.parametrize("length", [10, 30, 100, 1000, 5000])
def test_a_clipped_pulse_is_told_from_a_whole_one(length: int, bits: int | None) -> None:
    for seed, noise in enumerate((0.0, 0.0005, 0.003, 0.02)):
        assert clipped(pulse(length, noise, bits, None, seed)) == ()
        signal = pulse(length, noise, bits, 0.7, seed)
        assert clipped(signal) == ((signal.min(), (signal == signal.min()).sum()),)


@pytest.mark.parametrize("bits", [None, 12])
def test_a_signal_that_is_repeated_or_rests_at_the_end_of_its_range_is_not_clipped(bits: int | None) -> None:
    whole = pulse(100, 0.003, bits, None, 1)
    assert clipped(np.repeat(whole, 5)) == ()
    assert len(clipped(np.repeat(pulse(100, 0.003, bits, 0.7, 1), 5))) == 1
    # Without noise the signal is 0 before and after the pulse.
    assert clipped(np.minimum(pulse(100, 0.0, bits, None, 1), 0.0)) == ()
    assert clipped(np.ones(50)) == ()


def test_both_ends_of_a_range_are_named_with_their_unit() -> None:
    both = np.clip(1.5 * np.sin(np.arange(380) / 20), -1.0, 1.0)
    first, second = clipping_warnings({"The sensor": 500 * both}, "m/s^2")
    assert "The sensor has the value -500 m/s^2, which it does not pass, in" in first
    assert "500 m/s^2" in second
