"""Motion along the optical axis of a ball whose image grows, by a camera whose focal length or distance is known.

A ball of the radius r at the depth z has an outline of the radius R = f r / z, with the focal length f in px: the depth
is as well known as the outline's radius, in relation to it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from torchsphere.dynamics.depth import Depth
from torchsphere.dynamics.units import Units, force, interpolated
from torchsphere.estimation.measurements import FREEDOMS
from torchsphere.estimation.rates import Motion
from torchsphere.motion.track import Track
from torchsphere.runtime.arrays import Array

#: Depth, and what the smoother takes it for: the second of its coordinates along the image.
ALONG, DEPTH = 0, 1


def is_known(track: Track) -> bool:
    """Whether the depth is measured: the image of the ball grows, and the camera was given."""
    grows = track.settings.get("model") == "pinhole6" and bool((np.nan_to_num(track.sd_growth) > 0).any())
    return grows and track.settings.get("camera") is not None and not track.findings.camera_assumed


def depth(
    plane: Track,
    motion: Motion,
    frames: Array,
    units: Units,
    mass_kg: float | None,
    relative_sd_mass: float,
    differentiate: Callable[[Track], Motion],
) -> Depth:
    """The motion along the axis of a track, moved to the ``plane`` of the first depth, whose motion there is known.

    ``frames`` (n,) are the times of its frames, in frames.
    ``differentiate`` gives the rates of a track, as it gave that ``motion``. They are those of the depth beside the
    coordinate of the image along which the force is largest, so that both have one contact.
    """
    found, unit_m = _beside(plane, motion, units.scale.m_per_px)
    rates = differentiate(found)
    sign, rate = float(units.axes[2]), units.frame_rate
    first, second = (unit_m * values[:, DEPTH] for values in (rates.rate, rates.acceleration))
    size = unit_m * (interpolated(found.position[:, DEPTH]) + rates.offset[:, DEPTH])
    # The error of the radius that all frames share moves the depth as a whole, and its rates twice as much.
    given, by_radius = units.scale.relative_sd_given, plane.circle.sd_radius / plane.circle.radius
    alike = float(np.hypot(given, np.nan_to_num(by_radius)))
    twice = float(np.hypot(given, 2 * np.nan_to_num(by_radius)))
    velocity, acceleration = first * rate, second * rate**2
    sd_velocity = _total(unit_m * rates.sd_rate[:, DEPTH] * rate, velocity, twice, units.relative_sd_frame_rate)
    sd_acceleration = _total(
        unit_m * rates.sd_acceleration[:, DEPTH] * rate**2, acceleration, twice, 2 * units.relative_sd_frame_rate
    )
    acceleration = sign * acceleration
    pushed, sd_force = force(acceleration, sd_acceleration, mass_kg, relative_sd_mass)
    along = Depth(
        z_m=sign * size,
        velocity_m_s=sign * velocity,
        acceleration_m_s2=acceleration,
        force_N=pushed,
        sd_z_m=_total(unit_m * rates.sd_offset[:, DEPTH], size, alike),
        sd_velocity_m_s=sd_velocity,
        sd_acceleration_m_s2=sd_acceleration,
        sd_force_N=sd_force,
    )
    angles = _angles(along, motion, frames, units)
    return replace(along, out_of_plane_deg=angles[0], sd_out_of_plane_deg=angles[1])


def _beside(plane: Track, motion: Motion, m_per_px: float) -> tuple[Track, float]:
    """The track with one coordinate of the image and the depth as its position, and the unit of the depth, m.

    The unit makes the errors of both as large, for which the smoother is made.
    """
    focal = float(plane.settings["camera"]["focal_px"])
    distance = focal * plane.circle.radius / plane.radius
    sd_step = distance[1:] * plane.sd_growth
    strongest = int(np.nan_to_num(np.abs(motion.acceleration[:, :2])).max(0).argmax())
    order = [strongest, strongest, *range(2, FREEDOMS)]
    covariance = plane.covariance[:, order][:, :, order]
    known = sd_step > 0
    ratio = float(np.sqrt(np.nanmedian(covariance[:, ALONG, ALONG])) / np.median(sd_step[known]))
    covariance[:, DEPTH, :], covariance[:, :, DEPTH] = 0.0, 0.0
    covariance[:, DEPTH, DEPTH] = np.where(known, (ratio * sd_step) ** 2, np.nan)
    increment = plane.increment[:, order]
    increment[:, DEPTH] = np.where(known & np.isfinite(increment[:, ALONG]), ratio * np.diff(distance), np.nan)
    position = np.column_stack((plane.position[:, strongest], ratio * distance))
    return replace(plane, position=position, increment=increment, covariance=covariance), m_per_px / ratio


def _total(own: Array, values: Array, *relative: float) -> Array:
    """Standard deviations of the frames' ``own`` errors and of ``relative`` ones that all frames share."""
    return np.hypot(own, float(np.linalg.norm(relative)) * values)


def _angles(along: Depth, motion: Motion, frames: Array, units: Units) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """`Depth.out_of_plane_deg` and its standard deviations, by the mean velocities of the flights."""
    across = units.rates(motion.rate)[0]
    sd_across = np.linalg.norm(units.sd_rates(motion.rate, motion.sd_rate)[0], axis=1)
    edges = [-np.inf, *np.concatenate([contact.interval for contact in motion.contacts] or [np.empty(0)]), np.inf]
    angles, sds = [], []
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        flies = (frames >= start) & (frames <= end) & np.isfinite(along.velocity_m_s) & np.isfinite(across[:, 0])
        if not flies.any():
            continue
        speed, away = float(np.linalg.norm(across[flies].mean(0))), float(along.velocity_m_s[flies].mean())
        sd_speed, sd_away = float(np.median(sd_across[flies])), float(np.median(along.sd_velocity_m_s[flies]))
        angles.append(float(np.degrees(np.arctan2(away, speed))))
        sds.append(float(np.degrees(np.hypot(speed * sd_away, away * sd_speed) / (speed**2 + away**2))))
    return tuple(angles), tuple(sds)
