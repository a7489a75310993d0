"""A camera near the ball: rays, outlines and displacements against independent geometry."""

import math
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from shots import rotation_matrix

from torchsphere.correlation.options import Options
from torchsphere.geometry import motion_models
from torchsphere.geometry.camera import (
    Camera,
    View,
    distorted,
    outline_distance,
    sphere_of_outline,
    undistorted,
    view_of,
)
from torchsphere.geometry.motion_models import Geometry

Array = NDArray[np.float64]

FOCAL, PRINCIPAL, BENT = 400.0, (250.0, 130.0), (-0.12, 0.03, 0.0)
CAMERA, STRAIGHT = Camera(FOCAL, PRINCIPAL, BENT), Camera(FOCAL, PRINCIPAL)


def project(points: Array, camera: Camera) -> Array:
    """Image points (n, 2) of points (n, 3), by the textbook's formula."""
    assert camera.focal_px is not None
    plane = points[:, :2] / points[:, 2:]
    r2 = (plane**2).sum(1, keepdims=True)
    k1, k2, k3 = camera.distortion
    return camera.focal_px * plane * (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) + np.asarray(camera.principal_px)


def front(centre: Array, count: int = 20_000) -> Array:
    """Points (n, 3) spread evenly over the visible side of the unit sphere."""
    rng = np.random.default_rng(0)
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return normal[((centre + normal) * normal).sum(1) < 0]


# A distance of 8, and a distance at which the outline is 6 % larger than the ball at its centre's depth.
@pytest.mark.parametrize("centre", [(0.0, 0.0, 8.0), (2.0, -1.0, 8.0), (-0.8, 0.5, 3.0)])
@pytest.mark.parametrize("camera", [STRAIGHT, CAMERA])
def test_the_outline_is_the_image_of_the_tangent_cone(centre: tuple[float, float, float], camera: Camera) -> None:
    c = np.array(centre)
    axis = c / np.linalg.norm(c)
    across = np.linalg.svd(axis[None])[2][1:]
    phi = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    # The circle of contact lies at cos = 1 / |C| towards the camera.
    towards = 1 / np.linalg.norm(c)
    ring = np.cos(phi)[:, None] * across[0] + np.sin(phi)[:, None] * across[1]
    contact = c - towards * axis + math.sqrt(1 - towards**2) * ring
    seen = project(contact, camera)
    middle = project(c[None], camera)[0]
    offset = torch.from_numpy(seen - middle)
    angles = torch.atan2(offset[:, 1], offset[:, 0])
    circle = torch.tensor([[*middle, FOCAL / c[2]]], dtype=torch.float64)
    found = outline_distance(circle, angles, camera)[0]
    # Newton's steps converge to rounding.
    torch.testing.assert_close(found, offset.norm(dim=-1), atol=1e-7, rtol=0)


def test_an_outline_on_the_axis_has_the_radius_of_the_textbook() -> None:
    circle = torch.tensor([[*PRINCIPAL, FOCAL / 5]], dtype=torch.float64)
    found = outline_distance(circle, torch.tensor([0.0, 2.0], dtype=torch.float64), STRAIGHT)
    torch.testing.assert_close(found, torch.full_like(found, FOCAL / math.sqrt(24)), atol=1e-9, rtol=0)


@pytest.mark.parametrize("camera", [STRAIGHT, CAMERA])
def test_the_sphere_is_found_from_its_outline(camera: Camera) -> None:
    true = torch.tensor([330.0, 90.0, 45.0], dtype=torch.float64)
    angles = torch.arange(360, dtype=torch.float64) * (2 * math.pi / 360)
    reach = outline_distance(true[None], angles, camera)[0]
    points = true[:2] + reach[:, None] * torch.stack((angles.cos(), angles.sin()), -1)
    # The best circle through the ellipse, by algebra instead of the module's own iteration.
    design = torch.cat((2 * points, torch.ones(360, 1, dtype=torch.float64)), -1)
    x, y, rest = torch.linalg.lstsq(design, points.square().sum(-1, keepdim=True)).solution[:, 0]
    circle = torch.stack((x, y, (rest + x**2 + y**2).sqrt()))
    # The two kinds of best circle differ in second order of the ellipse's flattening, 3 % of 45 px.
    torch.testing.assert_close(sphere_of_outline(circle, camera), true, atol=0.05, rtol=0)
    assert float((circle - true).abs().max()) > 0.2


def test_distortion_and_its_inverse_cancel() -> None:
    rays = torch.rand(50, 2, dtype=torch.float64) - 0.5
    bent = torch.tensor(BENT, dtype=torch.float64)
    torch.testing.assert_close(undistorted(distorted(rays, bent), bent), rays, atol=1e-9, rtol=0)


@pytest.mark.parametrize("camera", [STRAIGHT, CAMERA])
@pytest.mark.parametrize("distance", [3.0, 10.0, 200.0])
def test_points_of_the_ball_move_as_in_the_independent_geometry(camera: Camera, distance: float) -> None:
    assert camera.focal_px is not None
    centre = distance * np.array([0.2, -0.15, 1.0])
    moved_centre = (distance / 1.02) * np.array([0.21, -0.155, 1.0])
    turn = np.array([0.02, -0.05, 0.03])
    rotation = rotation_matrix(torch.from_numpy(turn)).numpy()
    body = front(centre)
    before, after = project(centre + body, camera), project(moved_centre + body @ rotation.T, camera)
    middle, next_middle = project(centre[None], camera)[0], project(moved_centre[None], camera)[0]
    q = torch.tensor([*(next_middle - middle), *turn, 0.02], dtype=torch.float64)
    view = view_of(camera, torch.from_numpy(middle[None]), q)
    radius = torch.tensor(camera.focal_px / distance, dtype=torch.float64)
    one = Geometry(radius, View(*(None if field is None else field[0] for field in view)))
    found = motion_models.pinhole6(q, torch.from_numpy(before - middle), one).numpy()
    visible = ((moved_centre + body @ rotation.T) * (body @ rotation.T)).sum(1) < 0
    assert (np.isfinite(found[:, 0]) == visible).mean() > 0.9999
    both = visible & np.isfinite(found[:, 0])
    # At the limb the inverse square root magnifies rounding: 1e-16 of 1 becomes 1e-8 of the radius.
    np.testing.assert_allclose(found[both], (after - before)[both], atol=2e-6)


def test_single_precision_loses_no_digits_of_a_far_ball() -> None:
    points = 40 * (torch.rand(200, 2, dtype=torch.float64) - 0.5)
    q = torch.tensor([1.0, -0.5, 0.02, -0.05, 0.03], dtype=torch.float64)

    def displaced(dtype: torch.dtype) -> torch.Tensor:
        view = View(*(torch.tensor(v, dtype=dtype) for v in ((100.0, 50.0), 50.0 * 200, (0.0, 0.0, 0.0))))
        return motion_models.pinhole(q.to(dtype), points.to(dtype), Geometry(torch.tensor(50.0, dtype=dtype), view))

    # An eighth of the tolerance of the iteration.
    torch.testing.assert_close(displaced(torch.float32).double(), displaced(torch.float64), atol=2.5e-5, rtol=0)


def test_a_far_camera_is_orthographic() -> None:
    points = 66 * (torch.rand(200, 2, dtype=torch.float64) - 0.5)
    q = torch.tensor([1.0, -0.5, 0.02, -0.05, 0.03], dtype=torch.float64)
    view = View(*(torch.tensor(v, dtype=torch.float64) for v in ((0.0, 0.0), 50.0 * 1e6, (0.0, 0.0, 0.0))))
    radius = torch.tensor(50.0, dtype=torch.float64)
    finite = motion_models.finite(q, points, Geometry(radius))
    # Perspective at 1e6 radii: a part in a million of displacements of 5 px, and limb points by its square root.
    torch.testing.assert_close(motion_models.pinhole(q, points, Geometry(radius, view)), finite, atol=1e-4, rtol=0)


def test_a_sideways_step_looks_like_a_rotation() -> None:
    # A ball that moves to the right without turning shows more of its left side: the front moves by R / D more than the
    # centre, as under a rotation of -dx / D about y (+wy moves the front left).
    view = View(*(torch.tensor(v, dtype=torch.float64) for v in ((0.0, 0.0), 500.0, (0.0, 0.0, 0.0))))
    geometry = Geometry(torch.tensor(50.0, dtype=torch.float64), view)
    moved = motion_models.pinhole(
        torch.tensor([1.0, 0, 0, 0, 0], dtype=torch.float64), torch.zeros(1, 2).double(), geometry
    )
    # At a distance of 10 radii the front is 9 radii away: it moves by 10/9 px.
    torch.testing.assert_close(moved[0], torch.tensor([10 / 9, 0.0], dtype=torch.float64), atol=1e-9, rtol=0)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({}, "either the focal length"),
        ({"focal_px": 500.0, "distance_radii": 9.0}, "not both"),
        ({"focal_px": -1.0}, "focal_px = -1.0"),
        ({"distance_radii": 0.5}, "above 1"),
        ({"focal_px": 500.0, "distortion": (0.1, 0.0)}, "3 finite numbers"),
        ({"focal_px": 500.0, "principal_px": (math.nan, 0.0)}, "2 finite numbers"),
        ({"focal_px": "500"}, "focal_px = '500': expected"),
        ({"focal_px": 500.0, "distortion": 0.1}, "distortion = 0.1: expected 3 finite numbers"),
        ({"focal_px": 500.0, "principal_px": "12"}, "principal_px = '12': expected 2 finite numbers"),
    ],
)
def test_an_invalid_camera_is_refused(fields: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Camera(**fields)


def test_a_camera_accepts_arrays() -> None:
    given = Camera(500.0, np.array([256.0, 128.0]), np.array([-0.1, 0.02, 0.0]))  # type: ignore[arg-type]
    assert given == Camera(500.0, (256.0, 128.0), (-0.1, 0.02, 0.0))
    assert hash(given) == hash(Camera(500.0, (256.0, 128.0), (-0.1, 0.02, 0.0)))


@pytest.mark.parametrize(("model", "camera"), [("pinhole", None), ("pinhole6", None), ("rigid", Camera(500.0))])
def test_a_camera_without_its_models_and_the_reverse_are_refused(model: str, camera: Camera | None) -> None:
    with pytest.raises(ValueError, match="give both or neither"):
        Options(model=model, camera=camera)
