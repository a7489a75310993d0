"""Motions for the tests of the renderer, and the outline of a ball by the formula of its tangent cone."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from render.camera import Camera
from render.frames import render_radiance
from render.pose import Motion, Poses
from render.scene import Setup

# Not by an import: the renderer must name the LLVM library before mitsuba is imported.
needs_mitsuba = pytest.mark.skipif(
    importlib.util.find_spec("mitsuba") is None,
    reason="rendering needs mitsuba: pip install 'torchsphere[render]'",
)

RADIUS_M = 0.015


def steady(position_m=(0.0, 0.0, 0.0), velocity_m_s=(0.0, 0.0, 0.0), spin_rad_s=(0.0, 0.0, 0.0), start=None) -> Motion:
    """Give a motion at constant velocity and spin."""
    first = Rotation.identity() if start is None else start

    def motion(times_s: NDArray[np.float64]) -> Poses:
        turned = Rotation.from_rotvec(np.outer(times_s, spin_rad_s)) * first
        return Poses(np.asarray(position_m) + np.outer(times_s, velocity_m_s), turned.as_matrix())

    return motion


def picture(setup: Setup, motion: Motion) -> NDArray[np.float64]:
    """Grey levels at the time 0, without the sensor's noise."""
    return next(render_radiance(setup, motion, np.zeros(1)))


def outline(camera: Camera, centre_m: NDArray[np.float64], radius_m: float, count: int = 20000) -> NDArray[np.float64]:
    """Points (count, 2) of the ball's outline in the image, px.

    The lines of sight that touch a ball at the distance D touch it along a circle. This circle has the radius
    R sqrt(1 - (R/D)^2); its centre lies at the fraction 1 - (R/D)^2 of the way to the ball's centre.
    """
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)[:, None]
    axis, middle, radius = np.array([0.0, 0.0, 1.0]), centre_m, radius_m
    if camera.model == "pinhole":
        distance = np.linalg.norm(centre_m)
        share = 1 - (radius_m / distance) ** 2
        axis, middle, radius = centre_m / distance, share * centre_m, radius_m * np.sqrt(share)
    across = np.cross(axis, [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    return camera.project(middle + radius * (np.cos(angle) * across + np.sin(angle) * np.cross(axis, across)))
