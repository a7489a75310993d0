"""Where the steps on one resolution of the map end."""

import math
from dataclasses import replace

import pytest
import torch
from ball_models import one_share, random, smooth_ball, windows
from shots import rotation_matrix

from torchsphere.sphere_map import forward_model, level
from torchsphere.sphere_map.ball import Poses
from torchsphere.sphere_map.level import COMMON, REWEIGHTED, Level, adjust_level
from torchsphere.sphere_map.pixel_weights import uniform_profile
from torchsphere.sphere_map.state import State, fit_map


@pytest.fixture(scope="module")
def flight() -> State:
    """Ten images of a turning ball with noise of 2 grey levels, and a map that was fitted to them."""
    count, ball = 10, smooth_ball(dtype=torch.float32)
    turns = torch.stack([rotation_matrix(0.3 * i * torch.tensor([0.2, 0.95, 0.25]).double()) for i in range(count)])
    at = Poses.at(torch.tensor([[30.34, 29.61]], dtype=torch.float64).expand(count, 2), turns)
    seen = windows(at, torch.float32)
    levels = forward_model.linearise(seen, at, ball).levels + 2 * random(*seen.levels.shape).float()
    state = State(replace(seen, levels=levels), at, ball, uniform_profile(ball.radius, 4.0))
    return fit_map(state, one_share, 40)[0]


def steps_of(asked: Level, state: State, monkeypatch: pytest.MonkeyPatch) -> int:
    """Number of steps that an adjustment takes."""
    steps = []
    step = level._moved
    monkeypatch.setattr(level, "_moved", lambda *given: steps.append(1) or step(*given))
    adjust_level(state, asked, one_share)
    return len(steps)


def test_a_map_that_will_be_refused_is_left_when_the_weights_stay(
    flight: State, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Nothing ever counts as settled.
    asked = Level(flight.ball.cells, 0.0, REWEIGHTED + 4, is_last=True)
    monkeypatch.setattr(level, "MAX_UNSETTLED_PX", 0.0)
    assert steps_of(asked, flight, monkeypatch) == REWEIGHTED + 4
    assert steps_of(asked._replace(most_residual=1.0), flight, monkeypatch) == REWEIGHTED + 1


def test_moves_settle_in_the_standard_deviations_that_alike_residuals_leave(flight: State) -> None:
    found = adjust_level(flight, Level(flight.ball.cells, 1e-6, 4, is_last=True), one_share)
    asked = Level(flight.ball.cells, 1e-6, 4, is_last=True)
    once, thrice = (asked.settled(flight, found.covariance, factor) for factor in (1.0, 3.0))
    assert float(thrice[0] / once[0]) == pytest.approx(3.0)
    assert 1 < float(thrice[-COMMON] / once[-COMMON]) < 3  # the ball's model adds an error of its own
    assert math.isinf(float(once[-1]))


def test_noise_that_differs_from_pixel_to_pixel_widens_nothing_and_blotches_do(flight: State) -> None:
    assert level._widening(flight) == pytest.approx(1.0, abs=0.2)
    noise = 4 * random(len(flight.poses), 1, 12, 12, seed=5).float()
    blotches = torch.nn.functional.interpolate(noise, flight.windows.levels.shape[1:], mode="bilinear")[:, 0]
    blotched = replace(flight, windows=replace(flight.windows, levels=flight.windows.levels + blotches))
    assert level._widening(blotched) > 1.3
