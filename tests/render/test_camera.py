"""Projections against their formulas."""

from __future__ import annotations

import numpy as np
import pytest

from render.background import StillObject
from render.camera import Camera
from render.view import Window, window

POINTS = np.random.default_rng(3).uniform([-0.05, -0.05, 0.4], [0.05, 0.05, 0.8], (50, 3))


def test_orthographic_scales_and_shifts():
    camera = Camera(width=200, height=100, scale_px_per_mm=2.5)
    np.testing.assert_allclose(camera.project(POINTS), 2500 * POINTS[:, :2] + [99.5, 49.5], rtol=0, atol=1e-10)
    assert camera.px_per_m(3.0) == 2500


def test_pinhole_divides_by_the_depth():
    camera = Camera(model="pinhole", focal_px=1500.0, principal_px=(250.2, 130.7))
    truth = 1500 * POINTS[:, :2] / POINTS[:, 2:] + [250.2, 130.7]
    np.testing.assert_allclose(camera.project(POINTS), truth, rtol=0, atol=1e-10)
    assert camera.px_per_m(0.5) == 3000


def test_distortion_follows_the_published_polynomial():
    k1, k2, k3 = -0.2, 0.08, -0.01
    camera = Camera(model="pinhole", focal_px=1500.0, distortion=(k1, k2, k3))
    x, y = (POINTS[:, :2] / POINTS[:, 2:]).T
    r2 = x**2 + y**2
    factor = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    truth = np.stack([1500 * x * factor + 255.5, 1500 * y * factor + 127.5], axis=1)
    np.testing.assert_allclose(camera.project(POINTS), truth, rtol=0, atol=1e-9)


def test_undistort_is_the_inverse():
    camera = Camera(model="pinhole", focal_px=1500.0, distortion=(-0.2, 0.08, -0.01))
    radius = np.linspace(0, 0.5, 20)
    seen = radius * (1 - 0.2 * radius**2 + 0.08 * radius**4 - 0.01 * radius**6)
    np.testing.assert_allclose(camera.undistort(seen), radius, rtol=0, atol=1e-12)


def test_what_is_behind_the_camera_is_not_seen():
    points = np.array([[0.0, 0.0, -1.0], [0.1, 0.0, 0.0], [0.0, 0.0, 1.0]])
    seen = Camera(model="pinhole").project(points)
    assert np.isnan(seen[:2]).all()
    np.testing.assert_array_equal(seen[2], [255.5, 127.5])


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("model", "fisheye"),
        ("width", 0),
        ("height", -3),
        ("scale_px_per_mm", 0.0),
        ("focal_px", float("nan")),
        ("principal_px", (1.0, float("inf"))),
        ("distortion", (0.1, 0.0)),
    ],
)
def test_bad_fields_are_refused_by_name(field, value):
    with pytest.raises(ValueError, match=f"^{field} = "):
        Camera(**{"model": "pinhole", field: value})


def test_distortion_that_folds_the_image_over_is_refused():
    with pytest.raises(ValueError, match="folds over"):
        Camera(model="pinhole", focal_px=300.0, distortion=(-0.6, 0.0, 0.0))
    with pytest.raises(ValueError, match="only the pinhole"):
        Camera(distortion=(-0.1, 0.0, 0.0))


def test_the_window_holds_what_there_is_to_see():
    camera = Camera(model="pinhole", width=300, height=200, focal_px=800.0, distortion=(-0.15, 0.02, 0.0))
    rng = np.random.default_rng(1)
    for _ in range(20):
        centre, radius = rng.uniform([-0.05, -0.03, 0.3], [0.05, 0.03, 0.6]), rng.uniform(0.005, 0.02)
        shell = rng.normal(size=(2000, 3))
        seen = camera.project(centre + radius * shell / np.linalg.norm(shell, axis=1, keepdims=True))
        seen = seen[(seen > 0).all(axis=1) & (seen < [299, 199]).all(axis=1)]
        found = window(camera, [(centre, radius)])
        assert (seen >= [found.left, found.top]).all()
        assert (seen <= [found.left + found.width - 1, found.top + found.height - 1]).all()


def test_a_ball_beyond_the_frame_leaves_a_window():
    found = window(Camera(width=100, height=100), [(np.array([1.0, 0.0, 0.0]), 0.015)])
    assert found.width >= 1
    assert 0 <= found.left < 100


def test_something_beside_the_camera_opens_the_whole_window():
    thing = StillObject(centre_m=(0.0, 0.1, 0.02), size_m=(0.1, 0.1, 0.1))
    camera = Camera(model="pinhole")
    assert window(camera, [(np.array(thing.centre_m), thing.reach_m)]) == Window(0, 0, 512, 256)
