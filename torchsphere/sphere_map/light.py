"""The fit of the light on the ball: it stays while the ball turns, which tells it from the texture."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map.ball import LIGHT_TERMS, TexturedBall
from torchsphere.sphere_map.map_fit import MapEquations
from torchsphere.sphere_map.soft_limit import share_beyond
from torchsphere.sphere_map.state import State, drawn

#: Share of the squared residuals that a light must explain, and largest number of its changes (docs/constants.toml).
MIN_EXPLAINED, ROUNDS = 0.01, 3

#: Change of the light, relative to it, that needs no further one (docs/constants.toml).
LAST_CHANGE = 0.0005

#: Share of the squared residuals beside the map from which a light is looked for (docs/constants.toml).
MIN_SEEN = 2e-4

#: Prior standard deviation of the light's terms (docs/constants.toml).
TERM_SD = 0.3

#: Conjugate gradients for the map's response to the light, or to the blur (docs/constants.toml).
MAP_STEPS = 16


def fit_light(state: State, shared: RowRunner) -> State:
    """Fit the light on the ball, if a light that differs from side to side explains enough of the residuals.

    Map and light are solved for together: in turns, the map would keep the light that the map has already absorbed.
    """
    seen = 1.0 if is_lit_from_a_side(state.ball) else _seen_share(state, shared)
    if not seen:
        return state
    for _ in range(ROUNDS):
        state, change = changed(state, shared, seen)
        if change < LAST_CHANGE:
            break
    return state


def changed(state: State, shared: RowRunner, seen: float = 1.0) -> tuple[State, float]:
    """The state after one change of light and map, the poses held, and the largest change of a term of the light.

    ``seen`` is the share of a light that is taken over.
    """
    ball = state.ball
    change, response, explained = _change(state, shared)
    change = seen * share_beyond(explained, MIN_EXPLAINED) * (ball.light[1:] + change) - ball.light[1:]
    light = ball.light + torch.cat((torch.zeros_like(change[:1]), change))
    coefficients = ball.coefficients - response @ change.to(response)
    return replace(state, ball=replace(ball, light=light, coefficients=coefficients)), float(change.abs().max())


def is_lit_from_a_side(ball: TexturedBall) -> bool:
    """Whether the light differs from side to side."""
    return bool(ball.light[1:].any())


def _seen_share(state: State, shared: RowRunner) -> float:
    """0 where the residuals hold no more of a light than noise would, 1 where they hold more.

    Most of a light is taken up by the map.
    """
    windows, poses = state.windows, state.poses
    weights = state.profile.weights(windows, poses.centre)
    levels = drawn(state, shared).levels(state.ball.coefficients)
    residual = windows.levels - levels
    x, y = windows.offsets(poses.centre)
    across, down = x / state.ball.radius.to(x), y / state.ball.radius.to(y)
    depth = 1 - across.square() - down.square()
    weights = torch.where(depth > 0, weights, 0.0)
    normals = (across.expand_as(depth), down.expand_as(depth), depth.clamp_min(0).sqrt())
    columns = torch.stack([(levels * normal).flatten() for normal in normals], 1)
    weighted = weights.flatten().unsqueeze(1) * columns
    gradient = weighted.T @ residual.flatten()
    seen = gradient @ torch.linalg.solve(weighted.T @ columns, gradient)
    return share_beyond(seen, MIN_SEEN * (weights * residual.square()).sum())


def _change(state: State, shared: RowRunner) -> tuple[Tensor, Tensor, Tensor]:
    """Change of the light's last three terms, response (m, 3) of the map, and share of the squares that they explain.

    The first term is left out: it scales as the map does. The share is that of the changed light, of the squares that
    would be left without any.
    """
    ball, windows = state.ball, state.windows
    weights = state.profile.weights(windows, state.poses.centre)
    equations = MapEquations.of(drawn(state, shared), weights, shared, state.smoothness)
    residual = windows.levels - equations.design.levels(ball.coefficients)
    units = torch.eye(LIGHT_TERMS, dtype=ball.light.dtype, device=ball.light.device)[1:]
    by_light = [drawn(state.with_light(unit), shared).map_levels(ball.coefficients) for unit in units]
    coupling = [equations.design.adjoint(weights * column) for column in by_light]
    solved = [equations.solve(column, MAP_STEPS) for column in coupling]
    response, rest = (torch.stack(part, 1) for part in zip(*solved, strict=True))
    columns = torch.stack([column.flatten() for column in by_light], 1)
    weighted = weights.flatten().unsqueeze(1) * columns
    # Never more is taken up by the map than the whole, though its equations are not quite solved.
    taken_up = torch.stack(coupling, 1).T @ response + response.T @ rest
    reduced = (columns.T @ weighted - taken_up).double() + torch.eye(len(units), device=rest.device) / TERM_SD**2
    by_map = equations.gradient(ball.coefficients, windows.levels)
    gradient = (weighted.T @ residual.flatten() - response.T @ by_map).double()
    change = torch.linalg.solve(reduced, gradient)
    squares, terms = (weights * residual.square()).sum().double(), ball.light[1:] + change
    explained = terms @ reduced @ terms
    return change, response, explained / (squares + explained - change @ gradient)
