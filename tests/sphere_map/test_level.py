"""Where the steps on one resolution of the map end."""

from dataclasses import replace

import pytest
import torch
from ball_models import one_share, random, smooth_ball, windows
from shots import rotation_matrix

from torchsphere.sphere_map import forward_model, level
from torchsphere.sphere_map.ball import Poses
from torchsphere.sphere_map.elimination import PER_IMAGE, PLACE
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


def test_each_unknown_takes_the_share_of_its_step_by_which_it_would_not_go_back() -> None:
    before, step = torch.tensor([1.0, 1.0, 1.0, 0.0]), torch.tensor([-1.0, 0.5, -0.6, 0.0])
    first = level._share_of_step(None, None, before)
    assert first.tolist() == [1.0, 1.0, 1.0, 1.0]
    # To and fro: half a step ends in the middle. One that goes on is taken whole.
    assert level._share_of_step(first, before, step).tolist() == [0.5, 1.0, 0.625, 1.0]


def test_the_place_of_a_ball_that_stays_is_no_reason_to_go_on(flight: State) -> None:
    asked = Level(flight.ball.cells, 0.0005, 3, is_last=True)
    stays = replace(flight, ball=replace(flight.ball, stays=True))
    found = adjust_level(stays, asked, one_share)
    moved = asked.settled(stays, found.covariance)[: PER_IMAGE * len(flight.poses)].reshape(-1, PER_IMAGE)
    assert set(moved[:, :PLACE].flatten().tolist()) == {level.MAX_UNSETTLED_PX}
    assert float(moved[:, PLACE:5].max()) < 0.5 * level.MAX_UNSETTLED_PX
    assert float(torch.diff(found.state.poses.centre, dim=0).abs().max()) < 1e-6
