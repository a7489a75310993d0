"""Motion before and after an impact, of the smoothed motion or of many drawn ones, and its vectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torchsphere.runtime.arrays import Array


@dataclass(frozen=True)
class Rebound:
    """Motion before and after the contact, of one motion (...) or of many drawn ones (s, ...), in SI units."""

    velocity_before: Array  # (..., 2)
    velocity_after: Array
    spin_before: Array  # (..., 3)
    spin_after: Array
    contact_s: Array  # (..., 2), start and end
    normal: Array  # (..., 2), unit vectors from target to ball

    @property
    def duration_s(self) -> Array:
        """Duration of the contact (...)."""
        return np.asarray(self.contact_s[..., 1] - self.contact_s[..., 0])


def rebound(velocity: Array, spin: Array, contact_s: Array, normal_deg: float | None) -> Rebound:
    """From velocities (..., 2, 2) and spins (..., 2, 3) before and after; by default the change gives the normal."""
    before, after = velocity[..., 0, :], velocity[..., 1, :]
    if normal_deg is None:
        change = after - before
        normal = change / norm(change)[..., None]
    else:
        angle = np.radians(normal_deg)
        normal = np.broadcast_to(np.array([np.cos(angle), np.sin(angle)]), before.shape)
    return Rebound(before, after, spin[..., 0, :], spin[..., 1, :], contact_s, normal)


def slip(velocity: Array, spin: Array, normal: Array, radius: float | Array) -> Array:
    """Tangential velocity (...) of the point of contact, which lies at ``-radius`` times the normal."""
    return tangential(velocity, normal) - radius * spin[..., 2]


def tangential(velocity: Array, normal: Array) -> Array:
    """Velocity (...) along the surface, in the direction z x n in either right-handed frame."""
    return dot(velocity, np.stack((-normal[..., 1], normal[..., 0]), -1))


def surface_angle(velocity: Array, normal: Array) -> Array:
    """Angle between a velocity away from the surface and the surface, deg."""
    return np.degrees(np.arcsin(np.clip(dot(velocity, normal) / norm(velocity), -1, 1)))


def dot(a: Array, b: Array) -> Array:
    """Products (...) of vectors (..., k)."""
    return np.asarray((a * b).sum(-1))


def norm(vectors: Array) -> Array:
    """Lengths (...) of vectors (..., k)."""
    return np.asarray(np.linalg.norm(vectors, axis=-1))


def direction(vectors: Array) -> Array:
    """Directions (...) of vectors (..., 2), from x towards y, deg."""
    return np.asarray(np.degrees(np.arctan2(vectors[..., 1], vectors[..., 0])))
