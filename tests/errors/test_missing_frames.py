"""Missing images show in steps that are a whole multiple of the steps next to them, and in no other way."""

import dataclasses

import numpy as np
import pytest
from pulses import NOISES_M, pulse

import torchsphere as ts
from torchsphere.errors.missing_frames import missing_frames, pace_changes
from torchsphere.geometry.orientation import chain, rotation_vectors


@pytest.fixture(scope="module")
def track() -> ts.Track:
    """Flight, contact from frame 33 to frame 47, flight: 14 px per frame before."""
    return pulse(11, NOISES_M[0]).track


def moved(track: ts.Track, increment: np.ndarray) -> ts.Track:
    """The ball moves by these steps (n, 5), each known as well as those of the ``track``."""
    n = len(increment)
    position = track.position[0] + np.concatenate((np.zeros((1, 2)), increment[:, :2].cumsum(0)))
    turns = np.concatenate((np.zeros((1, 3)), increment[:, 2:]))
    covariance = np.broadcast_to(track.covariance[0], (n, 5, 5))
    return dataclasses.replace(
        track,
        position=position,
        orientation=chain(turns, np.ones(n + 1, dtype=bool)),
        increment=increment,
        covariance=covariance,
    )


def shown(track: ts.Track, images: list[int]) -> ts.Track:
    """The recording of which these ``images`` are there, in this order, each with noise of its own."""
    position, orientation = track.position[images], track.orientation[images]
    sd = np.sqrt(np.diagonal(track.covariance[0]))
    noise = np.random.default_rng(1).normal(0, 0.5, (len(images), 5)) * sd
    turns = rotation_vectors(orientation[1:], orientation[:-1])
    steps = np.concatenate((np.diff(position + noise[:, :2], axis=0), turns + np.diff(noise[:, 2:], axis=0)), 1)
    return moved(track, steps)


def without(track: ts.Track, first: int, count: int) -> ts.Track:
    """The track of the recording without ``count`` frames from ``first`` on."""
    return shown(track, np.delete(np.arange(len(track.position)), slice(first, first + count)).tolist())


def test_a_whole_recording_has_no_gap(track: ts.Track) -> None:
    assert missing_frames(track) == ()


@pytest.mark.parametrize(("first", "count"), [(12, 1), (12, 7), (60, 3)])
def test_missing_images_are_counted_where_they_are_missing(track: ts.Track, first: int, count: int) -> None:
    assert missing_frames(without(track, first, count)) == ((first, count),)


@pytest.mark.parametrize("every", [1, 4, 5])
def test_images_that_are_shown_once_more_with_noise_of_their_own_are_told(track: ts.Track, every: int) -> None:
    images = [i for i in range(25) for _ in range(2 if i % every == every - 1 and i < 20 else 1)]
    copies = [k for k in range(1, len(images)) if images[k] == images[k - 1]]
    found = missing_frames(shown(track, images))
    # At the start too few steps say how far the ball goes.
    assert tuple(gap for gap in found if gap[0] > 4) == tuple((k, -1) for k in copies if k > 4)


@pytest.mark.parametrize("place", [12, 36, 40, 60])
@pytest.mark.parametrize("other", [-1, 1])
def test_an_image_in_place_of_another_one_is_told_in_flight_and_in_a_contact(
    track: ts.Track, place: int, other: int
) -> None:
    images = list(range(len(track.position)))
    images[place] += other
    found = missing_frames(shown(track, images))
    assert found == (((place, -1), (place + 1, 1)) if other < 0 else ((place, 1), (place + 1, -1)))


def test_images_in_the_wrong_order_are_told(track: ts.Track) -> None:
    images = list(range(30))
    images[12], images[13] = 13, 12
    assert missing_frames(shown(track, images)) == ((12, 1), (13, -2), (14, 1))


def test_a_frame_that_was_lost_is_no_gap_but_one_that_is_missing_beside_it_is(track: ts.Track) -> None:
    for found, images in (((), list(range(30))), (((14, 1),), [i for i in range(31) if i != 14])):
        steps = shown(track, images)
        steps.position[13] = np.nan
        assert missing_frames(steps) == found


def test_a_ball_at_rest_has_no_gap(track: ts.Track) -> None:
    noise = np.random.default_rng(0).normal(0, 1, track.increment.shape)
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2))
    assert missing_frames(moved(track, noise * sd)) == ()


@pytest.mark.parametrize("seed", range(20))
def test_a_ball_that_bounces_straight_back_without_spin_has_no_gap(track: ts.Track, seed: int) -> None:
    """Within the contact it stands still for a moment, wherever that lies between two images."""
    drawn = np.random.default_rng(seed)
    before, after, frames, middle = (
        drawn.uniform(3, 9),
        drawn.uniform(1, 8),
        drawn.uniform(1, 12),
        drawn.uniform(20, 30),
    )
    at = np.linspace(0, 50, 2001)
    share = np.clip((at - middle) / frames + 0.5, 0, 1)
    speed = before - (before + after) * 0.5 * (1 - np.cos(np.pi * share))
    way = np.interp(np.arange(51), at, np.concatenate(([0.0], np.cumsum(speed[:-1] * np.diff(at)))))
    steps = np.zeros((50, 5))
    steps[:, 0] = np.diff(way) + drawn.normal(0, np.sqrt(track.covariance[0, 0, 0]), 50)
    assert missing_frames(moved(track, steps)) == ()


def spinning(track: ts.Track, turn_px: float) -> ts.Track:
    """The ball turns by that many px per frame all the time, about one axis, whatever happens to it."""
    increment = track.increment.copy()
    increment[:, 2:] = turn_px / track.circle.radius * np.array([0.6, 0.0, 0.8])
    return moved(track, increment)


def thinned(track: ts.Track, first: int, every: int) -> ts.Track:
    """The recording of which only every so many-th image is there from frame ``first`` on."""
    return shown(track, [*range(first), *range(first, len(track.position), every)])


@pytest.mark.parametrize("every", [2, 3])
def test_a_recording_that_goes_over_to_fewer_images_is_told(track: ts.Track, every: int) -> None:
    whole = spinning(track, 5.0)
    slower = thinned(whole, 12, every)
    assert pace_changes(slower) == ((12, every),)
    assert missing_frames(slower) == ()
    assert pace_changes(whole) == ()
    backward = moved(slower, slower.increment[::-1].copy())
    assert pace_changes(backward) == ((len(slower.increment) - 12, 1 / every),)


def test_a_ball_that_is_struck_on_its_way_has_no_change_of_pace(track: ts.Track) -> None:
    """Twice as fast from frame 12 on, but spinning as before; or without a spin, when nothing tells the two apart."""
    for turn_px in (5.0, 0.0):
        increment = spinning(track, turn_px).increment.copy()
        increment[12:, :2] *= 2
        assert pace_changes(moved(track, increment)) == ()
