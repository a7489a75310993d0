"""How certain the steps between frames on a map of the ball are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torchsphere.sphere_map.bundle_adjustment import Bundle
from torchsphere.sphere_map.registration import Registration

Array = NDArray[np.float64]


def step_covariances(n: int, found: dict[int, Registration], keys: list[int], adjusted: Bundle) -> Array:
    """Covariance (n - 1, 5, 5) of the steps between frames that are both on the map.

    Between keyframes it is that of the adjustment. Elsewhere it is that of the noise of both images, with as much noise
    as `Registration.misfit` finds: the profile is that of images that made the map, and these leave less than their
    noise; all others leave more, by what the map is off by where their pixels fall. Neighbours see that error at other
    places between its cells, so that little of it cancels in a step. What the equations say agrees: the covariance of
    the map's coefficients, radius and outline, carried into every step, adds 1 to 18 % to the variances of the noise,
    and a misfit 6 to 16 %.

    Measured on 100 frames of balls of 20 to 50 px at 0.2 to 5 deg per frame, noise of 0.5 to 6 grey levels and speckle
    of 3 to 6 px: errors of 2277 steps beside the keyframes are 1.05 times what is stated (0.85 to 1.22 by kind of
    ball). Too narrow, 1.13 (1.4 at 20 px and 0.5 deg), is the step in x of a ball that turns about y: only the limb
    tells it from that turn, and there the model errs alike in neighbouring pixels, which no residual shows.
    """
    unit = np.array([1.0, 1.0, *3 * [1 / adjusted.ball.radius]])
    to_units = np.outer(unit, unit)
    between = np.full((n - 1, 5, 5), np.nan)
    place = {i: k for k, i in enumerate(keys)}
    misfits = [registration.misfit for i, registration in found.items() if i not in place]
    # A keyframe's own residual says nothing of the map's errors: it was fitted to it.
    typical = float(np.median(misfits)) if misfits else 1.0

    def own(i: int) -> Array:
        return (typical if i in place else found[i].misfit) * found[i].covariance.numpy()

    for i in range(n - 1):
        if i in place and i + 1 in place:
            between[i] = _difference(adjusted, place[i], place[i + 1]) * to_units
        elif i in found and i + 1 in found:
            between[i] = (own(i) + own(i + 1)) * to_units
    return between


def _difference(adjusted: Bundle, a: int, b: int) -> Array:
    """Covariance (5, 5) of the step from the adjusted pose number ``a`` to number ``b``."""
    spread, first, second = adjusted.covariance, slice(5 * a, 5 * a + 5), slice(5 * b, 5 * b + 5)
    shared = spread[first, second]
    return spread[first, first] + spread[second, second] - shared - shared.T
