"""Tracks of balls that are hit by given forces, without images: exact truth for the smoother and the impacts.

The errors of the poses are those that pairs have at a radius of 75 px: a position and the rotation that looks like its
motion share 95 % of their error. The spin changes with the force, in proportion to the impulse.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import betaincinv

import torchsphere as ts
from torchsphere.geometry.orientation import chain
from torchsphere.motion.findings import Findings
from torchsphere.sphere_map.decision import MadeMap

Array = NDArray[np.float64]
Shape = Callable[[Array], Array]

#: Frames per second, kg, and m per px.
RATE, MASS_KG, M_PER_PX = 50e3, 0.11, 1e-4

#: Speed before the first force, m/s, and radius of the outline, px.
SPEED_M_S, RADIUS_PX = 70.0, 75.0

#: Steps of the integration in a frame's interval: the path is exact to 1e-3 of the least noise.
PARTS = 50

#: Error of a rotation, rad, per px of error of a position, and the correlation of the two.
RAD_PER_PX, CORRELATION = 0.024, 0.95

#: Spin before the first force, rad per frame, and the axis and the size of its change per m/s of the velocity's, rad/s.
FIRST_SPIN = np.array([0.0, 0.001, 0.0])
SPIN_AXIS, SPIN_PER_SPEED = np.array([0.3, 0.5, 0.81]) / np.linalg.norm([0.3, 0.5, 0.81]), 1.7


def half_sine(share: Array) -> Array:
    """A ball on a linear spring."""
    return np.sin(np.pi * share)


def hertz(share: Array) -> Array:
    """An elastic contact of Hertz, whose force is the power 1.5 of the penetration."""
    # The way to the turning point by conservation of energy: Johnson, Contact Mechanics, 1985, section 11.4.
    return betaincinv(0.4, 0.5, 1 - np.abs(2 * share - 1)) ** 0.6


def power_sine(share: Array) -> Array:
    """A force that starts and ends as the power 1.5 of the time, 2.4 % of the peak from that of Hertz."""
    return np.sin(np.pi * share) ** 1.5


def squared_sine(share: Array) -> Array:
    """A soft start and a soft end."""
    return np.sin(np.pi * share) ** 2


def triangle(share: Array) -> Array:
    """A tip between two straight lines."""
    return 1 - np.abs(2 * share - 1)


def double(share: Array) -> Array:
    """Two peaks, the force halved between them."""
    return np.sin(np.pi * share) * (1 - 0.5 * np.exp(-(((share - 0.5) / 0.12) ** 2)))


def plateau(share: Array) -> Array:
    """A quarter of rise, half a contact of constant force, a quarter of fall."""
    return np.clip(4 * np.minimum(share, 1 - share), 0, 1)


def fast_rise(share: Array) -> Array:
    """The largest force after a fifth of the contact, and a slow decay."""
    return np.where(share < 0.2, np.sin(2.5 * np.pi * share), np.cos(0.625 * np.pi * (share - 0.2)) ** 2)


SHAPES: tuple[Shape, ...] = (half_sine, hertz, power_sine, squared_sine, triangle, double, plateau, fast_rise)


@dataclass(frozen=True)
class Push:
    """A force along x; a ball that flies in +x is thrown back by a negative one."""

    shape: Shape  # force over its peak, of the share of the contact that has passed
    start: float  # frames
    length: float  # frames
    peak_N: float  # noqa: N815  (N is newton)

    def force(self, frames: Array) -> Array:
        """Force, N, at times in frames."""
        share = (frames - self.start) / self.length
        inside = (share > 0) & (share < 1)
        return np.where(inside, self.peak_N * self.shape(np.clip(share, 0, 1)), 0.0)

    @property
    def largest_N(self) -> float:  # noqa: N802
        """Largest size of the force, N."""
        return float(np.abs(self.force(self.start + self.length * np.linspace(0, 1, 20_001))).max())

    @property
    def impulse(self) -> float:
        """Integral of the force, N s."""
        middle = (np.arange(20_000) + 0.5) / 20_000
        return float(self.force(self.start + self.length * middle).mean() * self.length / RATE)


@dataclass(frozen=True)
class Simulated:
    """A track with the exact motion at its frames."""

    track: ts.Track
    pushes: tuple[Push, ...]
    position_m: Array  # (n, 2)
    velocity_m_s: Array  # (n, 2)
    force_N: Array  # (n, 2)  # noqa: N815
    spin_rad_s: Array  # (n, 3)

    @property
    def touching(self) -> NDArray[np.bool_]:
        """(n,), True in frames within a contact."""
        frames = np.arange(len(self.position_m))
        inside = [(frames > push.start) & (frames < push.start + push.length) for push in self.pushes]
        return np.any([np.zeros(len(frames), dtype=bool), *inside], axis=0)


def rebound(shape: Shape, start: float, length: float) -> Push:
    """A push that throws a ball of the speed before back with half of it."""
    one = Push(shape, start, length, 1.0)
    return Push(shape, start, length, -1.5 * SPEED_M_S * MASS_KG / one.impulse)


def simulated(pushes: Sequence[Push], frames: int, noise_m: float, seed: int) -> Simulated:
    """A ball of `SPEED_M_S` along x under the ``pushes``, filmed with position errors of ``noise_m``."""
    fine = (np.arange((frames - 1) * PARTS) + 0.5) / PARTS
    gained = sum((push.force(fine) for push in pushes), np.zeros(len(fine))) / MASS_KG / (RATE * PARTS)
    change = np.concatenate(([0.0], np.cumsum(gained)))
    between = 0.5 * (change[1:] + change[:-1])
    x = np.concatenate(([0.0], np.cumsum(SPEED_M_S + between))) / (RATE * PARTS)
    zero = np.zeros(frames)
    turns = _turned(FIRST_SPIN + SPIN_PER_SPEED / RATE * between[:, None] * SPIN_AXIS)
    now = np.arange(float(frames))
    position = np.stack((x[::PARTS], zero + 5e-3), 1)
    velocity = np.stack((SPEED_M_S + change[::PARTS], zero), 1)
    force = np.stack((sum((push.force(now) for push in pushes), zero), zero), 1)
    spin = FIRST_SPIN * RATE + SPIN_PER_SPEED * change[::PARTS, None] * SPIN_AXIS
    track = _filmed(position / M_PER_PX, turns, noise_m / M_PER_PX, np.random.default_rng(seed))
    return Simulated(track, tuple(pushes), position, velocity, force, spin)


def _turned(rate: Array) -> Array:
    """Orientations (n, 3, 3) at the frames, from the spin (`PARTS` (n - 1), 3), rad per frame, between them."""
    parts = Rotation.from_rotvec(rate / PARTS).as_matrix().reshape(-1, PARTS, 3, 3)
    whole = parts[:, 0]
    for number in range(1, PARTS):
        whole = parts[:, number] @ whole
    steps = np.concatenate((np.zeros((1, 3)), Rotation.from_matrix(whole).as_rotvec()))
    return chain(steps, np.ones(len(steps), dtype=bool))


def _filmed(position_px: Array, turns: Array, noise_px: float, rng: np.random.Generator) -> ts.Track:
    """Track of the poses with their errors, on a map: no error adds up."""
    n = len(position_px)
    sd = noise_px * np.array([1.0, 1.0, RAD_PER_PX, RAD_PER_PX, RAD_PER_PX])
    correlation = np.eye(5)
    correlation[0, 3] = correlation[3, 0] = CORRELATION
    correlation[1, 2] = correlation[2, 1] = -CORRELATION
    covariance = sd[:, None] * correlation * sd
    error = rng.multivariate_normal(np.zeros(5), covariance, size=n)
    measured = Rotation.from_rotvec(error[:, 2:]).as_matrix() @ turns
    position = position_px + error[:, :2]
    turn = Rotation.from_matrix(measured[1:] @ np.swapaxes(measured[:-1], 1, 2)).as_rotvec()
    return ts.Track(
        position=position,
        increment=np.concatenate((np.diff(position, axis=0), turn), 1),
        covariance=np.tile(2 * covariance, (n - 1, 1, 1)),
        orientation=measured @ measured[0].T,
        zncc=np.ones(n),
        iterations=np.ones(n, dtype=np.int64),
        status=np.full(n, "ok"),
        radius=np.full(n, RADIUS_PX),
        sd_growth=np.zeros(n - 1),
        sd_steady=np.zeros(5),
        circle=ts.Circle(position[0, 0], position[0, 1], RADIUS_PX, 0.0, 0.0, 0.0),
        settings={},
        findings=Findings(map=MadeMap()),
    )
