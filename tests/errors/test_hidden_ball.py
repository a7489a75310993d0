"""A ball hidden in many frames: which recordings count as such, and what becomes of their errors."""

import numpy as np
import pytest
from shots import Shot, clean, covered, noisy, pixel_grid, textured

import torchsphere as ts
from torchsphere.errors import hidden_ball
from torchsphere.errors.hidden_ball import is_hidden_often

RADIUS, SHAPE = 20.0, (80, 400)


def hidden(status: list[str], *, x: float = 60.0, step: float = 5.0) -> bool:
    """Whether a ball counts as hidden that is at ``x`` in frame 0, and moves by ``step`` px per frame to the right."""
    statuses = np.array(status)
    position = np.stack((x + step * np.arange(len(status)), np.full(len(status), 40.0)), 1)
    position[statuses == "lost"] = np.nan
    increment = np.diff(np.pad(position, ((0, 0), (0, 3))), axis=0)
    return is_hidden_often(statuses, position, increment, RADIUS, SHAPE)


def test_many_frames_that_were_not_measured_in_view_are_those_of_a_hidden_ball() -> None:
    assert hidden(["ok"] * 5 + ["lost"] * 5 + ["ok"] * 2)
    assert hidden(["ok"] * 5 + ["not_converged"] * 5)
    assert hidden(["lost"] * 6 + ["ok"] * 6)
    assert not hidden(["ok"] * 9 + ["lost"] * 3)
    assert not hidden(["weak_texture"] * 12)
    assert not hidden(["lost"] * 12)


def test_frames_before_the_ball_came_in_view_and_after_it_left_do_not_count() -> None:
    assert not hidden(["lost"] * 6 + ["ok"] * 6, x=-20.0)
    assert not hidden(["ok"] * 6 + ["out_of_frame"] * 6)


@pytest.fixture(scope="module")
def flight() -> Shot:
    return clean(n=12, radius=RADIUS, start=(40.0, 40.0), step=(6.0, 0.2), turn_deg=0.8)


def test_the_errors_of_a_ball_that_a_plate_hides_in_half_of_the_frames_are_twice_as_large(flight: Shot) -> None:
    images = flight.images[:, :80, :160]
    x, _ = pixel_grid(images)
    behind = covered(images, (x >= 72).float()[None], textured(5, 1.7, 45.0)[:80, :160])
    tracks = [ts.track(noisy(i, 2.0, 7), flight.circle, sphere_map=False, log=False) for i in (images, behind)]
    assert [track.findings.hidden for track in tracks] == [False, True]
    sd = [np.sqrt(track.covariance[0, 0, 0]) for track in tracks]
    assert sd[1] == pytest.approx(hidden_ball.WIDENING * sd[0], rel=0.2)
    assert any("something stands in front" in sentence for sentence in tracks[1].warnings)
