"""An unknown that all images share, beside map, poses and ball: its Gauss-Newton step with all of these left free."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import elimination
from torchsphere.sphere_map.elimination import COMMON, PER_IMAGE, JointEquations
from torchsphere.sphere_map.forward_model import MIN_BLUR_PX, Linearisation
from torchsphere.sphere_map.state import State, drawn

#: Conjugate gradients for the response of map and poses.
SOLVER_STEPS = 8


@dataclass(frozen=True)
class SharedUnknown:
    """What the unknown does, and what is known of it beforehand."""

    changed: Callable[[State, Tensor], State]  # the state after a change () of the unknown
    step: float  # change over which the model's derivative is taken
    prior_sd: float  # standard deviation of the unknown, which is 0 without the images
    max_change: float  # at once: further away the grey levels are not linear in the unknown


@dataclass(frozen=True)
class SharedChange:
    """Change of the unknown, and of all else with it."""

    unknown: SharedUnknown
    change: Tensor  # ()
    sd: Tensor  # standard deviation () by the images' noise
    of_map: Tensor  # change (m,) of the map per change of the unknown
    step: Tensor  # change (7 n + 2,) of the other unknowns per change of the unknown

    @property
    def of_radius(self) -> float:
        """Change of the radius, px, per change of the unknown."""
        return float(self.step[-COMMON])

    def applied(self, state: State) -> State:
        """The ``state`` after the change of all unknowns."""
        state = self.unknown.changed(state, self.change)
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
    unknown: SharedUnknown, value: Tensor, state: State, model: Linearisation, joint: JointEquations, shared: RowRunner
) -> SharedChange:
    """The step of the ``unknown``, which has the ``value`` () at the ``state``.

    ``model`` and ``joint`` are those there.
    """
    step, coefficients = torch.full_like(value, unknown.step), state.ball.coefficients
    more, less = (drawn(unknown.changed(state, h), shared).levels(coefficients) for h in (step, -step))
    column = (more - less) / (2 * unknown.step)
    equations, weights = joint.map, joint.map.weights
    residual = state.windows.levels - model.levels

    def by_unknowns(values: Tensor) -> Tensor:
        weighted = (weights * values).flatten(1).unsqueeze(1)
        return elimination.spread_gradient(torch.bmm(weighted, model.jacobian)[:, 0].double())

    coupling = equations.design.adjoint(weights * column), by_unknowns(column)
    of_map, of_rest = joint.solve(*coupling, SOLVER_STEPS)
    # With a solution that is not exact the sum of both is never too little.
    back = joint.times(of_map, of_rest)
    taken_up = 2 * _product(coupling, (of_map, of_rest)) - _product(back, (of_map, of_rest))
    own = (weights * column.square()).sum().double() + 1 / unknown.prior_sd**2
    gradients = equations.gradient(state.ball.coefficients, state.windows.levels), by_unknowns(residual)
    gradient = (weights * column * residual).sum().double() - _product(gradients, (of_map, of_rest))
    gradient = gradient - value / unknown.prior_sd**2
    # What is not known from the images is held by the prior; rounding must not take that away.
    reduced = (own - taken_up).clamp_min(1 / unknown.prior_sd**2)
    change = (gradient / reduced).nan_to_num(0.0, 0.0, 0.0).clamp(-unknown.max_change, unknown.max_change)
    return SharedChange(unknown, change, reduced.rsqrt(), -of_map, -of_rest)


def _product(a: tuple[Tensor, Tensor], b: tuple[Tensor, Tensor]) -> Tensor:
    return (a[0] @ b[0]).double() + a[1] @ b[1]
