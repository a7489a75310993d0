"""State of an adjustment: images, poses, ball and residual profile, and the model drawn and linearised there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import exposure, map_fit, pixel_weights
from torchsphere.sphere_map.ball import Poses, TexturedBall
from torchsphere.sphere_map.design import Design
from torchsphere.sphere_map.forward_model import Linearisation
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

    def take(self, rows: Tensor) -> State:
        """The images of the given rows (k,)."""
        return replace(self, windows=self.windows.take(rows), poses=self.poses.take(rows))

    def with_light(self, light: Tensor) -> State:
        """The state with another ``light`` (4,)."""
        return replace(self, ball=replace(self.ball, light=light))


def drawn(state: State, shared: RowRunner) -> Design:
    """The model in all images as a linear function of the map."""
    windows, poses = state.windows, state.poses

    def part(a: int, b: int) -> Design:
        return exposure.design(windows.take(slice(a, b)), poses.take(slice(a, b)), state.ball)

    return Design.joined(shared(part, len(poses)))


def levels_of(state: State, shared: RowRunner) -> Tensor:
    """Grey levels (n, s, s) of the model in all images, in two thirds of the time of `linearised`."""
    windows, poses, ball = state.windows, state.poses, state.ball

    def part(a: int, b: int) -> Tensor:
        return exposure.design(windows.take(slice(a, b)), poses.take(slice(a, b)), ball).levels(ball.coefficients)

    return torch.cat(shared(part, len(poses)))


def linearised(state: State, shared: RowRunner) -> Linearisation:
    """The model and its derivatives in all images."""
    windows, poses = state.windows, state.poses

    def part(a: int, b: int) -> Linearisation:
        return exposure.linearise(windows.take(slice(a, b)), poses.take(slice(a, b)), state.ball)

    return Linearisation.joined(shared(part, len(poses)))


def fit_map(state: State, shared: RowRunner, steps: int, design: Design | None = None) -> tuple[State, MapEquations]:
    """The state with its map after ``steps`` of conjugate gradients, and the map's equations.

    A ``design`` that is known at these poses saves drawing it.
    """
    weights, design = state.profile.weights(state.windows, state.poses), design or drawn(state, shared)
    equations = MapEquations.of(design, weights, shared, state.smoothness)
    coefficients = state.ball.coefficients
    change, _ = equations.solve(equations.gradient(coefficients, unexplained(state, design, shared)), steps)
    return replace(state, ball=replace(state.ball, coefficients=coefficients + change)), equations


def with_cells(state: State, cells: int) -> State:
    """The state with its map on so many ``cells``."""
    ball = state.ball
    coefficients = map_fit.refined(ball.coefficients, ball.cells, cells)
    return replace(state, ball=replace(ball, cells=cells, coefficients=coefficients))


def unexplained(state: State, design: Design, shared: RowRunner) -> Tensor:
    """Grey levels (n, s, s) seen less those of the ``design``."""
    levels, coefficients = state.windows.levels, state.ball.coefficients
    parts = shared(lambda a, b: levels[a:b] - design.rows(a, b).levels(coefficients), len(levels))
    return torch.cat(parts)


def reweighted(state: State, residual: Tensor, leverage: Tensor, shared: RowRunner, limit: float = math.inf) -> State:
    """The state with the weights and the visibility that the ``residual`` (n, s, s) suggests.

    ``leverage`` (n, s, s) is the share of the noise that the map has taken up. No ring gets a variance of more than
    ``limit`` times that within the disc.
    """
    windows, poses = state.windows, state.poses
    sums = shared(
        lambda a, b: pixel_weights.ring_sums(
            windows.take(slice(a, b)), poses.take(slice(a, b)), residual[a:b], state.ball.radius, leverage[a:b]
        ),
        len(windows),
    )
    profile = pixel_weights.profile_of(torch.stack(sums).sum(0), state.ball.radius, state.profile.least)
    profile = replace(profile, variance=profile.variance.minimum(limit * profile.variance[0]))

    def visibility(a: int, b: int) -> Tensor:
        some = windows.take(slice(a, b))
        variance = profile.at(some, poses.take(slice(a, b)))
        return pixel_weights.estimate_visibility(some, variance, residual[a:b]).visibility

    return replace(state, profile=profile, windows=windows.with_visibility(torch.cat(shared(visibility, len(windows)))))
