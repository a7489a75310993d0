"""Whether a map of the ball is made, refused, and used for a frame."""

import numpy as np
import pytest

from torchsphere.sphere_map.decision import (
    MIN_FRAMES,
    SHADED_MISFIT,
    Why,
    few_poses,
    lacks_frames,
    not_needed,
    refusal,
    refused_as_unsettled,
    shaded_frames,
)

N = 9
GOOD = {"radius": 30.0, "given_radius": 30.2, "edge_blur": 0.4, "optics_px": 0.3, "misfit": 1.1}


def test_a_map_is_made_of_frames_enough_with_a_rotation_by_a_rigid_model() -> None:
    position, rotation = np.zeros((N, 2)), np.zeros((N, 3))
    assert not_needed(None, "rigid", position, rotation) is None
    for asked, model, turns, frames, why in (
        (False, "rigid", rotation, N, Why.NOT_ASKED),
        (None, "translation", rotation, N, Why.MODEL),
        (None, "rigid", rotation * np.nan, N, Why.NO_ROTATION),
        (None, "rigid", rotation, MIN_FRAMES - 1, Why.FEW_FRAMES),
    ):
        known = np.where(np.arange(N)[:, None] < frames, position, np.nan)
        found = not_needed(asked, model, known, turns)
        assert found is not None
        assert found.why is why
        assert not found.is_needed
    asked_for = not_needed(True, "translation", position, rotation)
    assert asked_for is not None
    assert asked_for.is_needed
    assert few_poses(MIN_FRAMES) is None
    assert few_poses(MIN_FRAMES - 1) is not None


@pytest.mark.parametrize(
    ("change", "why"),
    [({"misfit": 5.0}, Why.MISFIT), ({"edge_blur": 3.0}, Why.BLURRED_OUTLINE), ({"radius": 33.0}, Why.RADIUS)],
)
def test_a_map_is_refused_for_one_reason(change: dict[str, float], why: Why) -> None:
    assert refusal(**GOOD) is None
    refused = refusal(**(GOOD | change))
    assert refused is not None
    assert refused.why is why


def test_a_map_whose_poses_have_not_settled_is_refused() -> None:
    assert refused_as_unsettled(True) is None
    refused = refused_as_unsettled(False)
    assert refused is not None
    assert refused.why is Why.NOT_SETTLED


def test_a_map_may_lack_a_tenth_of_the_known_frames() -> None:
    known = np.arange(30) < 20
    assert not lacks_frames(known, known & (np.arange(30) >= 2))
    assert lacks_frames(known, known & (np.arange(30) >= 3))


def test_frames_that_a_step_contradicts_and_the_map_explains_less_well_are_not_used() -> None:
    difference, covariance = np.zeros((N - 1, 5)), np.tile(np.eye(5), (N - 1, 1, 1))
    # The step into frame 3 is 5 standard deviations off.
    difference[2, 0] = 5.0
    compared, on_map, misfit = np.ones(N - 1, dtype=bool), np.ones(N, dtype=bool), np.ones(N)
    assert not shaded_frames(difference, covariance, compared, misfit, on_map).any()
    misfit[3:6] = 1.1 * SHADED_MISFIT
    assert np.flatnonzero(shaded_frames(difference, covariance, compared, misfit, on_map)).tolist() == [3, 4, 5]
    # Frame 8 is explained as badly, and no step contradicts it.
    misfit[8] = misfit[3]
    assert np.flatnonzero(shaded_frames(difference, covariance, compared, misfit, on_map)).tolist() == [3, 4, 5]
    compared[2] = False
    assert not shaded_frames(difference, covariance, compared, misfit, on_map).any()
