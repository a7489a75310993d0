"""Recordings with exact truth for `experiments.validation.sensitivity`, and what the program makes of them.

None is made with a seed that judges: the disturbed balls have the seeds of the attack that are spent.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

import torchsphere as ts
from experiments.experiment import Array
from experiments.validation import seeds, simulated_impacts
from experiments.validation.attack import score
from experiments.validation.attack_cases import CASES
from experiments.validation.attack_footage import Recorded, blotches, digitised, filmed, flight, recorded
from torchsphere.benchmark.baselines import TRACKERS

#: Frames of a recording of images, of a simulated impact, and seeds.
FRAMES, SMOOTHED_FRAMES, SEED, FIRST_IMPACT = 16, 70, seeds.SPENT["attack"][0], 220_000

#: Frames per second and diameter of the ball in images, m.
RATE, DIAMETER_M = 1000.0, 0.03

#: Cases of the attack: those on which every constant is tried that they read, and others.
FIRST = ("hand in front", "nothing", "turns in its place")
OTHERS = (
    "lamp from one side",
    "images missing",
    "still blotches behind",
    "exposure blur of 3 px",
    "defocus of 2 px",
    "grows by 1 % per frame",
    "turn of 25 deg",
    "noise of 12 levels",
    "images shown twice",
    "plate in front",
    "interlaced, 8 px per frame",
    "camera at 10 radii",
    "H.264, crf 30",
)

#: Recordings in which parts of the program have most to do: a constant of these is tried on them first.
BUSY = {
    "detection": ("still blotches behind", "leaves", "no ball"),
    "errors": ("still blotches behind", "H.264, crf 30"),
    "errors.missing_frames": ("images missing", "images shown twice"),
    "imaging.interlacing": ("interlaced, 8 px per frame",),
    "sphere_map.decision": ("plate in front",),
    "sphere_map.exposure": ("exposure blur of 3 px",),
    "sphere_map.exposure_share": ("exposure blur of 3 px",),
    "sphere_map.footprint": ("defocus of 2 px",),
    "sphere_map.light": ("lamp from one side",),
    "sphere_map.map_fit": ("noise of 12 levels",),
    "sphere_map.nearness": ("camera at 10 radii",),
    "sphere_map.nearness_decision": ("camera at 10 radii",),
    "sphere_map.poses": ("noise of 12 levels", "H.264, crf 30"),
    "tracking.blur_estimate": ("exposure blur of 3 px",),
    "tracking.growth": ("grows by 1 % per frame",),
    "tracking.initial_circle": ("still blotches behind",),
    "tracking.follow": ("leaves",),
    "tracking.recovery": ("plate in front",),
    "tracking.rotation_search": ("turn of 25 deg",),
    "tracking.slipped_path": ("plate in front",),
}

#: Length of the contact, frames, and error of the positions, m, of the simulated impacts; None flies freely.
IMPACTS = ((14.0, 1e-6), (5.0, 1e-5), (None, 3e-6), (30.0, 3e-6))


@dataclass(frozen=True)
class Outcome:
    """What a recording came to.

    Errors are in px (at the surface, of a rotation), or in shares of the largest true value of their kind.
    """

    status: tuple[str, ...]  # of the frames, or of the impact
    number: Array  # (k,)
    sd: Array  # (k,), stated
    error: Array  # (k,), NaN where there is no number
    said: frozenset[str]  # sentences
    silent: int = 0  # frames that are wrong without a word


#: Measures a recording that was made before.
Measurement = Callable[[], Outcome]


def recordings() -> dict[str, dict[str, Measurement]]:
    """All recordings by their kind and name; a kind has its own part of the program."""
    images = {name: _disturbed(name) for name in (*FIRST, *OTHERS)} | {"leaves": _leaving(), "no ball": _without_ball()}
    return {
        "images": images,
        "impacts": {f"impact {number}": _impact(number) for number in range(len(IMPACTS))},
        "baselines": {name: _baseline(name) for name in TRACKERS},
    }


def _disturbed(name: str) -> Measurement:
    return functools.partial(_tracked, _cut(CASES[name](SEED), slice(FRAMES)))


def _leaving() -> Measurement:
    """A ball that leaves the image."""
    made = flight(SEED, frames=FRAMES, speed=4.0)
    images, middle = recorded(made, filmed(made)).images, made.centres[FRAMES // 2, 0]
    right, left = math.ceil(middle + made.radius), math.floor(middle - made.radius)
    if made.centres[-1, 0] > middle:
        return functools.partial(_tracked, Recorded(images[..., :right], made.centres, made.turns))
    return functools.partial(_tracked, Recorded(images[..., left:], made.centres - np.array([left, 0]), made.turns))


def _without_ball() -> Measurement:
    still = blotches((128, 160), SEED)
    images = digitised(still.expand(FRAMES, -1, -1), SEED)
    return functools.partial(_tracked, Recorded(images, np.full((FRAMES, 2), np.nan), Rotation.identity(FRAMES)))


def _cut(made: Recorded, frames: slice) -> Recorded:
    rival = None if made.rival is None else made.rival[frames]
    part = replace(made, images=made.images[frames], position=made.position[frames], rival=rival)
    return replace(part, turns=made.turns[frames])


def _steps(position: Array, turns: Rotation) -> Array:
    """True increments (n - 1, 5)."""
    return np.concatenate((np.diff(position, axis=0), (turns[1:] * turns[:-1].inv()).as_rotvec()), 1)


def _tracked(made: Recorded) -> Outcome:
    track = ts.track(made.images, log=False, **made.options)
    true = _steps(made.position, made.turns)
    # Of a turn by nearly 180 deg, the rotation left over, not the difference of the vectors.
    left = Rotation.from_rotvec(np.nan_to_num(track.increment[:, 2:])) * Rotation.from_rotvec(true[:, 2:]).inv()
    error = np.concatenate((track.increment[:, :2] - true[:, :2], left.as_rotvec()), 1)
    error[~np.isfinite(track.increment)] = np.nan
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2))
    path_sd = np.broadcast_to(np.nanmedian(sd[:, :2], 0), track.position.shape)
    surface = np.array([1, 1, *3 * [track.circle.radius]])
    motion = ts.kinematics(track, frame_rate=RATE, diameter_m=DIAMETER_M, log=False)
    rest = motion.velocity_m_s.size + motion.spin_rad_s.size
    return Outcome(
        status=tuple(track.status),
        number=_joined(track.increment, track.position, motion.velocity_m_s, motion.spin_rad_s),
        sd=_joined(sd, path_sd, motion.sd_velocity_m_s, motion.sd_spin_rad_s),
        error=_joined(error * surface, track.position - made.position, np.full(rest, np.nan)),
        said=frozenset((*track.warnings, *motion.warnings)),
        silent=score(made, track).silent,
    )


def _joined(*parts: ArrayLike) -> Array:
    return np.concatenate([np.ravel(part) for part in parts])


def _impact(number: int) -> Measurement:
    length, noise_m = IMPACTS[number]
    shape = simulated_impacts.SHAPES[number]
    pushes = [] if length is None else [simulated_impacts.rebound(shape, 20.3, length)]
    shot = simulated_impacts.simulated(pushes, SMOOTHED_FRAMES, noise_m, FIRST_IMPACT + number)
    return functools.partial(_smoothed, shot)


def _smoothed(shot: simulated_impacts.Simulated) -> Outcome:
    motion = ts.kinematics(
        shot.track,
        frame_rate=simulated_impacts.RATE,
        m_per_px=simulated_impacts.M_PER_PX,
        mass_kg=simulated_impacts.MASS_KG,
        log=False,
    )
    impact, reason = ts.impact(motion, log=False)
    values = motion.velocity_m_s, motion.force_N, motion.spin_rad_s
    true = shot.velocity_m_s, shot.force_N, shot.spin_rad_s
    largest = [max(float(np.abs(part).max()), 1e-9) for part in true]
    errors = [(np.asarray(a) - b) / most for a, b, most in zip(values, true, largest, strict=True)]
    return Outcome(
        status=("no impact" if impact is None else "impact",),
        number=_joined(*map(np.asarray, values)),
        sd=_joined(motion.sd_velocity_m_s, np.asarray(motion.sd_force_N), motion.sd_spin_rad_s),
        # Without a force there is no largest one, and what is found has no share.
        error=_joined(*(error if most > 1e-9 else 0 * error for error, most in zip(errors, largest, strict=True))),
        said=frozenset((*motion.warnings, reason) if impact is None else (*motion.warnings, *impact.warnings)),
    )


def _baseline(name: str) -> Measurement:
    """A tracker of the benchmark on a slow ball, which is nearly all that it can follow."""
    radius = 30.0
    made = flight(SEED, frames=FRAMES, radius=radius, speed=1.5, turn_deg=0.5)
    images, true = recorded(made, filmed(made)).images, _steps(made.centres, made.turns)
    circle = ts.Circle(float(made.centres[0, 0]), float(made.centres[0, 1]), radius)

    def measure() -> Outcome:
        found = TRACKERS[name](images, circle)
        error = (found.increment - true) * np.array([1, 1, *3 * [radius]])
        # A baseline states no standard deviation: the scatter of its errors.
        sd = np.broadcast_to(np.nanstd(found.increment - true, axis=0), true.shape)
        return Outcome(tuple(found.status), found.increment.ravel(), _joined(sd), error.ravel(), frozenset())

    return measure
