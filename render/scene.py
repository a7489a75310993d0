"""Everything that makes a picture, and Mitsuba's scene of it.

The scene's unit of length is the ball's radius, for Mitsuba computes in single precision and its tolerances are
absolute.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .background import Background, still_shapes
from .ball import Ball
from .camera import Camera
from .check import one_of, within
from .exposure import Shutter
from .light import Lighting, lamp, uniform_emitter
from .pattern import Chart, Pattern
from .sensor import Sensor


@dataclass(frozen=True)
class Quality:
    """How carefully to render.

    Attributes
    ----------
    samples : int
        Light paths per pixel and frame, shared among the sub-frames of the shutter; `render.frames` has their noise.
    bounces : int
        Largest number of reflections between a lamp and the camera; 1 leaves out the light that still objects and the
        ball reflect onto each other.
    variant : str or None
        One of `render.backend.VARIANTS`; None is the fastest that works.
    seed : int
        Seed of the light paths.
    """

    samples: int = 64
    bounces: int = 1
    variant: str | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the values."""
        within("samples", self.samples, 1, 1 << 16)
        within("bounces", self.bounces, 1, 32)
        within("seed", self.seed, 0)
        if self.variant is not None:
            one_of("variant", self.variant, ("cuda_ad_mono", "llvm_ad_mono", "scalar_rgb"))


@dataclass(frozen=True)
class Setup:
    """Everything but the motion.

    Attributes
    ----------
    ball, pattern, camera, lighting, background, shutter, sensor, quality
        The parts, described by their classes.
    """

    ball: Ball = field(default_factory=Ball)
    pattern: Pattern = field(default_factory=Pattern)
    camera: Camera = field(default_factory=Camera)
    lighting: Lighting = field(default_factory=Lighting)
    background: Background = field(default_factory=Background)
    shutter: Shutter = field(default_factory=Shutter)
    sensor: Sensor = field(default_factory=Sensor)
    quality: Quality = field(default_factory=Quality)


@dataclass(frozen=True)
class Pass:
    """A part of the light: its scene, what computes the light in it, and the handle on the scene's parameters."""

    scene: Any
    integrator: Any
    params: Any


def passes(setup: Setup, texture: Chart) -> list[Pass]:
    """Build the scenes whose pictures add up to the picture.

    The uniform light and the lamps are rendered apart: a matt surface under uniform light needs no choice of a light,
    so that following its reflection alone leaves no noise at all.

    Parameters
    ----------
    setup : Setup
        What to render.
    texture : Chart
        The pattern.

    Returns
    -------
    list of Pass
        One or two; with the lights all off the uniform one, dark.
    """
    import mitsuba as mi

    unit_m = setup.ball.radius_m
    paint = mi.load_dict(_paint(setup.ball, texture))
    stills = [shape for thing in setup.background.objects for shape in still_shapes(thing, unit_m)]
    built = []
    lamps = [lamp(light, unit_m) for light in setup.lighting.lights if light.level > 0]
    for emitters in ([uniform_emitter(setup.lighting.uniform)], lamps):
        uniform = emitters is not lamps
        if not emitters or (uniform and setup.lighting.uniform == 0 and lamps):
            continue
        parts: dict[str, Any] = {"type": "scene", "ball": {"type": "sphere", "bsdf": paint}}
        parts |= {f"still{i}": shape for i, shape in enumerate(stills)}
        parts |= {f"emitter{i}": emitter for i, emitter in enumerate(emitters)}
        scene = mi.load_dict(parts)
        built.append(Pass(scene, mi.load_dict(_integrator(setup.quality.bounces, uniform)), mi.traverse(scene)))
    return built


def _integrator(bounces: int, uniform: bool) -> dict[str, Any]:
    if bounces > 1:
        return {"type": "path", "max_depth": bounces + 1, "hide_emitters": True}
    return {"type": "direct", "emitter_samples": 0 if uniform else 1, "bsdf_samples": 1, "hide_emitters": True}


def _paint(ball: Ball, texture: Chart) -> dict[str, Any]:
    import mitsuba as mi

    rows = texture.albedo.shape[0]
    inner = rows - 2 * texture.pad
    bitmap = {
        "type": "bitmap",
        "data": mi.TensorXf(np.ascontiguousarray(texture.albedo[..., None])),
        "raw": True,
        "wrap_mode": "repeat",
        "accel": False,  # a GPU's own interpolation has nine bits
        "to_uv": mi.ScalarTransform3f().translate([0.0, texture.pad / rows]).scale([1.0, inner / rows]),
    }
    if ball.gloss == 0:
        return {"type": "diffuse", "reflectance": bitmap}
    return {
        "type": "roughplastic",
        "diffuse_reflectance": bitmap,
        "specular_reflectance": {"type": "rgb", "value": ball.gloss},
        "distribution": "ggx",
        "alpha": ball.roughness,
        "int_ior": 1.5,
        "ext_ior": 1.0,
    }


def place_ball(part: Pass, centre: NDArray[np.float64], orientation: NDArray[np.float64]) -> None:
    """Move the ball.

    Parameters
    ----------
    part : Pass
        Its scene.
    centre : (3,) ndarray
        In ball radii, camera frame.
    orientation : (3, 3) ndarray
        Takes body-fixed points to the camera frame.
    """
    import mitsuba as mi

    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = orientation, centre
    part.params["ball.to_world"] = mi.AffineTransform4f(matrix.tolist())
    part.params.update()
