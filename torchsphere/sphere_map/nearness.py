"""What the images tell of the camera's distance: a ball near the camera shows less than half of its surface.

Without a known distance, a step sideways and a turn by step / distance look alike. The distance itself can be told
apart, as the texture of a turning ball passes its limb in another way. It is one unknown beside map and poses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import elimination
from torchsphere.sphere_map.ball import Poses
from torchsphere.sphere_map.elimination import COMMON, PER_IMAGE, JointEquations
from torchsphere.sphere_map.forward_model import MIN_BLUR_PX, Linearisation
from torchsphere.sphere_map.perspective import Optics
from torchsphere.sphere_map.state import State, drawn

#: Prior standard deviation of the nearness, radius over distance, of a camera that is not known: 33 radii are the
#: distance of half a metre from a ball of 30 mm (docs/constants.md).
UNKNOWN_SD = 0.03

#: Systematic error of a nearness that was measured, and the part of it that looks like a near camera where there is
#: none (docs/constants.md).
SYSTEMATIC_SD, APPARENT_SD = 0.0007, 0.0005

#: Share of the squared residuals that a near camera must explain where the images hardly tell (docs/constants.md).
MIN_GAIN = 0.005

#: Squared residuals with a new map, in those without a near camera, from which no near camera is looked for
#: (docs/constants.md).
HOPELESS = 4.0

#: Largest change of the nearness at once (docs/constants.md).
MAX_CHANGE = 0.1

#: Nearness over which the model's derivative is taken, and conjugate gradients for the response of map and poses.
STEP, SOLVER_STEPS = 0.01, 8


@dataclass(frozen=True)
class NearnessChange:
    """Change of the nearness, and of all else with it."""

    change: Tensor  # ()
    sd: Tensor  # standard deviation () by the images' noise
    of_map: Tensor  # change (m,) of the map per change of the nearness
    step: Tensor  # change (7 n + 2,) of the other unknowns per change of the nearness

    @property
    def total_sd(self) -> float:
        """Standard deviation with the systematic error."""
        return math.hypot(float(self.sd), SYSTEMATIC_SD)

    @property
    def apparent_sd(self) -> float:
        """Standard deviation of the change where the camera is infinitely far away."""
        return math.hypot(float(self.sd), APPARENT_SD)

    @property
    def of_radius(self) -> float:
        """Change of the radius, px, per change of the nearness: a near ball's front seems to turn faster."""
        return float(self.step[-COMMON])

    def applied(self, state: State) -> State:
        """The state after the change of all unknowns."""
        own = self.change * self.step[:-COMMON].unflatten(0, (-1, PER_IMAGE))
        size, blur = self.change * self.step[-COMMON:]
        state = with_nearness(state, nearness_of(state) + self.change)
        ball = state.ball
        ball = replace(
            ball,
            radius=ball.radius + size,
            edge_blur=(ball.edge_blur + blur).clamp_min(MIN_BLUR_PX),
            coefficients=ball.coefficients + self.change.to(self.of_map) * self.of_map,
        )
        return replace(state, ball=ball, poses=state.poses.moved(own[:, :5], ball.radius).brightened(own[:, 5:]))


def measure(state: State, model: Linearisation, joint: JointEquations, shared: RowRunner) -> NearnessChange:
    """Gauss-Newton step of the nearness, map and all poses left free, with ``model`` and ``joint`` at the state."""
    equations, weights = joint.map, joint.map.weights
    nearness = nearness_of(state)
    nearer, farther = (
        drawn(with_nearness(state, nearness + h), shared).levels(state.ball.coefficients) for h in (STEP, -STEP)
    )
    column, residual = (nearer - farther) / (2 * STEP), state.windows.levels - model.levels

    def by_unknowns(values: Tensor) -> Tensor:
        weighted = (weights * values).flatten(1).unsqueeze(1)
        return elimination.spread_gradient(torch.bmm(weighted, model.jacobian)[:, 0].double())

    coupling = equations.design.adjoint(weights * column), by_unknowns(column)
    of_map, step = joint.solve(*coupling, SOLVER_STEPS)
    # With a solution that is not exact the sum of both is never too little.
    back = joint.times(of_map, step)
    taken_up = 2 * _product(coupling, (of_map, step)) - _product(back, (of_map, step))
    own = (weights * column.square()).sum().double() + 1 / UNKNOWN_SD**2
    gradients = equations.gradient(state.ball.coefficients, state.windows.levels), by_unknowns(residual)
    gradient = (weights * column * residual).sum().double() - _product(gradients, (of_map, step))
    gradient = gradient - nearness / UNKNOWN_SD**2
    # What is not known from the images is held by the prior; rounding must not take that away.
    reduced = (own - taken_up).clamp_min(1 / UNKNOWN_SD**2)
    change = (gradient / reduced).nan_to_num(0.0, 0.0, 0.0).clamp(-MAX_CHANGE, MAX_CHANGE)
    return NearnessChange(change, reduced.rsqrt(), -of_map, -step)


def _product(a: tuple[Tensor, Tensor], b: tuple[Tensor, Tensor]) -> Tensor:
    return (a[0] @ b[0]).double() + a[1] @ b[1]


def nearness_of(state: State) -> Tensor:
    """Radius over distance () of the ball."""
    optics = state.windows.optics
    return torch.zeros_like(state.ball.radius) if optics is None else state.ball.radius * optics.per_focal


def with_nearness(state: State, nearness: Tensor) -> State:
    """The state at another ``nearness`` (); what is seen along the line to the ball's centre stays."""
    optics = state.windows.optics
    assert optics is not None
    changed = replace(optics, per_focal=nearness / state.ball.radius)
    return replace(state, windows=state.windows.seen_by(changed), poses=seen_alike(state.poses, optics, changed))


def seen_alike(poses: Poses, before: Optics | None, after: Optics | None) -> Poses:
    """The poses in which the camera ``after`` sees the same side of the ball as the camera ``before``."""
    orientation = poses.orientation
    if before is not None:
        orientation = before.view(poses.centre).along(orientation)
    if after is not None:
        orientation = after.view(poses.centre).turn @ orientation
    return replace(poses, orientation=orientation)
