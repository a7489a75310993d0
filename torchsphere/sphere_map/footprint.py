"""The fit of the blur of a pixel's footprint on the ball.

Optics blur the image, not the surface: where the surface is tilted away, the blur reaches further on it. The map holds
the blur in front. In a blurred image both are the blur of the optics. In a sharp one the blur of the outline is the
start of the fit, not its result, as it may have other causes.
"""

from __future__ import annotations

import math
from dataclasses import replace

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map.light import MAP_STEPS
from torchsphere.sphere_map.map_fit import MapEquations
from torchsphere.sphere_map.state import State, drawn

#: Blur of the outline, px, up to which the image is taken as sharp (docs/constants.toml).
SHARP_PX = 0.2

#: Limits of the variance of the blur, px^2, its step for the derivative, and number of changes (docs/constants.toml).
LEAST_VARIANCE_PX2, MAX_VARIANCE_PX2, DERIVATIVE_STEP_PX2, ROUNDS = 0.01, 16.0, 0.1, 4

#: Change of the variance, px^2, after which no further one is needed (docs/constants.toml).
LAST_CHANGE_PX2 = 0.005


def fit_footprint(state: State, shared: RowRunner) -> State:
    """Fit the variance of the footprint's blur together with the map, the poses held; none for a sharp outline."""
    blur = float(state.ball.edge_blur)
    if blur <= SHARP_PX:
        return _with_variance(state, 0.0)
    if not state.ball.footprint_blur:
        state = _with_variance(state, min(blur**2, MAX_VARIANCE_PX2))
    for _ in range(ROUNDS):
        before = state.ball.footprint_blur**2
        state = _changed(state, shared)
        if abs(state.ball.footprint_blur**2 - before) < LAST_CHANGE_PX2:
            break
    return state


def with_footprint_of_outline(state: State) -> State:
    """The footprint blurred as the outline is: so it is where the optics alone blur the outline."""
    return _with_variance(state, min(float(state.ball.edge_blur) ** 2, MAX_VARIANCE_PX2))


def _with_variance(state: State, variance: float) -> State:
    return replace(state, ball=replace(state.ball, footprint_blur=math.sqrt(variance)))


def _changed(state: State, shared: RowRunner) -> State:
    """The state after one Gauss-Newton step of the variance and of the map."""
    ball, windows = state.ball, state.windows
    weights = state.profile.weights(windows, state.poses)
    equations = MapEquations.of(drawn(state, shared), weights, shared, state.smoothness)
    coefficients, variance = ball.coefficients, ball.footprint_blur**2
    more = drawn(_with_variance(state, variance + DERIVATIVE_STEP_PX2), shared).map_levels(coefficients)
    column = (more - equations.design.map_levels(coefficients)) / DERIVATIVE_STEP_PX2
    coupling = equations.design.adjoint(weights * column)
    response, rest = equations.solve(coupling, MAP_STEPS)
    reduced = (weights * column.square()).sum() - coupling @ response - response @ rest
    residual = windows.levels - equations.design.levels(coefficients)
    gradient = (weights * column * residual).sum() - response @ equations.gradient(coefficients, residual)
    # A sharp footprint has fewer rays, so that the derivative would not be one there.
    wanted = float((variance + gradient / reduced.clamp_min(1e-12)).clamp(LEAST_VARIANCE_PX2, MAX_VARIANCE_PX2))
    state = _with_variance(state, wanted)
    return replace(state, ball=replace(state.ball, coefficients=coefficients - (wanted - variance) * response))
