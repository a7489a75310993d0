"""A ball is out of the frame only where its last measured flight leads out of the image; else it is lost."""

import numpy as np
import pytest
import torch
from shots import noisy, shot

from torchsphere.geometry.circle import Circle
from torchsphere.tracking.follow import has_left
from torchsphere.tracking.prediction import BallState
from torchsphere.tracking.record import Record
from torchsphere.tracking.track import track

RADIUS, SHAPE = 10.0, (100, 200)


def left_from(
    path: list[tuple[float, float]], last: int, *, sd: float = 0.02, hidden: tuple[int, ...] = ()
) -> list[int]:
    """Frames in which a ball on the ``path`` counts as out of the image, found up to frame ``last`` but when hidden."""
    record = Record.empty(len(path), Circle(*path[0], RADIUS, frame=0))
    noise = np.random.default_rng(1).normal(0, sd, (len(path), 2))
    record.position[: last + 1] = np.array(path)[: last + 1] + noise[: last + 1]
    record.position[list(hidden)] = np.nan
    record.increment[:, :2] = np.diff(record.position, axis=0)
    record.covariance[:] = 2 * sd**2 * np.eye(5)
    nothing = torch.zeros(5, dtype=torch.float64)
    centre = torch.from_numpy(record.position[last])
    state = BallState(last, torch.zeros(1, *SHAPE), centre, RADIUS, nothing, nothing, 0.0)
    for frame in range(last + 1, len(path)):
        if has_left(record, state, frame):
            record.status[frame] = "out_of_frame"
    return np.flatnonzero(record.status == "out_of_frame").tolist()


def straight(start: float, step: float, count: int) -> list[tuple[float, float]]:
    return [(start + step * i, 50.0) for i in range(count)]


@pytest.mark.parametrize(("start", "step"), [(160.0, 6.0), (40.0, -6.0), (100.0, 40.0), (187.5, 0.4)])
def test_a_ball_that_flies_out_is_out_of_the_frame_from_where_less_than_half_of_it_is_in(
    start: float, step: float
) -> None:
    path = straight(start, step, 40)
    out = [i for i, (x, _) in enumerate(path) if not 0 <= x <= SHAPE[1] - 1]
    # The texture of a ball at the edge is lost when less than about two thirds of it are in the image.
    last = next(i for i, (x, _) in enumerate(path) if not 4 <= x <= SHAPE[1] - 5) - 1
    found = left_from(path, last)
    assert abs(found[0] - out[0]) <= 1
    assert found == list(range(found[0], 40))


def test_a_ball_that_was_lost_on_its_way_to_the_edge_stays_lost() -> None:
    assert left_from(straight(30.0, 8.0, 40), 6) == []


def test_a_ball_that_is_not_seen_in_the_last_frame_before_it_leaves_is_out_of_the_frame() -> None:
    # A long exposure smears its image over the edge.
    assert left_from(straight(100.0, 40.0, 12), 1, hidden=()) == []
    assert left_from(straight(30.0, 40.0, 12), 3)[0] == 5


def test_a_ball_that_falls_on_a_target_in_the_image_is_lost_and_not_below_the_image() -> None:
    falling = [(100.0, 10.0 + 5.0 * i) for i in range(13)]
    assert left_from([*falling, *[(100.0, 70.0 - 3.0 * i) for i in range(40)]], 12) == []


def test_a_ball_that_turns_before_the_edge_is_lost() -> None:
    # 0.2 px per frame^2 of gravity: it turns 14 px below the upper edge.
    thrown = [(100.0, 14.0 + 0.1 * (i - 22) ** 2) for i in range(45)]
    assert left_from(thrown, 18) == []


def test_uncertain_positions_and_single_steps_show_no_leaving() -> None:
    path = straight(160.0, 6.0, 20)
    assert left_from(path, 5, sd=0.02) != []
    assert left_from(path, 5, sd=4.0) == []
    assert left_from(path, 5, hidden=(4,)) == []
    assert left_from(straight(180.0, 6.0, 20), 1) == []


def test_a_ball_that_disappears_in_the_image_is_never_out_of_the_frame() -> None:
    made = shot(3, n=24, radius=20.0, step=(6.0, 0.0), start=(60.0, 60.0), rotation_deg=(0.2, 0.5, 0.2))
    images = made.images[:, :120, :160].clone()
    # At frame 8 the ball is in the middle; by its motion it would have left at frame 17.
    images[8:] = noisy(torch.full((16, 120, 160), 90.0), 2.0, 4)
    found = track(images, made.circle, sphere_map=False, log=False)
    assert (found.status[1:8] == "ok").all()
    assert np.isnan(found.position[8:]).all()
    assert "out_of_frame" not in found.status
