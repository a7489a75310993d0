"""The fit of the light on a ball whose texture is known to turn."""

from dataclasses import replace

import pytest
import torch
from ball_models import one_share, random, smooth_ball, windows
from shots import rotation_matrix

from torchsphere.sphere_map import forward_model, light
from torchsphere.sphere_map.ball import Poses, uniform_light
from torchsphere.sphere_map.pixel_weights import uniform_profile
from torchsphere.sphere_map.state import State, fit_map, linearised

LIGHT = [1.0, -0.2, 0.1, 0.0]


def lit(turn_rad: float, terms: list[float]) -> State:
    """Ten images of a ball that turns, in that light, and a map that was fitted to them as if light were even."""
    count, ball = 10, smooth_ball(dtype=torch.float32)
    axis = torch.tensor([0.2, 0.95, 0.25], dtype=torch.float64)
    turns = torch.stack([rotation_matrix(turn_rad * i / count * axis) for i in range(count)])
    at = Poses.at(torch.tensor([[30.34, 29.61]], dtype=torch.float64).expand(count, 2), turns)
    seen = windows(at, torch.float32)
    shown = replace(ball, light=torch.tensor(terms, dtype=torch.float64))
    levels = forward_model.linearise(seen, at, shown).levels + 2 * random(*seen.levels.shape).float()
    even = replace(ball, light=uniform_light(ball.light))
    state = State(replace(seen, levels=levels), at, even, uniform_profile(ball.radius, 4.0))
    return fit_map(state, one_share, 40)[0]


def residual(state: State) -> float:
    """Weighted mean square of what the model leaves."""
    levels = forward_model.linearise(state.windows, state.poses, state.ball).levels
    seen = state.windows.visibility
    return float((seen * (state.windows.levels - levels).square()).sum() / seen.sum()) / 4


def test_light_that_stays_while_the_ball_turns_is_found() -> None:
    before = lit(3.0, LIGHT)
    after, share = light.fit_light(before, one_share)
    assert share == 1.0
    assert residual(before) > 3
    assert residual(after) < 1.2
    # The first term scales as the map does.
    found = (after.ball.light / after.ball.light[0]).tolist()
    # A start: sixteen conjugate gradients leave half of a term to the map, and the joint steps go on from there.
    assert found[1:3] == pytest.approx(LIGHT[1:3], abs=0.06)


def test_even_light_stays_even() -> None:
    before = lit(3.0, [1.0, 0.0, 0.0, 0.0])
    after, share = light.fit_light(before, one_share)
    assert share == 0.0
    assert light.unknowns(share) == ()
    assert torch.equal(after.ball.light, before.ball.light)
    assert torch.equal(after.ball.coefficients, before.ball.coefficients)


def test_a_ball_that_hardly_turns_is_fitted_all_the_same() -> None:
    """Map and light can take each other's place: whatever their shares are, together they leave the noise."""
    after, _ = light.fit_light(lit(0.1, LIGHT), one_share)
    assert bool(torch.isfinite(after.ball.light).all())
    assert float(after.ball.light[1:].abs().max()) < 1
    assert residual(after) < 1.2


def test_the_column_of_a_linear_unknown_is_that_of_central_differences() -> None:
    state = lit(3.0, LIGHT)
    model = linearised(state, one_share)
    for term in light.unknowns(1.0):
        found = term.column(state, model, one_share)
        expected = replace(term, is_linear=False).column(state, model, one_share)
        assert float(expected.abs().max()) > 10
        torch.testing.assert_close(found, expected, rtol=0, atol=2e-3)
