"""Several recordings by one call: nothing of one touches another."""

import numpy as np
import pytest
import torch
from shots import shot

from torchsphere import track, track_many

#: One ball each, of other sizes and patterns: the first two have crops of one size.
SHOTS = [shot(seed, n=12, radius=radius) for seed, radius in ((1, 22.0), (2, 22.0), (3, 30.0))]


def test_several_recordings_are_measured_as_each_alone() -> None:
    alone = [track(each.images, each.circle) for each in SHOTS]
    both = track_many([each.images for each in SHOTS], [each.circle for each in SHOTS])
    for one, many in zip(alone, both, strict=True):
        assert not isinstance(many, Exception)
        assert (many.status == "ok").all()
        np.testing.assert_array_equal(many.increment, one.increment)
        np.testing.assert_array_equal(many.covariance, one.covariance)


def test_circles_are_found_and_settings_hold_for_all() -> None:
    together = track_many([each.images for each in SHOTS[:2]], sphere_map=False, model="finite")
    for many, each in zip(together, SHOTS, strict=False):
        alone = track(each.images, sphere_map=False, model="finite")
        assert not isinstance(many, Exception)
        assert many.settings == alone.settings
        assert many.circle == alone.circle


def test_a_recording_that_cannot_be_tracked_does_not_cost_the_others() -> None:
    blank = torch.full((5, 60, 60), 90.0)
    found, failed = track_many([SHOTS[0].images, blank], [SHOTS[0].circle, None])
    assert not isinstance(found, Exception)
    assert (found.status == "ok").all()
    assert isinstance(failed, ValueError)


def test_a_circle_is_expected_for_each_recording() -> None:
    with pytest.raises(ValueError, match="one for each of 2 recordings, got 1"):
        track_many([SHOTS[0].images] * 2, [SHOTS[0].circle])


def test_nothing_to_track_is_no_track() -> None:
    assert track_many([]) == []
