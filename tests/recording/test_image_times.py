"""Whose clock: the frame rate and the gaps that the times of the images give."""

import numpy as np
import pytest

from torchsphere.recording.image_times import clock_of, frame_rate_note, spacing_notes

NUMBERS = np.arange(40)


@pytest.mark.parametrize("rate", [24.0, 1500.0, 90_000.0, 1e6])
def test_even_times_give_their_rate_and_nothing_else(rate: float) -> None:
    ticks = np.floor(NUMBERS / rate * 2**30) / 2**30
    clock = clock_of(ticks)
    assert clock is not None
    assert clock.frame_rate == pytest.approx(rate, rel=1e-4)
    assert clock.times is None
    assert not clock.gaps
    assert clock.agrees_with(rate)
    assert not spacing_notes(clock)


def test_a_pause_is_a_gap_of_its_own_length() -> None:
    clock = clock_of(NUMBERS / 1500 + 0.002 * (NUMBERS >= 20))
    assert clock is not None
    assert clock.frame_rate == pytest.approx(1500)
    assert [image for image, _ in clock.gaps] == [20]
    assert clock.gaps[0][1] == pytest.approx(0.002 + 1 / 1500)
    # 2 ms are three intervals at 1500 frames/s.
    np.testing.assert_allclose(clock.times, NUMBERS + 3 * (NUMBERS >= 20))
    assert "before image 20" in spacing_notes(clock)[0]


@pytest.mark.parametrize("length", [-0.4, 0.3, 1.7, 2.5, 40.25])
def test_a_pause_may_have_any_length(length: float) -> None:
    clock = clock_of((NUMBERS + length * (NUMBERS >= 11)) * 1e-3)
    assert clock is not None
    assert clock.frame_rate == pytest.approx(1000)
    np.testing.assert_allclose(clock.times, NUMBERS + length * (NUMBERS >= 11), atol=1e-9)


@pytest.mark.parametrize("missing", [[10], [10, 11], [5, 20, 21, 22]])
def test_stamps_in_whole_microseconds_are_even_times_with_whole_gaps(missing: list[int]) -> None:
    kept = np.delete(NUMBERS, missing)
    clock = clock_of(np.round(28.5 * kept) * 1e-6)
    assert clock is not None
    # Intervals of 28 and 29 us are one rate, and no jitter of the ball.
    np.testing.assert_array_equal(clock.times, kept)
    assert not clock.is_uneven
    assert clock.agrees_with(1e6 / 28.5)
    assert not clock.agrees_with(1e6 / 29)


def test_jitter_of_the_stamps_is_left_out_and_uneven_images_are_not() -> None:
    noise = np.random.default_rng(3).normal(size=40)
    quiet, uneven = clock_of((NUMBERS + 0.002 * noise) * 1e-3), clock_of((NUMBERS + 0.05 * noise) * 1e-3)
    assert quiet is not None
    assert quiet.times is None
    assert uneven is not None
    assert uneven.is_uneven
    np.testing.assert_allclose(np.diff(uneven.times) / uneven.frame_rate, np.diff((NUMBERS + 0.05 * noise) * 1e-3))
    assert "not evenly spaced" in spacing_notes(uneven)[-1]


def test_a_rate_that_changes_has_its_own_times() -> None:
    intervals = np.repeat([1e-3, 5e-4], 20)
    clock = clock_of(np.concatenate(([0.0], intervals.cumsum())))
    assert clock is not None
    np.testing.assert_allclose(np.diff(clock.times) / clock.frame_rate, intervals)


@pytest.mark.parametrize(
    "times", [[0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.5], [0.0, 1.0, np.nan], [0.0, 0.01, 0.02, 2.5e7]], ids=str
)
def test_times_that_no_recording_has_give_no_clock(times: list[float]) -> None:
    assert clock_of(np.array(times)) is None


def test_a_few_coarse_stamps_do_not_contradict_a_header() -> None:
    clock = clock_of(np.array([0.0, 28e-6]))
    assert clock is not None
    assert clock.agrees_with(35_088)
    assert not clock.agrees_with(70_000)


def test_a_header_of_another_rate_is_said() -> None:
    clock = clock_of(NUMBERS / 1500)
    assert clock is not None
    assert "1500 frames/s" in frame_rate_note(clock, 1000.0, "block 1002")[0]
    assert "1000" in frame_rate_note(clock, 1000.0, "block 1002")[0]
    assert not frame_rate_note(clock, 1500.0, "block 1002")
    assert not frame_rate_note(clock, None, "block 1002")
