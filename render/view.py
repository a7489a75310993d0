"""The light that reaches each pixel: the camera's lines of sight through Mitsuba's scene.

This module computes the lines of sight, because Mitsuba's cameras have no radial distortion, and a change of their
image window costs time. A pixel is the mean over its area. The variant without arrays (`scalar_rgb`) must use
Mitsuba's cameras.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .camera import Camera
from .scene import Pass

#: Light paths computed together; more need more memory and save no time.
_AT_ONCE = 1 << 24


@dataclass(frozen=True)
class Window:
    """Part of the image: first column and row, and size, px."""

    left: int
    top: int
    width: int
    height: int


def window(camera: Camera, spheres: list[tuple[NDArray[np.float64], float]]) -> Window:
    """Give the part of the image that holds everything but the backdrop.

    Parameters
    ----------
    camera : Camera
        The camera.
    spheres : list of ((3,) ndarray, float)
        Centres and radii, m, of spheres that hold the ball and all objects.

    Returns
    -------
    Window
        At least one pixel; the whole image if a sphere comes too near to the camera's plane.
    """
    places = []
    for centre, radius in spheres:
        # The image of the cube around a sphere holds the image of the sphere. Distortion bends the cube's edges, so
        # points between the corners are projected, too.
        side = np.linspace(-1.0, 1.0, 9)
        grid = np.stack(np.meshgrid(side, side, side), axis=-1).reshape(-1, 3)
        shell = grid[np.abs(grid).max(axis=1) == 1.0]
        places.append(camera.project(centre + radius * shell))
    seen = np.concatenate(places)
    if np.isnan(seen).any():
        return Window(0, 0, camera.width, camera.height)
    size = np.array([camera.width, camera.height])
    low = np.clip(np.floor(seen.min(axis=0)).astype(int) - 2, 0, size - 1)
    high = np.clip(np.ceil(seen.max(axis=0)).astype(int) + 3, low + 1, size)
    (left, top), (width, height) = low, high - low
    return Window(int(left), int(top), int(width), int(height))


def look(
    part: Pass, camera: Camera, region: Window, *, unit_m: float, start: float, samples: int, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Light and cover of a window's pixels.

    Parameters
    ----------
    part : Pass
        The scene.
    camera : Camera
        The camera.
    region : Window
        The pixels.
    unit_m : float
        Length of the scene's unit, m.
    start : float
        z at which the orthographic camera's lines of sight begin, in scene units.
    samples : int
        Light paths per pixel; rounded up to a full grid.
    seed : int
        Seed of the light paths.

    Returns
    -------
    light, cover : (height, width) ndarray
        Mean light from the ball and the still objects, and the share of the pixel covered by them.
    """
    import mitsuba as mi

    if mi.variant() == "scalar_rgb":
        return _look_scalar(part, camera, region, unit_m=unit_m, start=start, samples=samples, seed=seed)
    count = laid_out(samples)
    sampler = mi.load_dict({"type": "multijitter", "sample_count": count})
    sampler.set_samples_per_wavefront(count)
    rows = max(1, _AT_ONCE // (region.width * count))
    light, cover = [], []
    for first in range(0, region.height, rows):
        strip = Window(region.left, region.top + first, region.width, min(rows, region.height - first))
        sampler.seed((seed + first * 0x9E3779B1) & 0xFFFFFFFF, strip.width * strip.height * count)
        ray = mi.RayDifferential3f(*_lines(camera, strip, sampler, unit_m, start, count))
        both = _mean(part, sampler, ray, count)
        light.append(both[0].reshape(strip.height, strip.width))
        cover.append(both[1].reshape(strip.height, strip.width))
    return np.concatenate(light), np.concatenate(cover)


def laid_out(samples: int) -> int:
    """Round a number of samples up to a full, nearly square grid in the pixel.

    Parameters
    ----------
    samples : int
        At least 1.

    Returns
    -------
    int
        The product of the grid's sides.
    """
    rows = math.isqrt(samples)
    return rows * math.ceil(samples / rows)


def _mean(part: Pass, sampler: Any, ray: Any, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    import drjit as dr

    value, seen, _ = part.integrator.sample(part.scene, sampler, ray)
    light = dr.block_sum(dr.select(seen, value[0], 0.0), count)
    cover = dr.block_sum(dr.select(seen, type(value[0])(1.0), 0.0), count)
    dr.eval(light, cover)
    return light.numpy().astype(np.float64) / count, cover.numpy().astype(np.float64) / count


def _lines(camera: Camera, region: Window, sampler: Any, unit_m: float, start: float, count: int) -> tuple[Any, Any]:
    """Origins and directions of the lines of sight; the samples of a pixel are adjacent."""
    import drjit as dr
    import mitsuba as mi

    pixel = dr.arange(mi.UInt32, region.width * region.height * count) // dr.opaque(mi.UInt32, count)
    width = dr.opaque(mi.UInt32, region.width)
    jitter = sampler.next_2d()
    centre = camera.centre_px
    x = mi.Float(pixel % width) + dr.opaque(mi.Float, region.left - 0.5 - centre[0]) + jitter.x
    y = mi.Float(pixel // width) + dr.opaque(mi.Float, region.top - 0.5 - centre[1]) + jitter.y
    if camera.model == "orthographic":
        size = dr.opaque(mi.Float, 1 / (camera.px_per_m(1.0) * unit_m))
        return mi.Point3f(x * size, y * size, dr.opaque(mi.Float, start)), mi.Vector3f(0, 0, 1)
    size = dr.opaque(mi.Float, 1 / camera.focal_px)
    x, y = x * size, y * size
    if any(camera.distortion):
        stretch = _undistorted(camera.distortion, x * x + y * y)
        x, y = x * stretch, y * stretch
    return mi.Point3f(0, 0, 0), dr.normalize(mi.Vector3f(x, y, 1))


def _undistorted(distortion: tuple[float, float, float], square: Any) -> Any:
    """Give the factor that removes the distortion, at squared distorted distances, by Newton's method."""
    import drjit as dr
    import mitsuba as mi

    k1, k2, k3 = (dr.opaque(mi.Float, k) for k in distortion)
    # With the distorted distance r and the factor q: q (1 + k1 (q r)^2 + k2 (q r)^4 + k3 (q r)^6) = 1.
    q = mi.Float(1.0)
    for _ in range(8):
        p = q * q * square
        value = q * (1 + p * (k1 + p * (k2 + p * k3))) - 1
        slope = 1 + p * (3 * k1 + p * (5 * k2 + p * (7 * k3)))
        q = q - value / slope
    return q


def _look_scalar(
    part: Pass, camera: Camera, region: Window, *, unit_m: float, start: float, samples: int, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    import mitsuba as mi

    if any(camera.distortion):
        raise ValueError(
            f"distortion = {camera.distortion}: the variant {mi.variant()} has no camera with distortion; "
            "expected zeros, or a variant with compiled kernels (the package karellen-llvm-core brings what it needs)"
        )
    film = {
        "type": "hdrfilm",
        "width": camera.width,
        "height": camera.height,
        "crop_offset_x": region.left,
        "crop_offset_y": region.top,
        "crop_width": region.width,
        "crop_height": region.height,
        "pixel_format": "rgba",
        "component_format": "float32",
        "rfilter": {"type": "box"},
    }
    sampler = {"type": "multijitter", "sample_count": laid_out(samples)}
    sensor = mi.load_dict(_own_camera(camera, unit_m, start) | {"film": film, "sampler": sampler})
    picture = np.array(
        mi.render(part.scene, sensor=sensor, integrator=part.integrator, seed=mi.UInt32(seed)), dtype=np.float64
    )
    return picture[..., 0], picture[..., 3]


def _own_camera(camera: Camera, unit_m: float, start: float) -> dict[str, Any]:
    """Mitsuba's camera, turned by half a turn about z: its x points to the left and its y up."""
    import mitsuba as mi

    turned = mi.ScalarTransform4f().scale([-1, -1, 1])
    x, y = camera.centre_px
    off = (camera.width - 1) / 2 - x, (camera.height - 1) / 2 - y  # from the principal point to the middle of the image
    if camera.model == "orthographic":
        size = 1 / (camera.px_per_m(1.0) * unit_m)
        place = mi.ScalarTransform4f().translate([off[0] * size, off[1] * size, start])
        half = camera.width / 2 * size
        return {
            "type": "orthographic",
            "near_clip": 1e-3,
            "far_clip": 1e6,
            "to_world": place @ turned @ mi.ScalarTransform4f().scale([half, half, 1]),
        }
    return {
        "type": "perspective",
        "near_clip": 1e-2,
        "far_clip": 1e6,
        "fov_axis": "x",
        "fov": 2 * math.degrees(math.atan(camera.width / 2 / camera.focal_px)),
        "principal_point_offset_x": off[0] / camera.width,
        "principal_point_offset_y": off[1] / camera.height,
        "to_world": turned,
    }
