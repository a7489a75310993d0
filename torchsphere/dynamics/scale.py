"""From px to m: the scale of the image and its uncertainty, and the frame of physical results."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from torchsphere.geometry.circle import Circle
from torchsphere.settings.limits import positive

#: From the camera frame (y down, z away from the camera) to the lab frame (y up, z towards the camera).
LAB_AXES = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class Scale:
    """Size of a pixel in the plane of the ball's centre.

    Attributes
    ----------
    m_per_px, sd_m_per_px : float
        Size and its standard deviation, m; the latter is 0 where the scale was given as exact.
    origin : str
        Where it comes from, in words.
    """

    m_per_px: float
    sd_m_per_px: float
    origin: str


def scale(circle: Circle, *, diameter_m: float | None = None, m_per_px: float | None = None) -> Scale:
    """Scale from the ball's diameter and its outline, or as given.

    Raises
    ------
    ValueError
        Unless exactly one of both is given, finite and positive.
    """
    if (diameter_m is None) == (m_per_px is None):
        raise ValueError("scale: give either the ball's diameter or the size of a pixel, not both and not neither")
    name, given = ("diameter_m", diameter_m) if m_per_px is None else ("m_per_px", m_per_px)
    value = positive(name, given, "a finite, positive length in m")
    if m_per_px is not None:
        return Scale(value, 0.0, "given, taken as exact")
    size = value / (2 * circle.radius)
    # A circle that was given has no stated uncertainty; what it adds is then unknown and the summary says so.
    sd = 0.0 if math.isnan(circle.sd_radius) else size * circle.sd_radius / circle.radius
    return Scale(size, sd, f"ball of {1e3 * value:g} mm over an outline of radius {circle.radius:.3f} px")
