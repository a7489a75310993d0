"""Scale of the image in m per px with its uncertainty, and the frame of physical results."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from torchsphere.geometry.circle import Circle
from torchsphere.settings.limits import as_positive, as_share

#: From the camera frame (y down, z away from the camera) to the lab frame (y up, z towards the camera).
LAB_AXES = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class Scale:
    """Size of a pixel in the plane of the ball's centre.

    Attributes
    ----------
    m_per_px, sd_m_per_px : float
        Size and its standard deviation, m; the standard deviation is 0 if the scale was given as exact.
    origin : str
        Source of the scale, in words.
    relative_sd_given : float
        Relative standard deviation of the diameter or pixel size that was given, a part of ``sd_m_per_px``.
    """

    m_per_px: float
    sd_m_per_px: float
    origin: str
    relative_sd_given: float = 0.0


def distance_error(nearness: float, sd_nearness: float) -> float:
    """Relative error (rms) of lengths in units of the outline, as the camera's distance is not known.

    With a ``nearness`` k, radius over distance, the outline is larger than the ball at its depth by ``k^2 / 2``, and a
    path beside the axis longer by ``k^2``. For a normal k of mean 0 the rms of ``k^2 / 2`` is ``sqrt(3) / 2 sd^2``.
    """
    return math.hypot(nearness * sd_nearness, math.sqrt(3) / 2 * sd_nearness**2)


def scale(
    circle: Circle,
    *,
    diameter_m: float | None = None,
    m_per_px: float | None = None,
    relative_sd: float = 0.0,
    sd_by_distance: float = 0.0,
) -> Scale:
    """Scale from the ball's diameter and its outline, or as given.

    ``relative_sd`` is the relative standard deviation of the given diameter or pixel size, ``sd_by_distance`` that of
    lengths over the outline by `distance_error`. Raises ValueError unless exactly one of both is given, finite and
    positive, and ``relative_sd`` is in [0, 1).
    """
    relative = as_share("relative_sd_scale", relative_sd)
    if (diameter_m is None) == (m_per_px is None):
        raise ValueError("scale: give either the ball's diameter or the size of a pixel")
    name, given = ("diameter_m", diameter_m) if m_per_px is None else ("m_per_px", m_per_px)
    length = as_positive(name, given, "a finite, positive length in m")
    if m_per_px is not None:
        size, sd, origin = length, 0.0, "given" if relative else "given, taken as exact"
    else:
        size = length / (2 * circle.radius)
        # The uncertainty of a given circle is unknown, and the summary says so.
        by_radius = 0.0 if math.isnan(circle.sd_radius) else circle.sd_radius / circle.radius
        sd = size * math.hypot(by_radius, sd_by_distance)
        origin = f"ball of {1e3 * length:g} mm over an outline of radius {circle.radius:.3f} px"
    if relative:
        sd, origin = math.hypot(sd, size * relative), f"{origin}, itself known to {100 * relative:.2g} %"
    return Scale(size, sd, origin, relative)
