"""Conversion from px, rad and frames to SI units, with the errors of the frame rate in the standard deviations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torchsphere.dynamics.scale import LAB_AXES, Scale
from torchsphere.runtime.arrays import Array


@dataclass(frozen=True)
class Units:
    """Conversion from px, rad and frames to SI units and the axes of the results.

    ``relative_sd_frame_rate`` is the relative standard deviation of the frame rate.
    """

    scale: Scale
    frame_rate: float
    lab_frame: bool
    relative_sd_frame_rate: float = 0.0

    @property
    def axes(self) -> Array:
        """Signs (3,) of the results' axes in the camera frame."""
        return np.diag(LAB_AXES) if self.lab_frame else np.ones(3)

    def rates(self, values: Array, order: int = 1) -> tuple[Array, Array]:
        """Derivatives (..., 5) of an order -> (..., 2) and (..., 3)."""
        return self.translation(values[..., :2], order), values[..., 2:] * (self.frame_rate**order * self.axes)

    def translation(self, values: Array, order: int = 1) -> Array:
        """Derivatives (..., 2) of an order of the position, px -> m."""
        return values * (self.frame_rate**order * self.scale.m_per_px * self.axes[:2])

    def sd_rates(self, values: Array, sd: Array, order: int = 1) -> tuple[Array, Array]:
        """Standard deviations (..., 2) and (..., 3) of derivatives (..., 5) of an order, ``values`` with their ``sd``.

        A derivative goes with the frame rate to the power of its order. The error of the scale is part of ``sd``.
        """
        by_rate = order * self.relative_sd_frame_rate * np.nan_to_num(values)
        translation, rotation = self.rates(np.hypot(sd, by_rate), order)
        return np.abs(translation), np.abs(rotation)


def force(
    acceleration: Array, sd: Array, mass_kg: float | None, relative_sd_mass: float
) -> tuple[Array | None, Array | None]:
    """Mass times ``acceleration`` (...), N, and its standard deviation; None without a mass."""
    if mass_kg is None:
        return None, None
    return mass_kg * acceleration, mass_kg * np.hypot(sd, relative_sd_mass * acceleration)


def interpolated(values: Array) -> Array:
    """Values (n,), on straight lines across gaps."""
    frames, known = np.arange(len(values)), np.isfinite(values)
    return np.interp(frames, frames[known], values[known]) if known.any() else values
