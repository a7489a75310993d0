"""Missing images show in a step that is a whole multiple of the steps next to it, and in no other way."""

import dataclasses

import numpy as np
import pytest
from pulses import NOISES_M, pulse

import torchsphere as ts
from torchsphere.errors.missing_frames import missing_frames


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


def test_a_step_that_was_not_measured_is_no_gap(track: ts.Track) -> None:
    increment = without(track, 12, 1).increment.copy()
    increment[12] = np.nan
    assert missing_frames(dataclasses.replace(without(track, 12, 1), increment=increment)) == ()


def test_a_ball_at_rest_has_no_gap(track: ts.Track) -> None:
    noise = np.random.default_rng(0).normal(0, 1, track.increment.shape)
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2))
    assert missing_frames(dataclasses.replace(track, increment=noise * sd)) == ()
