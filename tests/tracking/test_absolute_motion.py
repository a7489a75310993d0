"""Poses of the map beside those of the pairs: gaps between frames on the map, and frames that an object shades."""

import numpy as np
import pytest
import torch
from shots import rotation_matrix

from torchsphere.geometry.circle import Circle
from torchsphere.sphere_map import decision
from torchsphere.sphere_map.decision import MadeMap
from torchsphere.sphere_map.poses import MapPoses
from torchsphere.tracking import absolute_motion
from torchsphere.tracking.record import Record

N, GAP = 9, slice(3, 6)

#: Errors of each pair's step, px and rad: they add up.
STEP_PX, STEP_RAD = np.array([0.02, -0.01]), np.array([0.001, -0.003, 0.002])

TRUE_STEP, TRUE_TURN = np.array([3.0, 0.4]), np.array([0.02, 0.05, -0.01])


def turned(vectors: np.ndarray) -> np.ndarray:
    """Rotation matrices (n, 3, 3)."""
    return np.stack([rotation_matrix(torch.from_numpy(vector)).numpy() for vector in vectors])


def moving() -> tuple[np.ndarray, np.ndarray]:
    i = np.arange(N)[:, None]
    return 50 + i * TRUE_STEP, turned(i * TRUE_TURN)


def by_map() -> MapPoses:
    """The true poses."""
    position, orientation = moving()
    variance = np.tile(np.diag([1e-4, 1e-4, 1e-6, 1e-6, 1e-6]), (N - 1, 1, 1))
    motion = position, orientation, np.full(N, 20.0), variance, np.zeros(N - 1)
    return MapPoses(*motion, Circle(50.0, 50.0, 20.0), 4, 0.3, 1.0, np.full(N, 0.9))


def by_pairs() -> tuple[Record, np.ndarray]:
    """Steps with an error that is the same in all of them, and the chained orientations."""
    i = np.arange(N)[:, None]
    position, orientation = moving()
    found = Record.empty(N, Circle(50.0, 50.0, 20.0))
    found.position[:] = position + i * STEP_PX
    found.increment[:] = np.concatenate((TRUE_STEP + STEP_PX, TRUE_TURN + STEP_RAD))
    found.covariance[:] = np.diag([1e-4, 1e-4, 1e-6, 1e-6, 1e-6])
    found.uneven_light[:] = True
    return found, turned(i * STEP_RAD) @ orientation


def test_what_the_steps_of_a_gap_have_too_much_is_shared_out_among_its_frames() -> None:
    measured, chained = by_pairs()
    found = by_map()
    position, orientation = moving()
    found.position[GAP], found.orientation[GAP] = np.nan, np.nan
    motion = absolute_motion._merged(measured, chained, found)
    np.testing.assert_allclose(motion.position, position, atol=1e-12)
    np.testing.assert_allclose(motion.orientation, orientation, atol=1e-6)
    assert isinstance(motion.map, MadeMap)
    assert motion.map.frames == N - 3
    np.testing.assert_array_equal(motion.covariance[3], measured.covariance[3])


@pytest.mark.parametrize("gap", [slice(0, 2), slice(6, N)], ids=["before the first", "after the last"])
def test_frames_beyond_the_map_follow_from_its_nearest_frame(gap: slice) -> None:
    measured, chained = by_pairs()
    found = by_map()
    position, _ = moving()
    found.position[gap], found.orientation[gap] = np.nan, np.nan
    nearest = 2 if gap.start == 0 else 5
    expected = position + (np.arange(N) - nearest)[:, None] * STEP_PX
    motion = absolute_motion._merged(measured, chained, found)
    np.testing.assert_allclose(motion.position[gap], expected[gap], atol=1e-12)


def shaded(offset_px: float, misfit: float, *, uneven: bool = True) -> list[int]:
    """Numbers of the frames that count as shaded, with the map off by so much in the gap."""
    measured, _ = by_pairs()
    measured.uneven_light[:] = uneven
    found = by_map()
    found.position[GAP] += offset_px
    found.frame_misfit[GAP] = misfit
    return list(np.flatnonzero(absolute_motion._shaded(measured, found)))


def test_frames_in_which_uneven_light_contradicts_the_map_are_shaded() -> None:
    """A step differs with a variance of 2e-4 px^2 in each direction; the pairs' own errors make it 9.5 variances."""
    limit_px = (decision.MAX_DISAGREEMENT * 1e-4) ** 0.5
    assert shaded(1.5 * limit_px, 2.0) == [3, 4, 5]
    assert shaded(0.2 * limit_px, 2.0) == []


def test_a_map_that_explains_a_frame_as_well_as_others_is_right_against_the_pairs() -> None:
    assert shaded(1.0, 1.0) == []


def test_without_light_from_an_object_the_map_is_right_against_the_pairs() -> None:
    assert shaded(1.0, 2.0, uneven=False) == []
