"""An unknown that all images share, beside map, poses and ball: its Gauss-Newton step with all of these left free."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchsphere.sphere_map import elimination
from torchsphere.sphere_map.elimination import COMMON, PER_IMAGE, JointEquations
from torchsphere.sphere_map.forward_model import MIN_BLUR_PX, Linearisation
from torchsphere.sphere_map.state import State

#: Conjugate gradients for the response of map and poses.
SOLVER_STEPS = 8


@dataclass(frozen=True)
class SharedChange:
    """Change of the unknown, and of all else with it."""

    change: Tensor  # ()
    sd: Tensor  # standard deviation () by the images' noise
    of_map: Tensor  # change (m,) of the map per change of the unknown
    step: Tensor  # change (7 n + 2,) of the other unknowns per change of the unknown

    @property
    def of_radius(self) -> float:
        """Change of the radius, px, per change of the unknown."""
        return float(self.step[-COMMON])

    def followed(self, state: State) -> State:
        """The ``state``, which has the changed unknown already, after the change of all else."""
        own = self.change * self.step[:-COMMON].unflatten(0, (-1, PER_IMAGE))
        size, blur = self.change * self.step[-COMMON:]
        ball = replace(
            state.ball,
            radius=state.ball.radius + size,
            edge_blur=(state.ball.edge_blur + blur).clamp_min(MIN_BLUR_PX),
            coefficients=state.ball.coefficients + self.change.to(self.of_map) * self.of_map,
        )
        return replace(state, ball=ball, poses=state.poses.moved(own[:, :5], ball.radius).brightened(own[:, 5:]))


def measure(
    state: State, model: Linearisation, joint: JointEquations, column: Tensor, value: Tensor, prior_sd: float
) -> SharedChange:
    """The step of an unknown by which the levels have the derivative ``column`` (n, s, s).

    ``model`` and ``joint`` are those at the ``state``. The unknown has the ``value`` there, and a prior of 0 with the
    standard deviation ``prior_sd``.
    """
    equations, weights = joint.map, joint.map.weights
    residual = state.windows.levels - model.levels

    def by_unknowns(values: Tensor) -> Tensor:
        weighted = (weights * values).flatten(1).unsqueeze(1)
        return elimination.spread_gradient(torch.bmm(weighted, model.jacobian)[:, 0].double())

    coupling = equations.design.adjoint(weights * column), by_unknowns(column)
    of_map, step = joint.solve(*coupling, SOLVER_STEPS)
    # With a solution that is not exact the sum of both is never too little.
    back = joint.times(of_map, step)
    taken_up = 2 * _product(coupling, (of_map, step)) - _product(back, (of_map, step))
    own = (weights * column.square()).sum().double() + 1 / prior_sd**2
    gradients = equations.gradient(state.ball.coefficients, state.windows.levels), by_unknowns(residual)
    gradient = (weights * column * residual).sum().double() - _product(gradients, (of_map, step))
    gradient = gradient - value / prior_sd**2
    # What is not known from the images is held by the prior; rounding must not take that away.
    reduced = (own - taken_up).clamp_min(1 / prior_sd**2)
    return SharedChange((gradient / reduced).nan_to_num(0.0, 0.0, 0.0), reduced.rsqrt(), -of_map, -step)


def _product(a: tuple[Tensor, Tensor], b: tuple[Tensor, Tensor]) -> Tensor:
    return (a[0] @ b[0]).double() + a[1] @ b[1]
