"""State of an adjustment: images, poses, ball and residual profile, and the model drawn and linearised there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from torch import Tensor

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import exposure, map_fit, pixel_weights
from torchsphere.sphere_map.ball import Poses, TexturedBall
from torchsphere.sphere_map.forward_model import Design, Linearisation
from torchsphere.sphere_map.map_fit import SMOOTHNESS, MapEquations
from torchsphere.sphere_map.pixel_weights import ResidualProfile
from torchsphere.sphere_map.window import Windows


@dataclass(frozen=True)
class State:
    """Images, poses and ball at one step of an adjustment."""

    windows: Windows  # pixels around the ball in n images, with their visibility
    poses: Poses
    ball: TexturedBall
    profile: ResidualProfile  # variance of the residual by the distance from the outline
    smoothness: float = SMOOTHNESS  # weight of the map's prior: see `map_fit`

    def with_light(self, light: Tensor) -> State:
        """The state with another ``light`` (4,)."""
        return replace(self, ball=replace(self.ball, light=light))


def drawn(state: State, shared: RowRunner) -> Design:
    """The model in all images as a linear function of the map."""
    windows, poses = state.windows, state.poses

    def part(a: int, b: int) -> Design:
        return exposure.design(windows.rows(a, b), poses.take(slice(a, b)), state.ball)

    return Design.joined(shared(part, len(poses)))


def linearised(state: State, shared: RowRunner) -> Linearisation:
    """The model and its derivatives in all images."""
    windows, poses = state.windows, state.poses

    def part(a: int, b: int) -> Linearisation:
        return exposure.linearise(windows.rows(a, b), poses.take(slice(a, b)), state.ball)

    return Linearisation.joined(shared(part, len(poses)))


def fit_map(state: State, shared: RowRunner, steps: int, design: Design | None = None) -> tuple[State, MapEquations]:
    """The state with its map after ``steps`` of conjugate gradients, and the map's equations.

    A ``design`` that is known at these poses saves drawing it.
    """
    weights = state.profile.weights(state.windows, state.poses.centre)
    equations = MapEquations.of(design or drawn(state, shared), weights, shared, state.smoothness)
    coefficients = state.ball.coefficients
    change, _ = equations.solve(equations.gradient(coefficients, state.windows.levels), steps)
    return replace(state, ball=replace(state.ball, coefficients=coefficients + change)), equations


def with_cells(state: State, cells: int) -> State:
    """The state with its map on so many ``cells``."""
    ball = state.ball
    coefficients = map_fit.refined(ball.coefficients, ball.cells, cells)
    return replace(state, ball=replace(ball, cells=cells, coefficients=coefficients))


def reweighted(state: State, residual: Tensor, leverage: Tensor, limit: float = math.inf) -> State:
    """The state with the weights and the visibility that the ``residual`` (n, s, s) suggests.

    ``leverage`` (n, s, s) is the share of the noise that the map has taken up. No ring gets a variance of more than
    ``limit`` times that within the disc.
    """
    centre = state.poses.centre
    profile = pixel_weights.measure_profile(state.windows, centre, residual, state.ball.radius, leverage)
    profile = replace(profile, variance=profile.variance.minimum(limit * profile.variance[0]))
    windows = pixel_weights.estimate_visibility(state.windows, profile.at(state.windows, centre), residual)
    return replace(state, profile=profile, windows=windows)
