"""Errors that all frames of a recording share: of the scale, of the radius, and what steps are steadily off by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchsphere.camera import Scale
from torchsphere.drift import STEP_PER_RADIUS
from torchsphere.track import Track

#: Relative change of the rotation for a relative change of the radius. Measured at 0.5 deg per frame and R = 50 px: an
#: error of 1 px in the radius (2 %) changes the rotation by 0.021 deg (4.2 %).
ROTATION_PER_RADIUS = 2.1

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
        return Shared(
            steady=track.sd_steady,
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

    def steady_change(self, frames: Array, contact: Array | None) -> Array:
        """Standard deviation (n, 5) of the steady error's change per frame, at the times ``frames`` (n,).

        Along a flight it may change by its own size; in the contact, start and end (2,) in frames, it becomes another.
        """
        begin, stop = frames[[0, -1]]
        start, end = (stop, stop) if contact is None else contact
        lengths = np.maximum([start - begin, (end - start) / np.sqrt(2), stop - end], 1.0)
        part = (frames > start).astype(int) + (frames >= end)
        return self.steady / lengths[np.where(start < end, part, 0)][:, None]

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

        becoming = (steady[1] - steady[0]) / length[..., None] * ((after > 0) & (after < 1))
        return disturbed(rate + steady[0] * (1 - after) + steady[1] * after), disturbed(acceleration + becoming)
