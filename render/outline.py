"""The ball's outline in the image, and the visible share of the area that it encloses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from .background import StillObject
from .camera import Camera

Array = NDArray[np.float64]

#: Points of an outline, and cells across its diameter: they give a share of the area to 0.001.
_POINTS, _CELLS = 360, 160

#: Gauss-Newton steps that fit a circle: an outline is nearly circular, so each step reduces the error a hundredfold.
_ROUNDS = 10


def outline(camera: Camera, centre_m: Array, radius_m: float) -> Array:
    """Points of a ball's outline.

    The lines of sight that touch a ball of radius R at the distance D touch it along a circle. This circle has the
    radius ``R sqrt(1 - (R/D)^2)``; its centre lies at the share ``1 - (R/D)^2`` of the way to the ball's centre.

    Parameters
    ----------
    camera : Camera
        The camera.
    centre_m : (3,) ndarray
        The ball's centre, m.
    radius_m : float
        The ball's radius, m.

    Returns
    -------
    (n, 2) ndarray
        x and y, px, at equal angles; NaN for points that the camera cannot image.
    """
    angle = np.linspace(0.0, 2 * np.pi, _POINTS, endpoint=False)[:, None]
    axis, share = np.array([0.0, 0.0, 1.0]), 1.0
    if camera.model == "pinhole":
        distance = float(np.linalg.norm(centre_m))
        axis, share = centre_m / distance, 1.0 - (radius_m / distance) ** 2
    right = np.cross([0.0, 1.0, 0.0], axis)
    right /= np.linalg.norm(right)
    around = np.cos(angle) * right + np.sin(angle) * np.cross(axis, right)
    middle = share * centre_m if camera.model == "pinhole" else centre_m
    return camera.project(middle + radius_m * np.sqrt(share) * around)


def circle(points: Array) -> Array:
    """Fit a circle to a closed line.

    Parameters
    ----------
    points : (n, 2) ndarray
        Points along the line, px, in their order.

    Returns
    -------
    (3,) ndarray
        x, y and radius, px, by least squares of the distances, with equal weight for equal lengths of the line; NaN if
        a point is NaN.
    """
    middle = points.mean(axis=0)
    found = np.array([*middle, np.hypot(*(points - middle).T).mean()])
    if not np.isfinite(found).all():
        return np.full(3, np.nan)
    to_next = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
    weight = np.sqrt(to_next + np.roll(to_next, 1))
    for _ in range(_ROUNDS):
        offset = points - found[:2]
        distance = np.hypot(*offset.T)
        design = np.column_stack((offset / distance[:, None], np.ones_like(distance)))
        found = found + np.linalg.lstsq(weight[:, None] * design, weight * (distance - found[2]), rcond=None)[0]
    return found


def visible(camera: Camera, centre_m: Array, radius_m: float, objects: tuple[StillObject, ...]) -> float:
    """Share of the area within a ball's outline that is in the image and not hidden by a still object.

    Parameters
    ----------
    camera : Camera
        The camera.
    centre_m : (3,) ndarray
        The ball's centre, m.
    radius_m : float
        The ball's radius, m.
    objects : tuple of StillObject
        Objects that may hide the ball.

    Returns
    -------
    float
        Exactly 1 for the whole area and 0 for none, else to 0.001; also 0 if the camera cannot image the whole outline.
    """
    edge = outline(camera, centre_m, radius_m)
    if not np.isfinite(edge).all():
        return 0.0
    low, high = edge.min(axis=0), edge.max(axis=0)
    size = np.array([camera.width, camera.height])
    inside = (low >= -0.5).all() and (high <= size - 0.5).all()
    if inside and not objects:
        return 1.0
    cells = (np.arange(_CELLS) + 0.5) / _CELLS
    x, y = np.meshgrid(*(low[:, None] + (high - low)[:, None] * cells))
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    origin, direction = _lines(camera, pixels)
    reach = _ball(origin - centre_m, direction, radius_m)
    ball = np.isfinite(reach)
    seen = ball & ((pixels > -0.5) & (pixels < size - 0.5)).all(axis=1)
    for thing in objects:
        first = _still(thing, origin[seen], direction[seen])
        # Objects behind a pinhole camera hide nothing.
        first[(first <= 0) & (camera.model == "pinhole")] = np.inf
        seen[seen] = first >= reach[seen]
    return float(seen.sum() / ball.sum())


def _lines(camera: Camera, pixels: Array) -> tuple[Array, Array]:
    """Origins and directions (n, 3) of the lines of sight, m; along each z grows by 1 per unit of length."""
    offset = pixels - np.asarray(camera.centre_px)
    ahead = np.ones(len(pixels))
    if camera.model == "orthographic":
        place = offset / camera.px_per_m(1.0)
        return np.column_stack((place, 0 * ahead)), np.column_stack((0 * place, ahead))
    seen = np.hypot(*offset.T) / camera.focal_px
    stretch = np.divide(camera.undistort(seen), seen, out=np.ones_like(seen), where=seen > 0)
    return np.zeros((len(pixels), 3)), np.column_stack((offset / camera.focal_px * stretch[:, None], ahead))


def _ball(origin: Array, direction: Array, radius_m: float) -> Array:
    """Distances at which lines (n, 3) enter a ball at the origin; NaN for lines that miss it."""
    return _roots((direction**2).sum(1), (origin * direction).sum(1), (origin**2).sum(1) - radius_m**2)[0]


def _roots(a: Array, half_b: Array, c: Array) -> tuple[Array, Array]:
    """The lower and the upper root of ``a t^2 + 2 half_b t + c``; NaN if there is none."""
    square = half_b**2 - a * c
    root = np.sqrt(np.where(square >= 0, square, np.nan))
    with np.errstate(divide="ignore", invalid="ignore"):
        return (-half_b - root) / a, (-half_b + root) / a


def _still(thing: StillObject, origin: Array, direction: Array) -> Array:
    """Distances at which lines (n, 3) enter a still object; infinite for lines that miss it."""
    turned = Rotation.from_rotvec(np.radians(thing.turn_deg)).as_matrix()
    start, along = (origin - np.asarray(thing.centre_m)) @ turned, direction @ turned
    half = np.asarray(thing.size_m) / 2
    slabs = (0, 1, 2) if thing.kind == "box" else (2,)
    enter, leave = np.full(len(start), -np.inf), np.full(len(start), np.inf)
    for k in slabs:
        with np.errstate(divide="ignore", invalid="ignore"):
            sides = np.sort((np.array([[-half[k]], [half[k]]]) - start[:, k]) / along[:, k], axis=0)
        enter, leave = np.fmax(enter, sides[0]), np.fmin(leave, sides[1])
    if thing.kind == "bar":
        start, along = start[:, :2], along[:, :2]
        first, last = _roots((along**2).sum(1), (start * along).sum(1), (start**2).sum(1) - half[0] ** 2)
        # A line parallel to the bar is inside over its whole length, or outside.
        parallel, within = ~along.any(axis=1), (start**2).sum(1) < half[0] ** 2
        first = np.where(parallel & within, -np.inf, first)
        last = np.where(parallel & within, np.inf, last)
        enter, leave = np.maximum(enter, first), np.minimum(leave, last)
    return np.where(enter < leave, enter, np.inf)
