"""Where the steps on one resolution of the map end."""

from dataclasses import replace

import pytest
import torch
from ball_models import one_share, random, smooth_ball, windows
from shots import rotation_matrix

from torchsphere.sphere_map import forward_model, level
from torchsphere.sphere_map.ball import Poses
from torchsphere.sphere_map.level import REWEIGHTED, Level, adjust_level
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
