"""Kinematics: a motion of px and frames in SI units, with uncertainty; `units` converts the numbers.

Errors that all frames share (scale, circle, steady errors of the steps, frame rate, mass) are not part of the rates'
standard deviations and are added here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.depth import Depth
from torchsphere.dynamics.draws import Draws, drawn_motions
from torchsphere.dynamics.scale import Scale
from torchsphere.dynamics.shared_errors import SharedErrors
from torchsphere.dynamics.units import Units, force, interpolated
from torchsphere.estimation.rates import Motion, MotionContact
from torchsphere.motion.track import Track
from torchsphere.runtime.arrays import Array
from torchsphere.runtime.presentation import Tabulated, present

if TYPE_CHECKING:
    import os


@dataclass(frozen=True)
class FoundContact:
    """A contact: start and end (2,), s, their standard deviations, and motions drawn around it."""

    contact_s: Array
    sd_contact_s: Array
    draws: Draws


@dataclass(frozen=True)
class Kinematics(Tabulated):
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
    relative_sd_frame_rate, relative_sd_mass : float
        Relative standard deviations of frame rate and mass. They are part of every ``sd_`` array but those of times:
        the times of frames and contacts share the clock of the frames. An `Impact` states its times with them.
    diameter_m : float or None
        The ball's diameter, as given or by its outline; `torchsphere.impact` takes the ball from here.
    warnings : tuple of str
        Sentences on contradictions between what was given and what the track knew, and on units.
    track : Track or None
        The track that moved so, with the calibration that was used.
    depth : Depth or None
        Motion along the optical axis; None where the ball keeps its distance, or the camera is not known.
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
    relative_sd_frame_rate: float = 0.0
    relative_sd_mass: float = 0.0
    diameter_m: float | None = None
    warnings: tuple[str, ...] = ()
    track: Track | None = field(default=None, repr=False, compare=False)
    depth: Depth | None = None

    @property
    def frame(self) -> NDArray[np.int64]:
        """Numbers (n,) of the frames in the recording."""
        first = round(self.time_s[0] * self.frame_rate) if self.track is None else self.track.first_frame
        return first + np.arange(len(self.time_s))

    def __repr__(self) -> str:
        times = f"{1e3 * self.time_s[0]:.6g} to {1e3 * self.time_s[-1]:.6g} ms"
        parts = [f"{largest(self.velocity_m_s):.4g} m/s", f"{largest(self.spin_rad_s):.4g} rad/s"]
        if self.force_N is not None:
            parts.append(f"{1e-3 * largest(self.force_N):.4g} kN")
        contact = ""
        if self.contact_s is not None:
            contact = f"; contact from {1e3 * self.contact_s[0]:.4f} to {1e3 * self.contact_s[1]:.4f} ms"
        return f"<Kinematics of {len(self.time_s)} frames, {times}: up to {', '.join(parts)}{contact}>"

    def save(
        self,
        folder: str | os.PathLike[str],
        *,
        recording: Any = None,
        normal_deg: float | None = None,
        report: bool = True,
        export: Sequence[str] = (),
        overwrite: bool = False,
    ) -> Path:
        """Write a result folder with track, motion and impacts; arguments and errors as `Track.save`.

        ``normal_deg`` is the target's normal as for `torchsphere.impact`.
        """
        place: Path = present(
            "save",
            self,
            folder,
            recording=recording,
            normal_deg=normal_deg,
            report=report,
            export=export,
            overwrite=overwrite,
        )
        return place


def largest(vectors: Array) -> float:
    """Length of the longest of the vectors (n, k); NaN if none is known."""
    lengths = np.linalg.norm(vectors, axis=1)
    return float(np.nanmax(lengths)) if np.isfinite(lengths).any() else np.nan


def in_si_units(
    track: Track, motion: Motion, time_s: Array, units: Units, mass_kg: float | None, relative_sd_mass: float = 0.0
) -> Kinematics:
    """Motion in SI units with all of its uncertainty."""
    shared, m_per_px = SharedErrors.of(track, units.scale, units.relative_sd_frame_rate), units.scale.m_per_px
    velocity, spin = units.rates(motion.rate)
    acceleration, angular = units.rates(motion.acceleration, 2)
    total_sd = shared.total_sd(motion.rate, np.hypot(motion.sd_rate, shared.steady))
    sd_velocity, sd_spin = units.sd_rates(motion.rate, total_sd)
    intervals: list[Array | None] = [contact.interval for contact in motion.contacts]
    frames = time_s * units.frame_rate
    change = np.max([shared.steady_change(frames, interval, motion.rate) for interval in intervals or [None]], axis=0)
    total_sd = shared.total_sd(motion.acceleration, np.hypot(motion.sd_acceleration, change), motion.rate[:, 4])
    sd_acceleration, sd_angular = units.sd_rates(motion.acceleration, total_sd, 2)
    force_N, sd_force_N = force(acceleration, sd_acceleration, mass_kg, relative_sd_mass)  # noqa: N806  (N is newton)
    path = np.stack([interpolated(column) for column in track.position.T], 1)
    position = (path + motion.offset) * m_per_px * units.axes[:2]
    sd_circle = np.nan_to_num([track.circle.sd_x, track.circle.sd_y])
    contacts = tuple(_found(contact, motion, frames, shared, units) for contact in motion.contacts)
    strongest = next((own for own, c in zip(contacts, motion.contacts, strict=True) if c is motion.strongest), None)
    sd_path = np.hypot(sd_circle, shared.sd_of_path(frames, motion.rate))
    sd_position = np.hypot(np.hypot(motion.sd_offset, sd_path) * m_per_px, position * shared.scale)
    return Kinematics(
        time_s=time_s,
        position_m=position,
        velocity_m_s=velocity,
        acceleration_m_s2=acceleration,
        force_N=force_N,
        spin_rad_s=spin,
        angular_acceleration_rad_s2=angular,
        sd_position_m=sd_position,
        sd_velocity_m_s=sd_velocity,
        sd_acceleration_m_s2=sd_acceleration,
        sd_force_N=sd_force_N,
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
        relative_sd_frame_rate=units.relative_sd_frame_rate,
        relative_sd_mass=relative_sd_mass,
        diameter_m=2 * track.circle.radius * m_per_px,
    )


def _found(contact: MotionContact, motion: Motion, frames: Array, shared: SharedErrors, units: Units) -> FoundContact:
    """A contact in SI units; ``frames`` (n,) are the times of the frames."""
    edges, sd = contact.interval / units.frame_rate, contact.sd_interval / units.frame_rate
    return FoundContact(edges, sd, drawn_motions(contact, motion, frames, shared, units))


def _per_second(about: dict[str, Any], frame_rate: float) -> dict[str, Any]:
    """The description of the method with its frequencies in Hz instead of per frame."""
    result: dict[str, Any] = {}
    for name, value in about.items():
        if name.endswith("_per_frame"):
            result[name.removesuffix("_per_frame") + "_Hz"] = {key: v * frame_rate for key, v in value.items()}
        else:
            result[name] = value
    return result
