"""Missing images show in steps that are a whole multiple of the steps next to them, and in no other way."""

import dataclasses

import numpy as np
import pytest
from pulses import NOISES_M, pulse

import torchsphere as ts
from torchsphere.errors.missing_frames import missing_frames, pace_changes


@pytest.fixture(scope="module")
def track() -> ts.Track:
    """Flight, contact from frame 33 to frame 47, flight: 14 px per frame before."""
    return pulse(11, NOISES_M[0]).track


def without(track: ts.Track, first: int, count: int) -> ts.Track:
    """The track of the recording without ``count`` frames from ``first`` on; small rotations are added."""
    increment = np.delete(track.increment, slice(first, first + count), axis=0)
    increment[first - 1] = track.increment[first - 1 : first + count].sum(0)
    return dataclasses.replace(
        track, increment=increment, covariance=np.delete(track.covariance, slice(first, first + count), axis=0)
    )


def test_a_whole_recording_has_no_gap(track: ts.Track) -> None:
    assert missing_frames(track) == ()


@pytest.mark.parametrize(("first", "count"), [(12, 1), (12, 7), (60, 3)])
def test_missing_images_are_counted_where_they_are_missing(track: ts.Track, first: int, count: int) -> None:
    assert missing_frames(without(track, first, count)) == ((first, count),)


def test_an_image_that_is_shown_once_more_with_noise_of_its_own_is_told(track: ts.Track) -> None:
    increment, sd = track.increment, np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2))
    standing = np.insert(increment, 12, np.random.default_rng(1).normal(0, 1, 5) * sd[12], axis=0)
    covariance = np.insert(track.covariance, 12, track.covariance[12], axis=0)
    assert missing_frames(dataclasses.replace(track, increment=standing, covariance=covariance)) == ((13, -1),)


def test_a_step_that_was_not_measured_is_no_gap(track: ts.Track) -> None:
    increment = without(track, 12, 1).increment.copy()
    increment[12] = np.nan
    assert missing_frames(dataclasses.replace(without(track, 12, 1), increment=increment)) == ()


def test_a_ball_at_rest_has_no_gap(track: ts.Track) -> None:
    noise = np.random.default_rng(0).normal(0, 1, track.increment.shape)
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2))
    assert missing_frames(dataclasses.replace(track, increment=noise * sd)) == ()


def spinning(track: ts.Track, turn_px: float) -> ts.Track:
    """The ball turns by that many px per frame all the time, about one axis, whatever happens to it."""
    increment = track.increment.copy()
    increment[:, 2:] = turn_px / track.circle.radius * np.array([0.6, 0.0, 0.8])
    return dataclasses.replace(track, increment=increment)


def thinned(track: ts.Track, first: int, every: int) -> ts.Track:
    """The recording of which only every so many-th image is there from frame ``first`` on."""
    kept = np.r_[:first, first : len(track.increment) : every]
    increment = np.add.reduceat(track.increment, kept)
    return dataclasses.replace(track, increment=increment, covariance=track.covariance[kept])


@pytest.mark.parametrize("every", [2, 3])
def test_a_recording_that_goes_over_to_fewer_images_is_told(track: ts.Track, every: int) -> None:
    whole = spinning(track, 5.0)
    slower = thinned(whole, 12, every)
    assert pace_changes(slower) == ((12, every),)
    assert missing_frames(slower) == ()
    assert pace_changes(whole) == ()
    backward = dataclasses.replace(
        slower, increment=slower.increment[::-1].copy(), covariance=slower.covariance[::-1].copy()
    )
    assert pace_changes(backward) == ((len(slower.increment) - 12, 1 / every),)


def test_a_ball_that_is_struck_on_its_way_has_no_change_of_pace(track: ts.Track) -> None:
    """Twice as fast from frame 12 on, but spinning as before; or without a spin, when nothing tells the two apart."""
    for turn_px in (5.0, 0.0):
        struck = spinning(track, turn_px)
        struck.increment[12:, :2] *= 2
        assert pace_changes(struck) == ()
