"""Free flight at the paper's geometry, for tables 2 and 3: rendered, tracked, and turned into velocities and forces.

Steel ball of 30 mm and 110 g, 36 000 frames per second, 512 x 128 px, shutter 1/81 000 s, noise of 2 grey levels: the
preset ``paper-flight``. The velocity of a frame is its increment over the frame interval, the force is mass times the
difference of two successive velocities over the interval (section 2.2 of the paper), without any smoothing.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from render import preset
from render.shot import Shot

Array = NDArray[np.float64]

FRAME_RATE_HZ, DIAMETER_M, MASS_KG = 36_000.0, 0.030, 0.110


def flight(seed: int, *changes: str, spots: bool = False) -> Shot:
    """A free flight; the seed is that of pattern, sensor and light paths, ``changes`` are ``field.path=value`` each.

    With ``spots`` lighting, paint and sensor are those of the preset ``paper-bar``: three spots, shading, the faint
    gloss of a lacquer and shot noise, instead of light from everywhere on matt paint.
    """
    shot = preset.load("paper-flight", changes, seed)
    if not spots:
        return dataclasses.replace(shot, name="flight")
    bar = preset.load("paper-bar", seed=seed).setup
    setup = dataclasses.replace(shot.setup, ball=bar.ball, lighting=bar.lighting, sensor=bar.sensor)
    return dataclasses.replace(shot, name="flight-spots", setup=setup)


@dataclass(frozen=True)
class Rates:
    """Velocity (n - 1, 2) in m/s of n frames, from the increments alone."""

    velocity_m_s: Array

    @classmethod
    def of(cls, increment: NDArray[Any], m_per_px: float) -> Rates:
        """Velocity from increments (n - 1, 2 or more) in px."""
        return cls(np.asarray(increment[:, :2], dtype=np.float64) * (m_per_px * FRAME_RATE_HZ))

    @property
    def change_m_s(self) -> Array:
        """Differences of successive velocities (n - 2, 2), m/s per frame."""
        return np.diff(self.velocity_m_s, axis=0)

    @property
    def force_kN(self) -> Array:  # noqa: N802  (kN is kilonewton)
        """Mass times acceleration (n - 2, 2), kN."""
        return 1e-3 * MASS_KG * FRAME_RATE_HZ * self.change_m_s


def pooled_std(samples: list[Array]) -> Array:
    """Standard deviation (2,) around each shot's own mean, over shots of (n, 2) values; NaN entries are left out."""
    squares = [np.nansum((values - np.nanmean(values, 0)) ** 2, 0) for values in samples]
    freedom = [np.isfinite(values).sum(0) - 1 for values in samples]
    return np.asarray(np.sqrt(np.sum(squares, 0) / np.sum(freedom, 0)))
