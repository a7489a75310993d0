"""Rehearsal of an impact: a simulated measurement with increments of a given covariance.

Half a sine of force throws a flying ball back, and friction spins it up. Its true motion with errors of the expected
size makes a track. The package's own smoother processes this track as after the test: the smoother finds its
intensities and the contact from the data.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.kinematics import Kinematics, kinematics
from torchsphere.geometry.circle import Circle
from torchsphere.geometry.orientation import chain
from torchsphere.planning.expected import Setup
from torchsphere.tracking.result import Track
from torchsphere.tracking.steady_error import sd_steady

#: Frames of flight before and after the contact, and the most frames in contact.
FLIGHT_FRAMES, MAX_CONTACT_FRAMES = 18, 60

#: Spin that friction gives, rev/s: the paper's frontal impact (section 5.3).
FRICTION_SPIN_REV_S = 20.0

#: Time from a frame to the first touch, frames: no whole number, so that it is no special case.
PHASE = 0.37

#: Frames next to the contact that belong neither to flight nor to contact.
GUARD_FRAMES = 2

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Target:
    """Contact with the target."""

    contact_s: float  # duration
    restitution: float  # speed after over speed before
    origin: str  # source of the duration, in words

    def __post_init__(self) -> None:
        if not (math.isfinite(self.contact_s) and self.contact_s > 0):
            raise ValueError(f"contact of {self.contact_s:g} s: expected a finite, positive duration")
        if not 0 <= self.restitution <= 1:
            raise ValueError(f"restitution = {self.restitution:g}: expected a share from 0 to 1")


@dataclass(frozen=True)
class Rehearsal:
    """Precision of the smoother: rms of its stated standard deviations and of its true errors.

    The rows of these are flight and contact (NaN if no frame lies in the contact), the columns of velocity and force
    along and across the flight. The curves (n,) are forces along the flight over the time since the first touch.
    """

    found: bool  # whether the smoother found the contact
    contact_frames: float  # images during the contact
    peak_N: float  # highest true force  # noqa: N815
    velocity_m_s: Array  # (2, 2), stated
    force_N: Array  # (2, 2), stated  # noqa: N815
    spin_rad_s: Array  # (2, 3), stated, about x, y, z
    force_error_N: Array  # (2,), true error along the flight  # noqa: N815
    peak_error_N: float  # highest force of the smoother minus highest true force  # noqa: N815
    time_s: Array
    true_force_N: Array  # noqa: N815
    force_along_N: Array  # noqa: N815
    sd_force_along_N: Array  # noqa: N815

    @property
    def is_between_frames(self) -> bool:
        """Whether the contact begins and ends between two frames, so that no frame lies in it."""
        return bool(np.isnan(self.force_N[1]).all())


def hertz_contact_s(setup: Setup, modulus_pa: float) -> float:
    """Duration of an elastic impact on a massive flat target, s: ``2.87 (m^2 / (R E*^2 v))^(1/5)``.

    K. L. Johnson, Contact Mechanics (1985), equation (11.24), DOI 10.1017/CBO9781139171731; ``modulus_pa`` is ``E*``.
    """
    radius = 0.5e-3 * setup.diameter_mm
    return float(2.87 * (setup.mass_kg**2 / (radius * modulus_pa**2 * setup.speed_m_s)) ** 0.2)


def rehearse(covariance: Array, setup: Setup, target: Target, seed: int = 0) -> Rehearsal:
    """Simulate the measurement of an impact, with errors of an increment's covariance (5, 5), px and rad.

    Raises ValueError if the contact lasts more than `MAX_CONTACT_FRAMES` frames.
    """
    frames = target.contact_s * setup.frame_rate
    if frames > MAX_CONTACT_FRAMES:
        raise ValueError(
            f"a contact of {1e6 * target.contact_s:g} us lasts {frames:.0f} frames at {setup.frame_rate:g} frames/s; "
            f"the rehearsal takes up to {MAX_CONTACT_FRAMES}: give a shorter contact, or fewer frames per second"
        )
    # The first axis lies along the flight.
    along_x = replace(setup, direction_deg=0.0)
    track = _track(_poses(along_x, target, frames), _rotated(covariance, setup.direction_deg), setup, seed)
    motion = kinematics(track, frame_rate=setup.frame_rate, m_per_px=setup.m_per_px, mass_kg=setup.mass_kg)
    return _compared(motion, along_x, target, frames)


def _poses(setup: Setup, target: Target, frames: float) -> Array:
    """True poses (n, 5), px and rad, of a ball that flies along x; rotations are sums of small turns."""
    n = 2 * FLIGHT_FRAMES + math.ceil(frames)
    time = np.arange(n) - (FLIGHT_FRAMES - 1 + PHASE)
    share = np.clip(time / frames, 0.0, 1.0)
    # Integral over time of the velocity's relative change, for half a sine of force.
    change = frames * (share / 2 - np.sin(np.pi * share) / (2 * np.pi)) + np.maximum(time - frames, 0.0)
    step = setup.increment
    poses = time[:, None] * step
    poses[:, 0] -= (1 + target.restitution) * step[0] * change
    spin = 2 * math.pi * FRICTION_SPIN_REV_S / setup.frame_rate / math.sqrt(2)
    poses[:, 3:] += spin * change[:, None]
    # Friction that spins a solid ball about z pushes it across, by 2/5 of its surface's velocity.
    poses[:, 1] += 0.4 * setup.radius_px * spin * change
    return poses


def _rotated(covariance: Array, direction_deg: float) -> Array:
    """The covariance (5, 5) in axes of which the first lies along the flight."""
    angle = math.radians(direction_deg)
    plane = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    axes = np.eye(5)
    # Rotations about x and y transform as translations do.
    axes[:2, :2] = axes[2:4, 2:4] = plane
    return axes @ covariance @ axes.T


def _track(poses: Array, covariance: Array, setup: Setup, seed: int) -> Track:
    """The track of poses (n, 5) with independent errors of half the covariance each."""
    n = len(poses)
    errors = np.random.default_rng(seed).normal(size=poses.shape) @ np.linalg.cholesky(covariance / 2).T
    increment = np.diff(poses + errors, axis=0)
    turns = np.concatenate((np.zeros((1, 3)), increment[:, 2:]))
    return Track(
        position=np.concatenate((np.zeros((1, 2)), increment[:, :2].cumsum(0))),
        increment=increment,
        covariance=np.tile(covariance, (n - 1, 1, 1)),
        orientation=chain(turns, np.ones(n, dtype=bool)),
        zncc=np.ones(n),
        iterations=np.ones(n, dtype=np.int64),
        status=np.full(n, "ok"),
        radius=np.full(n, setup.radius_px),
        sd_growth=np.zeros(n - 1),
        sd_steady=sd_steady(increment, setup.radius_px, on_map=False),
        circle=Circle(0.0, 0.0, setup.radius_px),
        settings={},
    )


def _compared(motion: Kinematics, setup: Setup, target: Target, frames: float) -> Rehearsal:
    """The smoother's motion against the true force."""
    time: Array = np.arange(float(len(motion.time_s))) - (FLIGHT_FRAMES - 1 + PHASE)
    share = time / frames
    inside = (share > 0) & (share < 1)
    peak = 0.5 * math.pi * setup.mass_kg * (1 + target.restitution) * setup.speed_m_s / target.contact_s
    true = np.where(inside, -peak * np.sin(np.pi * share), 0.0)
    flying = (time < -GUARD_FRAMES) | (time > frames + GUARD_FRAMES)
    # The ends of the recording are less precise and less important.
    flying[[0, -1]] = False
    assert motion.force_N is not None  # the mass was given
    assert motion.sd_force_N is not None
    parts = (flying, inside)
    error = motion.force_N[:, 0] - true
    return Rehearsal(
        found=motion.contact_s is not None,
        contact_frames=frames,
        peak_N=peak,
        velocity_m_s=_rms(motion.sd_velocity_m_s, parts),
        force_N=_rms(motion.sd_force_N, parts),
        spin_rad_s=_rms(motion.sd_spin_rad_s, parts),
        force_error_N=_rms(error[:, None], parts)[:, 0],
        peak_error_N=float(np.abs(motion.force_N[:, 0]).max() - peak),
        time_s=time / setup.frame_rate,
        true_force_N=true,
        force_along_N=motion.force_N[:, 0],
        sd_force_along_N=motion.sd_force_N[:, 0],
    )


def _rms(values: Array, parts: Sequence[NDArray[np.bool_]]) -> Array:
    """Root mean square (m, k) of values (n, k) over m sets of frames; NaN over an empty set."""
    return np.stack(
        [np.sqrt((values[part] ** 2).mean(0)) if part.any() else np.full(values.shape[1], np.nan) for part in parts]
    )
