"""Rehearsal of an impact: simulated measurements with increments of a given covariance.

Half a sine of force throws a flying ball back, and friction spins it up. Its true motion with errors of the expected
size makes a track. The package's own smoother processes this track as after the test: the smoother finds its
intensities and the contact from the data.

The error of one contact scatters by half of its size, and no camera is triggered to a fraction of a frame: several
recordings of the same impact are simulated, whose frames lie at other times from the first touch.
On a map of the ball the errors of the poses are independent. Steps from pairs have a part that stays in all later
poses (`measurements.DRIFT_SHARE`), and a steady error that adds up along the flight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.kinematics import Kinematics, kinematics_of_many
from torchsphere.dynamics.shared_errors import SharedErrors
from torchsphere.errors.steady_error import sd_steady
from torchsphere.estimation.measurements import DRIFT_SHARE
from torchsphere.geometry.circle import Circle
from torchsphere.geometry.orientation import chain
from torchsphere.motion.findings import Findings
from torchsphere.motion.track import Track
from torchsphere.planning.expected import Setup, require_noise
from torchsphere.runtime.arrays import Array
from torchsphere.sphere_map.decision import MadeMap

#: Frames of flight before and after the contact, and the most frames in contact.
FLIGHT_FRAMES, MAX_CONTACT_FRAMES = 18, 60

#: Simulated recordings of one rehearsal (docs/constants.toml).
DRAWS = 12

#: Spin that friction gives, rev/s: the paper's frontal impact (section 5.3).
FRICTION_SPIN_REV_S = 20.0

#: Time from a frame to the first touch in the first recording, frames: no whole number, so that it is no special case.
PHASE = 0.37

#: Frames next to the contact that belong neither to flight nor to contact.
GUARD_FRAMES = 2


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
class Parts:
    """The two parts of stated standard deviations, both in the rows and columns of these: their squares add up."""

    random: Array  # by the errors of the single frames
    common: Array  # by errors that all frames of a recording share


@dataclass(frozen=True)
class Rehearsal:
    """Precision of the smoother: rms of its stated standard deviations and of its true errors over all recordings.

    The rows of these are flight and contact (NaN if no frame lies in the contact), the columns of velocity and force
    along and across the flight. The curves (n,) are those of the first recording: forces along the flight over the
    time since the first touch.
    """

    found: bool  # whether the smoother found the contact in most of the recordings
    recordings: int  # simulated recordings
    contact_frames: float  # images during the contact
    peak_N: float  # highest true force  # noqa: N815
    velocity_m_s: Array  # (2, 2), stated
    force_N: Array  # (2, 2), stated  # noqa: N815
    spin_rad_s: Array  # (2, 3), stated, about x, y, z
    velocity_parts_m_s: Parts  # of ``velocity_m_s``
    force_parts_N: Parts  # of ``force_N``  # noqa: N815
    spin_parts_rad_s: Parts  # of ``spin_rad_s``
    force_error_N: Array  # (2,), true error along the flight, rms over all recordings  # noqa: N815
    sd_force_error_N: Array  # (2,), its standard deviation by the scatter of the recordings  # noqa: N815
    typical_force_error_N: Array  # (2,), median of the recordings' own rms errors  # noqa: N815
    peak_error_N: float  # highest force of the smoother minus highest true force, mean  # noqa: N815
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


def rehearse(covariance: Array, setup: Setup, target: Target, seed: int = 0, recordings: int = DRAWS) -> Rehearsal:
    """Simulate the measurement of an impact, with errors of an increment's covariance (5, 5), px and rad.

    Raises ValueError if the contact lasts more than `MAX_CONTACT_FRAMES` frames, or the covariance is hardly any.
    """
    frames = target.contact_s * setup.frame_rate
    require_noise(covariance, setup.radius_px, "rehearsal")
    if frames > MAX_CONTACT_FRAMES:
        raise ValueError(
            f"a contact of {1e6 * target.contact_s:g} us lasts {frames:.0f} frames at {setup.frame_rate:g} frames/s; "
            f"the rehearsal takes up to {MAX_CONTACT_FRAMES}: give a shorter contact, or fewer frames per second"
        )
    # The first axis lies along the flight.
    along_x = replace(setup, direction_deg=0.0)
    times, rotated = _times(frames, recordings), _rotated(covariance, setup.direction_deg)
    generator = np.random.default_rng(seed)
    tracks = [_track(_poses(along_x, target, time), rotated, along_x, generator) for time in times]
    rate, m_per_px = setup.frame_rate, setup.m_per_px
    motions = kinematics_of_many(tracks, frame_rate=rate, m_per_px=m_per_px, mass_kg=setup.mass_kg, log=False)
    return _compared(tracks, motions, times, along_x, target)


def _times(frames: float, recordings: int) -> Array:
    """Times (s, n) of the frames since the first touch, in frames, for a contact of that length.

    The phases of the recordings are spread over a frame. A contact shorter than a frame has one phase: it lies between
    two frames or not.
    """
    n = 2 * FLIGHT_FRAMES + math.ceil(frames)
    phases = (PHASE + np.arange(recordings) / recordings * (frames >= 1)) % 1.0
    return np.asarray(np.arange(float(n)) - (FLIGHT_FRAMES - 1 + phases[:, None]))


def _poses(setup: Setup, target: Target, time: Array) -> Array:
    """True poses (n, 5), px and rad, of a ball that flies along x, at ``time`` (n,) since the first touch, frames.

    Rotations are sums of small turns.
    """
    frames = target.contact_s * setup.frame_rate
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


def _track(poses: Array, covariance: Array, setup: Setup, generator: np.random.Generator) -> Track:
    """The track of poses (n, 5) with errors whose increments have the covariance (5, 5)."""
    n = len(poses)
    steady = sd_steady(np.diff(poses, axis=0), setup.radius_px, on_map=setup.on_map)
    errors = _errors(n, covariance, None if setup.on_map else steady, generator)
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
        sd_steady=steady,
        circle=Circle(0.0, 0.0, setup.radius_px),
        settings={},
        findings=Findings(map=MadeMap()) if setup.on_map else Findings(),
    )


def _errors(n: int, covariance: Array, steady: Array | None, generator: np.random.Generator) -> Array:
    """Errors (n, 5) of the poses: independent ones of half the covariance each, and for pairs what adds up.

    ``steady`` (5,) is the standard deviation of the pairs' steady error; None for poses on a map, where nothing adds
    up. The part of a step that stays has the correlations of the whole error (docs/constants.toml, `DRIFT_SHARE`).
    """
    variances, axes = np.linalg.eigh(covariance)
    # Rounding may leave a variance just below zero where the covariance is singular.
    root = np.sqrt(np.maximum(variances, 0.0))[:, None] * axes.T
    errors: Array = math.sqrt(0.5) * generator.normal(size=(n, 5)) @ root
    if steady is not None:
        steps = math.sqrt(DRIFT_SHARE) * generator.normal(size=(n, 5)) @ root + steady * generator.normal(size=5)
        steps[0] = 0.0
        errors += steps.cumsum(0)
    return errors


def _compared(
    tracks: Sequence[Track], motions: Sequence[Kinematics], times: Array, setup: Setup, target: Target
) -> Rehearsal:
    """The smoother's motions against the true force; ``times`` (s, n) are in frames since the first touch."""
    frames = target.contact_s * setup.frame_rate
    share = times / frames
    inside = (share > 0) & (share < 1)
    peak = 0.5 * math.pi * setup.mass_kg * (1 + target.restitution) * setup.speed_m_s / target.contact_s
    true = np.where(inside, -peak * np.sin(np.pi * share), 0.0)
    flying = (times < -GUARD_FRAMES) | (times > frames + GUARD_FRAMES)
    # The ends of the recording are less precise and less important.
    flying[:, [0, -1]] = False
    parts = np.stack((flying, inside))
    force, sd_force = _forces(motions)
    common = [_common_sd(track, motion) for track, motion in zip(tracks, motions, strict=True)]
    common_velocity, common_force, common_spin = (np.stack(values) for values in zip(*common, strict=True))
    velocity, spin = (np.stack([getattr(m, name) for m in motions]) for name in ("sd_velocity_m_s", "sd_spin_rad_s"))
    error, sd_error, typical = _errors_of_force(force[..., :1] - true[..., None], parts)
    return Rehearsal(
        found=sum(motion.contact_s is not None for motion in motions) > len(motions) / 2,
        recordings=len(motions),
        contact_frames=frames,
        peak_N=peak,
        velocity_m_s=_rms(velocity, parts),
        force_N=_rms(sd_force, parts),
        spin_rad_s=_rms(spin, parts),
        velocity_parts_m_s=_parts(velocity, common_velocity, parts),
        force_parts_N=_parts(sd_force, common_force, parts),
        spin_parts_rad_s=_parts(spin, common_spin, parts),
        force_error_N=error,
        sd_force_error_N=sd_error,
        typical_force_error_N=typical,
        peak_error_N=float(np.abs(force[..., 0]).max(1).mean() - peak),
        time_s=times[0] / setup.frame_rate,
        true_force_N=true[0],
        force_along_N=force[0, :, 0],
        sd_force_along_N=sd_force[0, :, 0],
    )


def _forces(motions: Sequence[Kinematics]) -> tuple[Array, Array]:
    """Forces (s, n, 2) of the recordings and their stated standard deviations, N."""
    forces, sds = [], []
    for motion in motions:
        assert motion.force_N is not None  # the mass was given
        assert motion.sd_force_N is not None
        forces.append(motion.force_N)
        sds.append(motion.sd_force_N)
    return np.stack(forces), np.stack(sds)


def _common_sd(track: Track, motion: Kinematics) -> tuple[Array, Array, Array]:
    """Standard deviations of velocity, force (n, 2) and spin (n, 3) by the errors that all frames share, SI units.

    The shared errors alone, as `si_units.in_si_units` adds them to those of the frames.
    """
    assert motion.mass_kg is not None
    shared, per_frame = SharedErrors.of(track, motion.scale), motion.frame_rate
    m_per_px = motion.scale.m_per_px
    rate = np.concatenate((motion.velocity_m_s / m_per_px, motion.spin_rad_s), 1) / per_frame
    acceleration = np.concatenate((motion.acceleration_m_s2 / m_per_px, motion.angular_acceleration_rad_s2), 1)
    contacts: list[Array | None] = [contact.contact_s * per_frame for contact in motion.contacts]
    frames = motion.time_s * per_frame
    change = np.max([shared.steady_change(frames, contact, rate) for contact in contacts or [None]], axis=0)
    sd_rate = shared.total_sd(rate, np.broadcast_to(shared.steady, rate.shape))
    sd_acceleration = shared.total_sd(acceleration / per_frame**2, change, rate[:, 4])
    force = motion.mass_kg * m_per_px * per_frame**2 * sd_acceleration[:, :2]
    return sd_rate[:, :2] * m_per_px * per_frame, force, sd_rate[:, 2:] * per_frame


def _parts(total: Array, common: Array, parts: NDArray[np.bool_]) -> Parts:
    """Random and common part of stated standard deviations (s, n, k), of which ``common`` is a part."""
    # Both are sums of squares with the same terms: rounding alone makes the difference negative.
    random = np.sqrt(np.maximum(total**2 - common**2, 0.0))
    return Parts(_rms(random, parts), _rms(common, parts))


def _errors_of_force(errors: Array, parts: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """Root mean square (m,) of errors (s, n, 1) over m sets of frames, its standard deviation, and the typical error.

    In a few recordings of a hundred noise hides whether the force is smooth, and their errors are several times as
    large: these make the root mean square and its uncertainty, not the median.
    """
    each = np.stack([_rms(own[None], part[:, None]) for own, part in zip(errors, parts.swapaxes(0, 1), strict=True)])
    squares = each[..., 0] ** 2
    rms, typical = np.sqrt(squares.mean(0)), np.sqrt(np.median(squares, 0))
    if len(squares) < 2:
        return rms, np.full(rms.shape, np.nan), typical
    sd = squares.std(0, ddof=1) / math.sqrt(len(squares))
    # Without any error there is no scatter either.
    return rms, np.divide(sd, 2 * rms, out=np.where(np.isnan(rms), np.nan, 0.0), where=rms > 0), typical


def _rms(values: Array, parts: NDArray[np.bool_]) -> Array:
    """Root mean square (m, k) of values (s, n, k) over m sets of frames (m, s, n); NaN over an empty set."""
    return np.stack(
        [np.sqrt((values[part] ** 2).mean(0)) if part.any() else np.full(values.shape[-1], np.nan) for part in parts]
    )
