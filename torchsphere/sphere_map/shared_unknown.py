"""Unknowns that all images share, beside map, poses, radius and blur: each is a description, and a column of the step.

A column is the change of the drawn grey levels with the unknown, by finite differences: central ones, but of a linear
unknown, where one drawing beside that of the model is exact. What the images do not tell of an unknown is held by its
prior.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import elimination
from torchsphere.sphere_map.elimination import COMMON, GEOMETRY, PER_IMAGE, JointEquations
from torchsphere.sphere_map.forward_model import MIN_BLUR_PX, Linearisation
from torchsphere.sphere_map.state import State, levels_of

#: Most conjugate gradients for the response of map and poses (docs/constants.toml).
SOLVER_STEPS = 60

#: Move, px, that is no move: a response counts by its shares alone.
NO_MOVE_PX = 1e-9


@dataclass(frozen=True)
class SharedUnknown:
    """What the unknown does, and what is known of it beforehand."""

    value: Callable[[State], Tensor]  # the unknown () of a state; 0 is what is expected without the images
    changed: Callable[[State, Tensor], State]  # the state after a change () of the unknown
    step: float  # change over which the model's derivative is taken
    prior_sd: float
    max_change: float  # at once: further away the grey levels are not linear in the unknown
    last_change: float  # below which the unknown has settled
    is_linear: bool = False  # whether the grey levels are

    @property
    def precision(self) -> float:
        """Of the prior."""
        return 1 / self.prior_sd**2

    def column(self, state: State, model: Linearisation, shared: RowRunner) -> Tensor:
        """Change of the drawn grey levels (n, s, s) per change of the unknown, at the ``model`` of the ``state``."""
        step = torch.full_like(state.ball.radius, self.step)
        more = levels_of(self.changed(state, step), shared)
        if self.is_linear:
            return (more - model.levels) / self.step
        return (more - levels_of(self.changed(state, -step), shared)) / (2 * self.step)


#: Unknowns in the order of their columns.
SharedUnknowns = tuple[SharedUnknown, ...]


def with_columns(unknowns: SharedUnknowns, state: State, model: Linearisation, shared: RowRunner) -> Linearisation:
    """The ``model`` at the ``state`` with columns for the ``unknowns`` after those that it has."""
    if not unknowns:
        return model
    columns = [unknown.column(state, model, shared).flatten(1).unsqueeze(-1) for unknown in unknowns]
    return Linearisation(model.levels, torch.cat((model.jacobian, *columns), -1))


def limits(n: int, px: float, of_unknowns: list[float], radius_px: float) -> Tensor:
    """Moves (8 n + k + 2,): ``px`` for n poses, ``radius_px`` for the radius; brightness and blur may move at will."""
    own = torch.full((n, PER_IMAGE), px, dtype=torch.float64)
    own[:, GEOMETRY:] = torch.inf
    return torch.cat((own.flatten(), torch.tensor([*of_unknowns, radius_px, torch.inf], dtype=torch.float64)))


@dataclass(frozen=True)
class SharedChange:
    """Change of an unknown that has no column yet, and of all else with it."""

    unknown: SharedUnknown
    change: Tensor  # ()
    sd: Tensor  # standard deviation () by the images' noise
    of_map: Tensor  # change (m,) of the map per change of the unknown
    step: Tensor  # change (u,) of the other unknowns per change of the unknown

    @property
    def of_radius(self) -> float:
        """Change of the radius, px, per change of the unknown."""
        return float(self.step[-COMMON])

    def applied(self, state: State) -> State:
        """The ``state`` after the change of the unknown, of map, poses and outline."""
        state = self.unknown.changed(state, self.change)
        return moved(state, (), self.change.to(self.of_map) * self.of_map, self.change * self.step)


def moved(state: State, unknowns: SharedUnknowns, of_map: Tensor, step: Tensor) -> State:
    """The ``state`` after a change of the map (m,), and a ``step`` (u,) of all else, the ``unknowns`` included."""
    end = len(state.poses) * PER_IMAGE
    for unknown, change in zip(unknowns, step[end:-COMMON], strict=False):
        state = unknown.changed(state, change)
    own, (size, blur) = step[:end].unflatten(0, (-1, PER_IMAGE)), step[-COMMON:]
    ball = replace(
        state.ball,
        radius=state.ball.radius + size,
        edge_blur=(state.ball.edge_blur + blur).clamp_min(MIN_BLUR_PX),
        coefficients=state.ball.coefficients + of_map,
    )
    poses = state.poses.moved(own[:, :5], ball.radius).enlarged(own[:, 5]).brightened(own[:, GEOMETRY:])
    return replace(state, ball=ball, poses=poses)


def measure(
    unknown: SharedUnknown, state: State, model: Linearisation, joint: JointEquations, shared: RowRunner
) -> SharedChange:
    """The Gauss-Newton step of an ``unknown`` that has no column in the ``joint`` equations of the ``model``."""
    column, value = unknown.column(state, model, shared), unknown.value(state)
    equations, weights = joint.map, joint.map.weights
    residual = state.windows.levels - model.levels

    def by_unknowns(values: Tensor) -> Tensor:
        weighted = (weights * values).flatten(1).unsqueeze(1)
        return elimination.spread_gradient(torch.bmm(weighted, model.jacobian)[:, 0].double())

    coupling = equations.design.adjoint(weights * column), by_unknowns(column)
    others = len(joint.normal) - PER_IMAGE * len(state.poses) - COMMON
    calm = limits(len(state.poses), NO_MOVE_PX, [torch.inf] * others, NO_MOVE_PX).to(coupling[1])
    of_map, of_rest = joint.solve(*coupling, SOLVER_STEPS, calm)
    # With a solution that is not exact the sum of both is never too little.
    back = joint.times(of_map, of_rest)
    taken_up = 2 * _product(coupling, (of_map, of_rest)) - _product(back, (of_map, of_rest))
    own = (weights * column.square()).sum().double() + unknown.precision
    gradients = equations.gradient(state.ball.coefficients, residual), by_unknowns(residual)
    gradient = (weights * column * residual).sum().double() - _product(gradients, (of_map, of_rest))
    gradient = gradient - value * unknown.precision
    # What is not known from the images is held by the prior; rounding must not take that away.
    reduced = (own - taken_up).clamp_min(unknown.precision)
    change = (gradient / reduced).nan_to_num(0.0, 0.0, 0.0).clamp(-unknown.max_change, unknown.max_change)
    return SharedChange(unknown, change, reduced.rsqrt(), -of_map, -of_rest)


def _product(a: tuple[Tensor, Tensor], b: tuple[Tensor, Tensor]) -> Tensor:
    return (a[0] @ b[0]).double() + a[1] @ b[1]
