"""Numbers of a motion along the optical axis, as they are computed, written and read."""

from __future__ import annotations

from dataclasses import dataclass

from torchsphere.runtime.arrays import Array


@dataclass(frozen=True)
class Depth:
    """Motion along the optical axis at the times of n frames; NaN where it is not known.

    Every ``sd_`` array is the standard deviation of the array it names. The axis points away from the camera, in the
    lab frame towards it; the camera is at 0.
    """

    z_m: Array  # (n,)
    velocity_m_s: Array  # (n,)
    acceleration_m_s2: Array  # (n,)
    force_N: Array | None  # noqa: N815  (n,), newton; None without a mass
    sd_z_m: Array
    sd_velocity_m_s: Array
    sd_acceleration_m_s2: Array
    sd_force_N: Array | None  # noqa: N815
    # Angles of the flights before, between and after the contacts to the image's plane, deg, positive along the axis.
    out_of_plane_deg: tuple[float, ...] = ()
    sd_out_of_plane_deg: tuple[float, ...] = ()
