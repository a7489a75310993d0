"""Several recordings in one call are independent of each other."""

import numpy as np
import pytest
import torch
from shots import shot

from torchsphere import track, track_many

#: One ball each, with different patterns; the first two have the same size.
SHOTS = [shot(seed, n=12, radius=radius) for seed, radius in ((1, 22.0), (2, 22.0), (3, 30.0))]


def test_each_of_several_recordings_is_measured_as_if_it_were_alone() -> None:
    alone = [track(each.images, each.circle) for each in SHOTS]
    both = track_many([each.images for each in SHOTS], [each.circle for each in SHOTS])
    for one, many in zip(alone, both, strict=True):
        assert not isinstance(many, Exception)
        assert (many.status == "ok").all()
        np.testing.assert_array_equal(many.increment, one.increment)
        np.testing.assert_array_equal(many.covariance, one.covariance)


def test_circles_are_found_and_settings_apply_to_all_recordings() -> None:
    together = track_many([each.images for each in SHOTS[:2]], sphere_map=False, model="finite")
    for many, each in zip(together, SHOTS, strict=False):
        alone = track(each.images, sphere_map=False, model="finite")
        assert not isinstance(many, Exception)
        assert many.settings == alone.settings
        assert many.circle == alone.circle


def test_a_recording_that_fails_does_not_stop_the_others() -> None:
    blank = torch.full((5, 60, 60), 90.0)
    found, failed = track_many([SHOTS[0].images, blank], [SHOTS[0].circle, None], sphere_map=False)
    assert not isinstance(found, Exception)
    assert (found.status == "ok").all()
    assert isinstance(failed, ValueError)


def test_a_circle_is_expected_for_each_recording() -> None:
    with pytest.raises(ValueError, match="one for each of 2 recordings, got 1"):
        track_many([SHOTS[0].images] * 2, [SHOTS[0].circle])


def test_no_recordings_give_no_tracks() -> None:
    assert track_many([]) == []
