"""The fit of the light on the ball: it stays while the ball turns, which tells it from the texture."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map.ball import LIGHT_TERMS
from torchsphere.sphere_map.map_fit import MapEquations
from torchsphere.sphere_map.shared_unknown import SharedUnknown, SharedUnknowns
from torchsphere.sphere_map.soft_limit import share_beyond
from torchsphere.sphere_map.state import State, drawn

#: Share of the squared residuals that a light must explain (docs/constants.toml).
MIN_EXPLAINED = 0.01

#: Change of the light, relative to it, below which it has settled (docs/constants.toml).
LAST_CHANGE = 0.0005

#: Share of the squared residuals beside the map from which a light is looked for (docs/constants.toml).
MIN_SEEN = 2e-4

#: Prior standard deviation of the light's terms, and their largest change at once (docs/constants.toml).
TERM_SD, MAX_CHANGE = 0.3, 0.3

#: Conjugate gradients for the map's response to the light, or to the blur (docs/constants.toml).
MAP_STEPS = 8


def fit_light(state: State, shared: RowRunner) -> tuple[State, float]:
    """The state with a first light on the ball, the poses held, and the share of a light from a side that is believed.

    The share is 0, and the light even, where one that differs from side to side explains too little of the residuals.
    Map and light are solved for together: in turns, the map would keep the light that the map has already absorbed.
    """
    seen = _seen_share(state, shared)
    if not seen:
        return state, 0.0
    ball = state.ball
    change, response, explained = _change(state, shared)
    share = seen * share_beyond(explained, MIN_EXPLAINED)
    change = share * (ball.light[1:] + change) - ball.light[1:]
    light = ball.light + torch.cat((torch.zeros_like(change[:1]), change))
    coefficients = ball.coefficients - response @ change.to(response)
    return replace(state, ball=replace(ball, light=light, coefficients=coefficients)), share


def unknowns(share: float) -> SharedUnknowns:
    """The terms of a light from a side that is believed by that ``share``."""
    return tuple(_term(number, TERM_SD * share) for number in range(1, LIGHT_TERMS)) if share else ()


def is_false(terms: Tensor, covariance: Tensor, squares: Tensor) -> bool:
    """Whether a light with these ``terms`` (3,), which count, explains too little of the squares.

    Of the weighted squares () that are left with it, and the ``covariance`` (3, 3) of its terms.
    """
    explained = terms @ torch.linalg.solve(covariance, terms)
    counts = float(terms.abs().max()) > LAST_CHANGE
    return counts and not share_beyond(explained / (squares + explained), MIN_EXPLAINED)


def _term(number: int, prior_sd: float) -> SharedUnknown:
    """The light's term of that ``number``."""

    def value(state: State) -> Tensor:
        return state.ball.light[number]

    def changed(state: State, change: Tensor) -> State:
        added = torch.zeros_like(state.ball.light).index_fill(0, torch.tensor(number, device=change.device), 1.0)
        return state.with_light(state.ball.light + change * added)

    return SharedUnknown(value, changed, TERM_SD, prior_sd, MAX_CHANGE, LAST_CHANGE, is_linear=True)


def _seen_share(state: State, shared: RowRunner) -> float:
    """0 where the residuals hold no more of a light than noise would, 1 where they hold more.

    Most of a light is taken up by the map.
    """
    windows, poses = state.windows, state.poses
    weights = state.profile.weights(windows, poses)
    levels = drawn(state, shared).levels(state.ball.coefficients)
    residual = windows.levels - levels
    x, y = windows.offsets(poses.centre)
    radius = poses.radii(state.ball.radius).to(x).reshape(-1, 1, 1)
    across, down = x / radius, y / radius
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
    weights = state.profile.weights(windows, state.poses)
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
    by_map = equations.gradient(ball.coefficients, residual)
    gradient = (weighted.T @ residual.flatten() - response.T @ by_map).double()
    change = torch.linalg.solve(reduced, gradient)
    squares, terms = (weights * residual.square()).sum().double(), ball.light[1:] + change
    explained = terms @ reduced @ terms
    return change, response, explained / (squares + explained - change @ gradient)
