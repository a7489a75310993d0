"""Choice of the keyframes."""

import numpy as np
from scipy.spatial.transform import Rotation

from torchsphere.sphere_map import keyframes
from torchsphere.sphere_map.keyframes import (
    APART_DEG,
    MAX_KEYFRAMES,
    MIN_KEYFRAMES,
    MIN_OF_LARGE,
    MIN_VIEWS,
    SPREAD_OVER,
)

RADIUS = 50.0


def spinning(frames: int, step_deg: float, axis: tuple[float, float, float] = (0.1, 1.0, 0.2)) -> np.ndarray:
    """Orientations (n, 3, 3) of a ball that turns evenly."""
    unit = np.array(axis) / np.linalg.norm(axis)
    return Rotation.from_rotvec(np.outer(np.radians(step_deg) * np.arange(frames), unit)).as_matrix()


def nearest_deg(orientation: np.ndarray, chosen: list[int]) -> np.ndarray:
    """Angle (n,) from each frame's direction of view to the nearest of the keyframes, deg, seen from the ball."""
    cosine = (orientation[:, 2] @ orientation[chosen, 2].T).max(1)
    return np.degrees(np.arccos(cosine.clip(-1, 1)))


def test_a_spinning_ball_has_its_keyframes_in_its_first_turn_and_all_its_directions_covered() -> None:
    orientation = spinning(1000, 3.0)
    chosen = keyframes.choose_keyframes(np.arange(1000), orientation, RADIUS)
    assert chosen == sorted(set(chosen))
    assert chosen[0] == 0
    assert chosen[-1] < 120
    assert MIN_KEYFRAMES <= len(chosen) <= 24
    assert nearest_deg(orientation, chosen).max() <= APART_DEG


def test_every_side_is_seen_often_enough() -> None:
    for step_deg in (0.5, 1.0, 3.0):
        orientation = spinning(300, step_deg)
        chosen = keyframes.choose_keyframes(np.arange(300), orientation, RADIUS)
        views = (orientation[:, 2] @ orientation[chosen, 2].T).clip(0).sum(1)
        assert views[: chosen[-1] + 1].min() >= MIN_VIEWS or len(chosen) >= MAX_KEYFRAMES - 1


def test_a_ball_that_tumbles_is_covered_from_all_sides() -> None:
    first = spinning(600, 5.0)
    orientation = spinning(600, 1.7, (1.0, 0.0, 0.3)) @ first
    chosen = keyframes.choose_keyframes(np.arange(600), orientation, RADIUS)
    assert len(chosen) <= MAX_KEYFRAMES
    assert nearest_deg(orientation, chosen).max() <= APART_DEG


def test_a_still_ball_has_its_keyframes_evenly_over_the_first_frames() -> None:
    orientation = spinning(1000, 0.0)
    chosen = keyframes.choose_keyframes(np.arange(1000), orientation, RADIUS)
    assert len(chosen) == MIN_KEYFRAMES
    assert chosen[0] == 0
    assert chosen[-1] == SPREAD_OVER - 1
    gaps = np.diff(chosen)
    assert gaps.max() - gaps.min() <= 1


def test_few_frames_are_all_keyframes() -> None:
    assert keyframes.choose_keyframes(np.arange(7), spinning(7, 0.5), RADIUS) == list(range(7))


def test_frames_without_a_pose_are_no_keyframes() -> None:
    orientation = spinning(100, 4.0)
    orientation[::3] = np.nan
    known = np.flatnonzero(np.isfinite(orientation[:, 0, 0]))
    chosen = keyframes.choose_keyframes(known, orientation, RADIUS)
    assert set(chosen) <= set(known.tolist())
    assert chosen[0] == known[0]
    assert nearest_deg(orientation[known], np.searchsorted(known, chosen).tolist()).max() <= 80


def test_frames_of_the_fine_map_hold_the_keyframes_and_lie_evenly_in_their_time() -> None:
    known, keys = np.arange(5, 400), [5, 40, 90, 200]
    chosen = keyframes.choose_map_frames(known, keys, 60)
    assert len(chosen) <= 60
    assert len(chosen) > 55
    assert set(keys) <= set(chosen.tolist())
    assert (np.diff(chosen) > 0).all()
    assert chosen[-1] == keys[-1]
    assert np.diff(chosen).max() <= 2 * (keys[-1] - keys[0]) / 60 + 1


def test_without_room_for_further_frames_the_fine_map_has_the_keyframes_alone() -> None:
    keys = [0, 4, 9]
    assert keyframes.choose_map_frames(np.arange(10), keys, 3).tolist() == keys
    assert keyframes.choose_map_frames(np.array(keys), keys, 50).tolist() == keys


def test_a_large_ball_needs_fewer_keyframes() -> None:
    orientation = spinning(300, 0.1)
    counts = [len(keyframes.choose_keyframes(np.arange(300), orientation, radius)) for radius in (20.0, 70.0, 200.0)]
    assert counts[0] == MIN_KEYFRAMES
    assert MIN_OF_LARGE < counts[1] < MIN_KEYFRAMES
    assert counts[2] == MIN_OF_LARGE
