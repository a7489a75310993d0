"""Errors that all frames of a recording share: of the scale, of the radius, and what steps are steadily off by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchsphere.camera import Scale
from torchsphere.drift import STEP_PER_RADIUS
from torchsphere.poses import on_map, steady_share
from torchsphere.track import Track

#: Relative change of the rotation for a relative change of the radius. Measured at 0.5 deg per frame and R = 50 px: an
#: error of 1 px in the radius (2 %) changes the rotation by 0.021 deg (4.2 %).
ROTATION_PER_RADIUS = 2.1

#: Least that all steps of a flight may be off by, px and rad: the bias of steps that do not depend on their noise, over
#: patterns, speckle sizes and rendered shots 0.001 to 0.004 px and 0.001 to 0.003 deg, with a map a seventh of it.
STEADY = np.array([0.002, 0.002, *3 * [np.radians(0.002)]])
ON_MAP = 1 / 7

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shared:
    """Standard deviations of what all frames share.

    The scale's and the radius's are taken as independent, although one may come from the other: how they add up
    differs with the direction of the rotation.

    Attributes
    ----------
    steady : ndarray
        Of all steps of a flight (5,), px and rad per frame.
    scale : float
        Of all lengths, relative.
    step : float
        By the radius, px per frame for each rad per frame of rotation.
    rotation : float
        Of all rotations by the radius, relative.
    """

    steady: Array
    scale: float
    step: float
    rotation: float

    @staticmethod
    def of(track: Track, scale: Scale) -> Shared:
        """What the frames of a track share; a circle without an uncertainty adds none, and the summary says so."""
        sd_radius = float(np.nan_to_num(track.circle.sd_radius))
        own = np.diagonal(track.covariance, axis1=1, axis2=2)
        known = np.isfinite(own)
        typical = [np.sqrt(np.median(own[known[:, k], k])) if known[:, k].any() else 0.0 for k in range(5)]
        return Shared(
            steady=np.hypot(steady_share(track) * np.array(typical), STEADY * (ON_MAP if on_map(track) else 1)),
            scale=scale.sd_m_per_px / scale.m_per_px,
            step=STEP_PER_RADIUS * sd_radius,
            rotation=ROTATION_PER_RADIUS * sd_radius / track.circle.radius,
        )

    def sd(self, values: Array, own: Array) -> Array:
        """Standard deviations (n, 5) of rates or accelerations, with what each has of its ``own``."""
        # The error of a step goes with the rotation: that of x with the one about y.
        of_radius = self.step * np.nan_to_num(values[:, [3, 2]])
        steps = np.hypot(np.hypot(own[:, :2], of_radius), self.scale * values[:, :2])
        return np.concatenate((steps, np.hypot(own[:, 2:], self.rotation * values[:, 2:])), 1)

    def draw(self, rate: Array, acceleration: Array, frames: Array, edges: Array) -> tuple[Array, Array]:
        """Drawn rates and accelerations (s, n, 5), each with a scale, a radius and steady errors of its own.

        ``frames`` (n,) are their times and ``edges`` (s, 2) start and end of the contact.
        """
        generator = np.random.default_rng(0)
        steady = self.steady * generator.normal(size=(2, len(rate), 1, 5))
        # The steady error goes with the rotation, so that it changes in the contact.
        length = np.maximum(edges[:, 1:] - edges[:, :1], 1e-9)
        after = np.nan_to_num(np.clip((frames - edges[:, :1]) / length, 0, 1))[..., None]
        scale, step, rotation = generator.normal(size=(3, len(rate), 1, 1))

        def disturbed(values: Array) -> Array:
            of_radius = self.step * step * np.nan_to_num(values[..., [3, 2]])
            moved = (values[..., :2] + of_radius) * (1 + self.scale * scale)
            return np.concatenate((moved, values[..., 2:] * (1 + self.rotation * rotation)), -1)

        return disturbed(rate + steady[0] * (1 - after) + steady[1] * after), disturbed(acceleration)
