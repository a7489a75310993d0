"""Tracks of a ball that rebounds by a pulse of force and torque, with exact truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

import torchsphere as ts
from torchsphere.geometry.orientation import chain
from torchsphere.motion.findings import Findings
from torchsphere.sphere_map.decision import MadeMap

#: A pulse of 29 kN over 14 frames at 50 kfps, a ball of 110 g, a pixel of 0.1 mm.
RATE, MASS_KG, PEAK_N, FRAMES, LENGTH, M_PER_PX = 50e3, 0.11, 29e3, 80, 14.0, 1e-4
NOISES_M = (1.5e-6, 7.5e-6)


@dataclass(frozen=True)
class Pulse:
    track: ts.Track
    touching: np.ndarray  # (n,)
    velocity_m_s: np.ndarray  # (n, 2)
    force_N: np.ndarray  # noqa: N815  (as in Kinematics)
    spin_rad_s: np.ndarray  # (n, 3)
    edges_s: np.ndarray  # (2,)


@dataclass(frozen=True)
class Push:
    """Effect of a force in -x on a ball of 70 m/s in x, in n frames."""

    path_m: np.ndarray  # (n,), distance behind a ball without the force
    slowed_m_s: np.ndarray  # (n,)
    force_N: np.ndarray  # (n,)  # noqa: N815
    gained: np.ndarray  # (n,), share of the change of velocity and spin
    gained_between: np.ndarray  # (50 (n - 1),), the same in the middle of each fiftieth of a frame
    edges: np.ndarray  # (2,), frames


def pulse(seed: int, noise_m: float) -> Pulse:
    """A ball of 70 m/s in x that rebounds by a half-sine of force, with a spin up to 20 rev/s about an oblique axis."""
    rng = np.random.default_rng(seed)
    start = 33 + rng.random()
    t = np.arange(FRAMES, dtype=float)
    share = np.clip((t - start) / LENGTH, 0, 1)
    gained = 0.5 * (1 - np.cos(np.pi * share))
    change = 2 * PEAK_N / MASS_KG / RATE**2 * LENGTH / np.pi
    path = change * (
        0.5 * (LENGTH * share - LENGTH / np.pi * np.sin(np.pi * share)) + np.maximum(t - start - LENGTH, 0)
    )
    fine = np.clip(((np.arange((FRAMES - 1) * 50) + 0.5) / 50 - start) / LENGTH, 0, 1)
    push = Push(
        path_m=path,
        slowed_m_s=change * gained * RATE,
        force_N=np.where((share > 0) & (share < 1), PEAK_N * np.sin(np.pi * share), 0.0),
        gained=gained,
        gained_between=0.5 * (1 - np.cos(np.pi * fine)),
        edges=np.array([start, start + LENGTH]),
    )
    return filmed(push, noise_m, rng)


def filmed(push: Push, noise_m: float, rng: np.random.Generator) -> Pulse:
    """The track of a ball under a push, with a spin up to 20 rev/s in the same time."""
    t = np.arange(FRAMES, dtype=float)
    position_px = (70 / RATE * t - push.path_m) / M_PER_PX
    axis = np.array([0.3, 0.5, 0.81]) / np.linalg.norm([0.3, 0.5, 0.81])
    first, last = np.array([0.0, 0.001, 0.0]), 20 * 2 * np.pi / RATE * axis
    # Fifty steps per frame: the rotation at the midpoint of each is right to 1e-9 rad.
    steps = (first + push.gained_between[:, None] * last) / 50
    turned = chain(np.concatenate((np.zeros((1, 3)), steps)), np.ones(len(steps) + 1, dtype=bool))[::50]
    sd = noise_m / M_PER_PX * np.array([1.0, 1.0, 0.024, 0.024, 0.024])
    correlation = np.eye(5)
    correlation[0, 3] = correlation[3, 0] = 0.95
    correlation[1, 2] = correlation[2, 1] = -0.95
    covariance = sd[:, None] * correlation * sd
    error = rng.multivariate_normal(np.zeros(5), covariance, size=FRAMES)
    measured = Rotation.from_rotvec(error[:, 2:]).as_matrix() @ turned
    position = np.stack((position_px, np.full(FRAMES, 50.0)), 1) + error[:, :2]
    between = measured[1:] @ np.swapaxes(measured[:-1], 1, 2)
    # The rotation vector of a small rotation, from the odd part of its matrix.
    odd = np.stack((between[:, 2, 1], between[:, 0, 2], between[:, 1, 0]), 1)
    odd = 0.5 * (odd - np.stack((between[:, 1, 2], between[:, 2, 0], between[:, 0, 1]), 1))
    sine = np.linalg.norm(odd, axis=1, keepdims=True)
    increment = np.concatenate((np.diff(position, axis=0), odd * np.arcsin(sine) / sine), 1)
    track = ts.Track(
        position=position,
        increment=increment,
        covariance=np.tile(2 * covariance, (FRAMES - 1, 1, 1)),
        orientation=measured @ measured[0].T,
        zncc=np.ones(FRAMES),
        iterations=np.ones(FRAMES, dtype=np.int64),
        status=np.full(FRAMES, "ok"),
        radius=np.full(FRAMES, 75.0),
        sd_growth=np.zeros(FRAMES - 1),
        sd_steady=np.zeros(5),
        circle=ts.Circle(position[0, 0], position[0, 1], 75.0, 0.0, 0.0, 0.0),
        settings={},
        findings=Findings(map=MadeMap()),
    )
    zero = 0 * t
    return Pulse(
        track=track,
        touching=(t > push.edges[0]) & (t < push.edges[1]),
        velocity_m_s=np.stack((70 - push.slowed_m_s, zero), 1),
        force_N=np.stack((-push.force_N, zero), 1),
        spin_rad_s=(first + push.gained[:, None] * last) * RATE,
        edges_s=push.edges / RATE,
    )
