"""Lights: uniform light from everywhere, area lights and spot lights; all fixed in space while the ball turns.

A light's level is the level of a white matt surface (albedo 1) in it: 1 is full scale on a sensor with gain 1. Uniform
light alone on a matt ball is "flat" light: the image is the pattern's albedo.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .check import one_of, vector, within


@dataclass(frozen=True)
class Light:
    """A lamp.

    Attributes
    ----------
    kind : str
        `area`, a round lamp that shines to its front, or `spot`, a point that shines into a cone.
    position_m, towards_m : (3,) tuple
        Position of the lamp and the point it is aimed at, m, in the camera frame; an area light in the camera's sight
        is refused.
    level : float
        Level of a white matt surface at `towards_m` that faces the lamp.
    diameter_m : float
        Diameter of an area light, m.
    cone_deg : float
        Half the opening angle of a spot's cone; it fades from three quarters of it outwards.
    """

    kind: str = "area"
    position_m: tuple[float, float, float] = (-0.3, -0.3, -0.3)
    towards_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    level: float = 1.0
    diameter_m: float = 0.15
    cone_deg: float = 20.0

    def __post_init__(self) -> None:
        """Check the values."""
        one_of("kind", self.kind, ("area", "spot"))
        vector("position_m", self.position_m, 3)
        vector("towards_m", self.towards_m, 3)
        if self.position_m == self.towards_m:
            raise ValueError(f"towards_m = {self.towards_m}: expected a place other than the lamp's own position_m")
        within("level", self.level, 0.0)
        within("diameter_m", self.diameter_m, 0.0, above=True)
        within("cone_deg", self.cone_deg, 0.0, 89.0, above=True)


@dataclass(frozen=True)
class Lighting:
    """All lights of the scene.

    Attributes
    ----------
    uniform : float
        Level of the light that comes equally from all directions: that of a white matt ball without shading objects.
    lights : tuple of Light
        Lamps.
    """

    uniform: float = 1.0
    lights: tuple[Light, ...] = ()

    def __post_init__(self) -> None:
        """Check the values."""
        within("uniform", self.uniform, 0.0)


def disc_points(light: Light) -> NDArray[np.float64]:
    """Points all over an area light.

    Parameters
    ----------
    light : Light
        The lamp.

    Returns
    -------
    (n, 3) ndarray
        m, in the camera frame.
    """
    axis = np.subtract(light.towards_m, light.position_m)
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across /= np.linalg.norm(across)
    down = np.cross(axis, across) / np.linalg.norm(axis)
    angle, radius = np.meshgrid(np.linspace(0, 2 * np.pi, 48, endpoint=False), np.linspace(0, light.diameter_m / 2, 12))
    angle, radius = angle.reshape(-1, 1), radius.reshape(-1, 1)
    return np.asarray(light.position_m) + radius * (np.cos(angle) * across + np.sin(angle) * down)


def uniform_emitter(level: float) -> dict[str, Any]:
    """Give the emitter that surrounds the scene."""
    return {"type": "constant", "radiance": {"type": "rgb", "value": level}}


def lamp(light: Light, unit_m: float) -> dict[str, Any]:
    """Give a lamp's emitter.

    A white matt surface under the irradiance E has the radiance E / pi. A spot of intensity I gives E = I / d^2 at the
    distance d; a disc of radius a and radiance L, seen from its axis, E = pi L a^2 / (a^2 + d^2).

    Parameters
    ----------
    light : Light
        The lamp.
    unit_m : float
        Length of the scene's unit, m.

    Returns
    -------
    dict
        For `mitsuba.load_dict`.
    """
    import mitsuba as mi

    start, end = (np.asarray(place) / unit_m for place in (light.position_m, light.towards_m))
    distance = float(np.linalg.norm(end - start))
    axis = (end - start) / distance
    up = [1.0, 0.0, 0.0] if abs(axis[0]) < math.sqrt(0.5) else [0.0, 1.0, 0.0]
    place = mi.ScalarTransform4f().look_at(origin=start.tolist(), target=end.tolist(), up=up)
    if light.kind == "spot":
        intensity = light.level * math.pi * distance**2
        return {
            "type": "spot",
            "to_world": place,
            "intensity": {"type": "rgb", "value": intensity},
            "cutoff_angle": light.cone_deg,
            "beam_width": 0.75 * light.cone_deg,
        }
    radius = light.diameter_m / 2 / unit_m
    radiance = light.level * (radius**2 + distance**2) / radius**2
    return {
        "type": "disk",
        "to_world": place @ mi.ScalarTransform4f().scale([radius, radius, 1.0]),
        "emitter": {"type": "area", "radiance": {"type": "rgb", "value": radiance}},
    }
