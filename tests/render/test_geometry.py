"""Outlines, marks and texture of rendered images against formulas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rendering import RADIUS_M, needs_mitsuba, outline, picture, steady
from scipy.spatial.transform import Rotation

from render.background import Background
from render.camera import Camera
from render.frames import render_radiance
from render.pattern import Mark, Pattern, albedo
from render.scene import Quality, Setup

pytestmark = needs_mitsuba

# With 1024 paths per pixel the edge in one row of pixels has a standard deviation of 0.002 px.
CAREFUL = Quality(samples=1024)
WHITE = Pattern(kind="plain", brightest=1.0)
ORTHOGRAPHIC = Camera(width=160, height=140)


def pinhole(distance: float, *, distorted: bool = False) -> Camera:
    """A camera that shows a ball at `distance` radii with a radius of about 50 px."""
    focal = 50.0 * distance
    # A distortion that moves the edge by several px at any focal length.
    square = (focal / 150.0) ** 2
    return Camera(
        model="pinhole",
        width=220,
        height=150,
        focal_px=focal,
        principal_px=(95.3, 70.8),
        distortion=(-0.08 * square, 0.02 * square**2, -0.002 * square**3) if distorted else (0.0, 0.0, 0.0),
    )


VIEWS = {
    "orthographic": (ORTHOGRAPHIC, (0.0, 0.0, 0.0)),
    "orthographic, far and aside": (ORTHOGRAPHIC, (0.0031234, -0.00321, 10.0)),
    "pinhole, 4 radii": (pinhole(4), (0.0, 0.0, 4 * RADIUS_M)),
    "pinhole, 4 radii, off axis": (pinhole(4), (0.0184, 0.0041, 4 * RADIUS_M)),
    "pinhole, 4 radii, distortion": (pinhole(4, distorted=True), (0.0184, 0.0041, 4 * RADIUS_M)),
    "pinhole, 200 radii": (pinhole(200), (0.0, 0.0, 200 * RADIUS_M)),
    "pinhole, 200 radii, off axis": (pinhole(200), (0.0184, 0.0041, 200 * RADIUS_M)),
    "pinhole, 200 radii, distortion": (pinhole(200, distorted=True), (0.0184, 0.0041, 200 * RADIUS_M)),
}
views = pytest.mark.parametrize(("camera", "centre"), VIEWS.values(), ids=VIEWS.keys())


def edges(image, points):
    """Errors of the right and the left edge in rows of pixels, and of both edges in columns, px.

    A pixel is the mean over its area, so the sum of a row from an inner pixel outwards is the mean distance of the
    edge.
    """
    found = []
    for picture_, along, down in ((image, points[:, 0], points[:, 1]), (image.T, points[:, 1], points[:, 0])):
        middle, half = (down.max() + down.min()) / 2, (down.max() - down.min()) / 2
        pivot = round(float((along.max() + along.min()) / 2))
        for row in range(int(middle - 0.7 * half), int(middle + 0.7 * half)):
            within = np.linspace(row - 0.5, row + 0.5, 101)
            for sign in (1, -1):
                side = sign * (along - pivot) > 0
                order = np.argsort(down[side])
                truth = np.interp(within, down[side][order], along[side][order]).mean()
                line = picture_[row, pivot + 1 :] if sign > 0 else picture_[row, :pivot]
                found.append(sign * (pivot + sign * (0.5 + line.sum()) - truth))
    return np.array(found)


@views
def test_the_outline_is_where_the_touching_cone_puts_it(camera, centre):
    setup = Setup(pattern=WHITE, camera=camera, background=Background(kind="dark"), quality=CAREFUL)
    image = picture(setup, steady(centre)) / 255
    error = edges(image, outline(camera, np.array(centre), RADIUS_M))
    assert len(error) > 200
    assert abs(error.mean()) < 0.001
    assert abs(error).max() < 0.01


def dot_centre(camera, centre, orientation, mark):
    """Centre of gravity of a mark's image: the integral over the dot of place times image area."""
    direction = np.asarray(mark.direction) / np.linalg.norm(mark.direction)
    across = np.cross(direction, [0.3, 0.8, -0.5])
    across /= np.linalg.norm(across)
    step = np.linspace(-1.5, 1.5, 301) * mark.diameter_mm / 15.0
    a, b = np.meshgrid(step, step, indexing="ij")
    points = direction + a[..., None] * across + b[..., None] * np.cross(direction, across)
    points /= np.linalg.norm(points, axis=-1, keepdims=True)
    dark = albedo(WHITE, points.reshape(-1, 3), 15.0) - albedo(
        replace(WHITE, marks=(mark,)), points.reshape(-1, 3), 15.0
    )
    places = camera.project(centre + RADIUS_M * points.reshape(-1, 3) @ orientation.T).reshape(*a.shape, 2)
    du, dv = np.gradient(places, axis=0), np.gradient(places, axis=1)
    area = np.abs(du[..., 0] * dv[..., 1] - du[..., 1] * dv[..., 0])
    weight = (dark.reshape(a.shape) * area)[..., None]
    return (weight * places).sum(axis=(0, 1)) / weight.sum()


@views
def test_marks_are_where_the_projection_puts_them(camera, centre):
    turn = Rotation.from_rotvec([0.5, -0.9, 1.3])
    for seen in ((0.0, 0.0, -1.0), (0.5, -0.3, -0.9), (-0.4, 0.45, -0.8)):
        mark = Mark(direction=tuple(turn.inv().apply(seen).tolist()), diameter_mm=2.4, albedo=0.0)
        # A white ball before a white backdrop is invisible: the mark alone is dark.
        setup = Setup(
            pattern=replace(WHITE, marks=(mark,)),
            camera=camera,
            background=Background(level=1.0),
            quality=Quality(samples=256),
        )
        dark = 1 - picture(setup, steady(centre, start=turn)) / 255
        y, x = np.mgrid[: camera.height, : camera.width]
        found = np.array([(dark * x).sum(), (dark * y).sum()]) / dark.sum()
        truth = dot_centre(camera, np.array(centre), turn.as_matrix(), mark)
        np.testing.assert_allclose(found, truth, rtol=0, atol=0.01)


TURNS = {
    "as painted": (0.0, 0.0, 0.0),
    "about x": (0.7, 0.0, 0.0),
    "about y": (0.0, -1.2, 0.0),
    "about z": (0.0, 0.0, 2.3),
    "a pole to the front": (1.2, 0.1, 0.0),
    "the other pole": (np.pi - 0.2, 0.0, 0.1),
    "the chart's seam to the front": (0.0, np.pi / 2, 0.0),
}


@pytest.mark.parametrize("turn", TURNS.values(), ids=TURNS.keys())
def test_texture_at_body_points_is_right_under_rotations(turn):
    pattern = Pattern(speckle_mm=3.0, sharpness=2.0, seed=5)
    image = picture(
        Setup(pattern=pattern, camera=ORTHOGRAPHIC, quality=Quality(samples=256)),
        steady(start=Rotation.from_rotvec(turn)),
    )
    # The mean over 8 x 8 points within each pixel, with the known body points P = A^T (x, y, -s).
    fine = (np.arange(8) + 0.5) / 8 - 0.5
    y, x = np.mgrid[:140, :160]
    x = (x[..., None, None] + fine[None, :] - 79.5 + 0 * fine[:, None]) / 50
    y = (y[..., None, None] + fine[:, None] - 69.5 + 0 * fine[None, :]) / 50
    inside = (x**2 + y**2).max(axis=(2, 3)) < 0.9**2
    seen = np.stack([x[inside], y[inside], -np.sqrt(1 - x[inside] ** 2 - y[inside] ** 2)], axis=-1).reshape(-1, 3)
    body = Rotation.from_rotvec(turn).inv().apply(seen)
    truth = 255 * albedo(pattern, body, 15.0).reshape(-1, 64).mean(axis=1)
    error = image[inside] - truth
    # The chart and the noise of 256 paths leave 0.06 rms; texture in the wrong place by 0.01 px would give 0.3 rms.
    assert truth.std() > 40
    assert np.sqrt((error**2).mean()) < 0.1
    assert abs(error).max() < 0.6


@pytest.mark.parametrize(
    ("spin", "moves"),
    [((0.0, 0.1, 0.0), (-5.0, 0.0)), ((0.1, 0.0, 0.0), (0.0, 5.0))],
    ids=["+wy moves the front to the left", "+wx moves the front down"],
)
def test_the_front_moves_as_the_signs_say(spin, moves):
    found = []
    for turn in (Rotation.identity(), Rotation.from_rotvec(spin)):
        setup = Setup(
            pattern=replace(WHITE, marks=(Mark(albedo=0.0),)), camera=ORTHOGRAPHIC, background=Background(level=1.0)
        )
        dark = 255 - picture(setup, steady(start=turn))
        y, x = np.mgrid[:140, :160]
        found.append(np.array([(dark * x).sum(), (dark * y).sum()]) / dark.sum())
    # R sin(0.1) = 4.99 px, less the effect of the dot's width.
    np.testing.assert_allclose(found[1] - found[0], moves, atol=0.1)


def test_plus_wz_turns_the_image_clockwise():
    mark = Mark(direction=(0.5, 0.0, -1.0), albedo=0.0)
    setup = Setup(pattern=replace(WHITE, marks=(mark,)), camera=ORTHOGRAPHIC, background=Background(level=1.0))
    dark = 255 - picture(setup, steady(start=Rotation.from_rotvec([0, 0, np.pi / 2])))
    y, x = np.mgrid[:140, :160]
    # From three o'clock to six o'clock, that is down.
    assert (dark * y).sum() / dark.sum() == pytest.approx(69.5 + 50 * 0.5 / np.sqrt(1.25), abs=0.3)
    assert (dark * x).sum() / dark.sum() == pytest.approx(79.5, abs=0.02)


@pytest.mark.parametrize("name", ["orthographic, far and aside", "pinhole, 4 radii, off axis"])
def test_the_variant_without_compiled_kernels_shows_the_same(name):
    camera, centre = VIEWS[name]
    setup = Setup(pattern=Pattern(speckle_mm=3.0, sharpness=2.0), camera=camera, quality=Quality(samples=256))
    slow = replace(setup, quality=replace(setup.quality, variant="scalar_rgb"))
    difference = picture(setup, steady(centre)) - picture(slow, steady(centre))
    # The noise of the difference: 0.1 grey levels rms inside and 0.6 on the edge. A shift by 0.02 px would give 1 rms.
    assert np.sqrt((difference**2).mean()) < 0.2
    assert abs(difference.mean()) < 0.005


def test_distortion_is_refused_where_the_variant_has_none():
    camera = pinhole(4, distorted=True)
    setup = Setup(camera=camera, quality=Quality(variant="scalar_rgb"))
    with pytest.raises(ValueError, match="distortion = "):
        picture(setup, steady((0.0, 0.0, 0.06)))


def test_a_ball_at_the_pinhole_or_behind_it_is_refused():
    setup = Setup(camera=Camera(model="pinhole"))
    for first, speed in (((0.0, 0.0, -1.0), 0.0), ((0.0, 0.0, 0.1), -1.0)):
        motion = steady(first, velocity_m_s=(0.0, 0.0, speed))
        with pytest.raises(ValueError, match="position_m has z"):
            next(render_radiance(setup, motion, np.ones(1)))
