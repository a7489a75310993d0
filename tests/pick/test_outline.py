"""The circle of the page: found, fitted, and its edge."""

import math

import numpy as np
import pytest

from torchsphere.geometry.circle import Circle
from torchsphere.pick import outline
from torchsphere.pick.footage import Footage
from torchsphere.recording.recording import Recording
from torchsphere.synthetic import demo_shot as demo


@pytest.fixture
def footage(recording: Recording) -> Footage:
    return Footage(recording)


def test_the_ball_is_found_in_the_chosen_frames_as_a_measurement_finds_it(
    footage: Footage, demo_shot: demo.Shot
) -> None:
    found = outline.find_ball(footage, 2, 8).circle
    assert found.frame == 2
    # Three standard deviations of the circle of one frame, 0.1 px.
    np.testing.assert_allclose((found.x, found.y), demo_shot.position[2], atol=0.3)
    assert found.radius == pytest.approx(demo.RADIUS_PX, abs=0.3)


def test_without_a_ball_a_sentence_says_so(footage: Footage) -> None:
    everything = np.ones(footage.shape, dtype=bool)
    everything[:3, :3] = False
    with pytest.raises(ValueError, match="no ball was found in 8 frames"):
        outline.find_ball(footage, 0, 8, everything)


@pytest.mark.parametrize("away", [(1.5, -1.0, 1.0), (5.0, -4.0, -5.0)])
def test_a_circle_drawn_by_hand_is_fitted_to_the_edge(
    footage: Footage, demo_shot: demo.Shot, away: tuple[float, float, float]
) -> None:
    x, y = demo_shot.position[4]
    drawn = Circle(x + away[0], y + away[1], demo.RADIUS_PX + away[2], frame=4)
    fitted = outline.fit_circle(footage, drawn).circle
    assert fitted.frame == 4
    # Three standard deviations of the limb of one frame.
    assert math.hypot(fitted.x - x, fitted.y - y) < 0.4
    assert fitted.radius == pytest.approx(demo.RADIUS_PX, abs=0.4)


def test_a_circle_without_an_edge_is_refused_in_one_sentence(footage: Footage) -> None:
    with pytest.raises(ValueError, match="no outline was found near the circle"):
        outline.fit_circle(footage, Circle(230.0, 60.0, 20.0))
    with pytest.raises(ValueError, match="lies outside the image"):
        outline.unrolled_edge(footage, Circle(-30.0, 60.0, 20.0))


def test_the_unrolled_edge_has_the_background_outside_the_right_circle_alone(
    footage: Footage, demo_shot: demo.Shot
) -> None:
    x, y = demo_shot.position[0]
    edge = outline.unrolled_edge(footage, Circle(x, y, demo.RADIUS_PX))
    assert edge.levels.shape[1] == len(edge.steps)
    assert edge.steps[0] == -edge.steps[-1] == -outline.REACH_PX
    outside, inside = edge.steps > 1.5, edge.steps < -1.5
    # Noise of 2 levels, a little of it smoothed by the spline.
    assert np.nanstd(edge.levels[:, outside]) < 3
    assert np.nanstd(edge.levels[:, inside]) > 30
    assert edge.mean[outside] == pytest.approx(demo.BACKGROUND, abs=1.5)


def test_rays_that_leave_the_image_have_no_level(footage: Footage) -> None:
    edge = outline.unrolled_edge(footage, Circle(10.0, 90.0, 40.0))
    assert np.isnan(edge.levels).any(0).all()
    assert np.isfinite(edge.mean).all()
