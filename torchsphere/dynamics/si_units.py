"""Conversion of px and frames to SI units, with uncertainty: the only place at which px become m.

Errors that all frames share (scale, circle, steady errors of the steps) are not part of the rates' standard deviations
and are added here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.scale import LAB_AXES, Scale
from torchsphere.dynamics.shared_errors import SharedErrors
from torchsphere.estimation.rates import Motion, MotionContact, MotionSamples
from torchsphere.tracking.result import Track

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Draws:
    """Motions (s of them) around a contact, drawn within the errors of data and calibration.

    Attributes
    ----------
    velocity_m_s, acceleration_m_s2 : ndarray
        (s, m, 2).
    spin_rad_s : ndarray
        (s, m, 3).
    contact_s : ndarray
        Start and end of the contact (s, 2).
    span : slice
        The m of the n frames that they cover.
    """

    velocity_m_s: Array
    acceleration_m_s2: Array
    spin_rad_s: Array
    contact_s: Array
    span: slice


@dataclass(frozen=True)
class FoundContact:
    """A contact: start and end (2,), s, their standard deviations, and motions drawn around it."""

    contact_s: Array
    sd_contact_s: Array
    draws: Draws


@dataclass(frozen=True)
class Kinematics:
    """Motion of the ball in SI units, at the times of the frames; NaN in frames that were not measured.

    The smoother bridges gaps, with an uncertainty that grows inside them. Local polynomials do not, and differences
    have no value in the first and the last frame. Every ``sd_`` array is the standard deviation of the array it names.

    Attributes
    ----------
    time_s : ndarray
        (n,), 0 at the first image of the recording.
    position_m, velocity_m_s, acceleration_m_s2 : ndarray
        (n, 2) as (x, y); positions from the image's first pixel.
    force_N : ndarray or None
        (n, 2), mass times acceleration; None without a mass.
    spin_rad_s, angular_acceleration_rad_s2 : ndarray
        (n, 3).
    scale : Scale
    frame_rate : float
        Frames per second.
    lab_frame : bool
        False: camera frame (y down, z away from the camera). True: lab frame (y up, z towards the camera).
    mass_kg : float or None
    contact_s : ndarray or None
        Start and end (2,) of the contact, of several the strongest; None if no contact was found or sought.
    sd_contact_s : ndarray or None
    draws : Draws or None
        None if no contact was found or sought.
    about : dict
        Method, parameters and effective bandwidth, for the summary.
    contacts : tuple of FoundContact
        All contacts, in the order of their times.
    is_measured : ndarray or None
        (n,), bool, False in frames whose position was not measured.
    """

    time_s: Array
    position_m: Array
    velocity_m_s: Array
    acceleration_m_s2: Array
    force_N: Array | None  # noqa: N815  (N is newton)
    spin_rad_s: Array
    angular_acceleration_rad_s2: Array
    sd_position_m: Array
    sd_velocity_m_s: Array
    sd_acceleration_m_s2: Array
    sd_force_N: Array | None  # noqa: N815
    sd_spin_rad_s: Array
    sd_angular_acceleration_rad_s2: Array
    scale: Scale
    frame_rate: float
    lab_frame: bool
    mass_kg: float | None
    contact_s: Array | None
    sd_contact_s: Array | None
    draws: Draws | None
    about: dict[str, Any]
    contacts: tuple[FoundContact, ...] = ()
    is_measured: NDArray[np.bool_] | None = None

    def __repr__(self) -> str:
        times = f"{1e3 * self.time_s[0]:.6g} to {1e3 * self.time_s[-1]:.6g} ms"
        parts = [f"{largest(self.velocity_m_s):.4g} m/s", f"{largest(self.spin_rad_s):.4g} rad/s"]
        if self.force_N is not None:
            parts.append(f"{1e-3 * largest(self.force_N):.4g} kN")
        contact = ""
        if self.contact_s is not None:
            contact = f"; contact from {1e3 * self.contact_s[0]:.4f} to {1e3 * self.contact_s[1]:.4f} ms"
        return f"<Kinematics of {len(self.time_s)} frames, {times}: up to {', '.join(parts)}{contact}>"


def largest(vectors: Array) -> float:
    """Length of the longest of the vectors (n, k); NaN if none is known."""
    lengths = np.linalg.norm(vectors, axis=1)
    return float(np.nanmax(lengths)) if np.isfinite(lengths).any() else np.nan


@dataclass(frozen=True)
class Units:
    """Conversion from px, rad and frames to SI units and the axes of the results."""

    scale: Scale
    frame_rate: float
    lab_frame: bool

    @property
    def axes(self) -> Array:
        """Signs (3,) of the results' axes in the camera frame."""
        return np.diag(LAB_AXES) if self.lab_frame else np.ones(3)

    def rates(self, values: Array, order: int = 1) -> tuple[Array, Array]:
        """Derivatives (..., 5) of an order -> (..., 2) and (..., 3)."""
        per_time = values * self.frame_rate**order
        return per_time[..., :2] * self.scale.m_per_px * self.axes[:2], per_time[..., 2:] * self.axes

    def sd_rates(self, sd: Array, order: int = 1) -> tuple[Array, Array]:
        """Standard deviations (..., 5) of the derivatives of an order -> (..., 2) and (..., 3)."""
        translation, rotation = self.rates(sd, order)
        return np.abs(translation), np.abs(rotation)


def in_si_units(track: Track, motion: Motion, time_s: Array, units: Units, mass_kg: float | None) -> Kinematics:
    """Motion in SI units with all of its uncertainty."""
    shared, m_per_px = SharedErrors.of(track, units.scale), units.scale.m_per_px
    velocity, spin = units.rates(motion.rate)
    acceleration, angular = units.rates(motion.acceleration, 2)
    sd_velocity, sd_spin = units.sd_rates(shared.total_sd(motion.rate, np.hypot(motion.sd_rate, shared.steady)))
    intervals: list[Array | None] = [contact.interval for contact in motion.contacts]
    frames = time_s * units.frame_rate
    change = np.max([shared.steady_change(frames, interval, motion.rate) for interval in intervals or [None]], axis=0)
    total_sd = shared.total_sd(motion.acceleration, np.hypot(motion.sd_acceleration, change), motion.rate[:, 4])
    sd_acceleration, sd_angular = units.sd_rates(total_sd, 2)
    position = (_interpolated(track.position) + motion.offset) * m_per_px * units.axes[:2]
    sd_circle = np.nan_to_num([track.circle.sd_x, track.circle.sd_y])
    contacts = tuple(_found(contact, time_s, shared, units) for contact in motion.contacts)
    strongest = next((own for own, c in zip(contacts, motion.contacts, strict=True) if c is motion.strongest), None)
    sd_path = np.hypot(sd_circle, shared.sd_of_path(time_s * units.frame_rate, motion.rate))
    sd_position = np.hypot(np.hypot(motion.sd_offset, sd_path) * m_per_px, position * shared.scale)
    return Kinematics(
        time_s=time_s,
        position_m=position,
        velocity_m_s=velocity,
        acceleration_m_s2=acceleration,
        force_N=None if mass_kg is None else mass_kg * acceleration,
        spin_rad_s=spin,
        angular_acceleration_rad_s2=angular,
        sd_position_m=sd_position,
        sd_velocity_m_s=sd_velocity,
        sd_acceleration_m_s2=sd_acceleration,
        sd_force_N=None if mass_kg is None else mass_kg * sd_acceleration,
        sd_spin_rad_s=sd_spin,
        sd_angular_acceleration_rad_s2=sd_angular,
        scale=units.scale,
        frame_rate=units.frame_rate,
        lab_frame=units.lab_frame,
        mass_kg=mass_kg,
        contact_s=None if strongest is None else strongest.contact_s,
        sd_contact_s=None if strongest is None else strongest.sd_contact_s,
        draws=None if strongest is None else strongest.draws,
        about=_per_second(motion.about, units.frame_rate),
        contacts=contacts,
        is_measured=np.isfinite(track.position[:, 0]),
    )


def _found(contact: MotionContact, time_s: Array, shared: SharedErrors, units: Units) -> FoundContact:
    """A contact in SI units."""
    edges, sd = contact.interval / units.frame_rate, contact.sd_interval / units.frame_rate
    return FoundContact(edges, sd, _draws(contact.samples, time_s, shared, units))


def _draws(drawn: MotionSamples, time_s: Array, shared: SharedErrors, units: Units) -> Draws:
    """Drawn motions in SI units, each with shared errors of its own."""
    frames = time_s[drawn.span] * units.frame_rate
    rate, acceleration = shared.draw(drawn.rate, drawn.acceleration, frames, drawn.interval)
    velocity, spin = units.rates(rate)
    return Draws(velocity, units.rates(acceleration, 2)[0], spin, drawn.interval / units.frame_rate, drawn.span)


def _interpolated(position: Array) -> Array:
    """Positions (n, 2), on straight lines across gaps."""
    frames, known = np.arange(len(position)), np.isfinite(position[:, 0])
    if not known.any():
        return position
    return np.stack([np.interp(frames, frames[known], position[known, k]) for k in (0, 1)], 1)


def _per_second(about: dict[str, Any], frame_rate: float) -> dict[str, Any]:
    """The description of the method with its frequencies in Hz instead of per frame."""
    result: dict[str, Any] = {}
    for name, value in about.items():
        if name.endswith("_per_frame"):
            result[name.removesuffix("_per_frame") + "_Hz"] = {key: v * frame_rate for key, v in value.items()}
        else:
            result[name] = value
    return result
