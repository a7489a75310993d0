"""The motion models and their modes."""

import math

import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from shots import rotation_matrix

from torchsphere.geometry import motion_models
from torchsphere.geometry.camera import View
from torchsphere.geometry.motion_models import Geometry

R = 50.0
VIEW = View(*(torch.tensor(v, dtype=torch.float64) for v in ((90.0, -40.0), 300.0, (-0.1, 0.02, 0.0))))
GEOMETRY = Geometry(torch.tensor(R, dtype=torch.float64), VIEW)
angles = st.floats(-0.3, 0.3)
shifts = st.floats(-3, 3)


def row(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


@pytest.fixture(scope="module")
def points() -> torch.Tensor:
    """Points (p, 2) of the disc up to 0.95 R, where every mode is smooth."""
    generator = torch.Generator().manual_seed(3)
    radius = 0.95 * R * torch.rand(60, generator=generator, dtype=torch.float64).sqrt()
    angle = 2 * math.pi * torch.rand(60, generator=generator, dtype=torch.float64)
    return torch.stack((radius * angle.cos(), radius * angle.sin()), -1)


# At (30, 0): s = 40. Printed phi3 = sqrt(1 - 900/2500) = 0.8 and phi4 = sqrt(1 - 0) = 1; rigid phi3 = phi4 = s/R = 0.8.
# At (0, 30): the same with x and y exchanged.
# At (30, 24): s = sqrt(2500 - 900 - 576) = 32. phi3 = sqrt(1 - 900/1924), phi4 = sqrt(1 - 576/1600) = 0.8; s/R = 0.64.
@pytest.mark.parametrize(
    ("at", "phi3", "phi4", "rigid"),
    [
        ((0.0, 0.0), 1.0, 1.0, 1.0),
        ((30.0, 0.0), 0.8, 1.0, 0.8),
        ((0.0, 30.0), 1.0, 0.8, 0.8),
        ((30.0, 24.0), 0.7295372041400, 0.8, 0.64),
        ((-30.0, 24.0), 0.7295372041400, 0.8, 0.64),
    ],
)
def test_modes_have_the_values_computed_by_hand(
    at: tuple[float, float], phi3: float, phi4: float, rigid: float
) -> None:
    x, y = at
    for model, along_x, along_y in ((motion_models.published, phi3, phi4), (motion_models.rigid, rigid, rigid)):
        modes = motion_models.modes(model, torch.zeros(1, 5, dtype=torch.float64), row(x, y)[None, None], GEOMETRY)[
            0, 0
        ]
        expected = torch.stack((row(1, 0, 0, -R * along_x, -y), row(0, 1, R * along_y, 0, x)))
        # Hand-computed decimals carry 13 digits.
        torch.testing.assert_close(modes, expected, atol=1e-10, rtol=0)


@pytest.mark.parametrize("name", motion_models.MODELS)
@pytest.mark.parametrize("q", [(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (1.3, -0.4, 0.02, -0.05, 0.03, 0.01)])
def test_modes_equal_finite_differences(name: str, q: tuple[float, ...], points: torch.Tensor) -> None:
    model = motion_models.MODELS[name]
    k = motion_models.degrees_of_freedom(model)
    centre = row(*q[:k])
    modes = motion_models.modes(model, centre[None], points[None], GEOMETRY)[0]
    h = 1e-5
    differences = torch.stack(
        [
            (model(centre + h * e, points, GEOMETRY) - model(centre - h * e, points, GEOMETRY)) / (2 * h)
            for e in torch.eye(k, dtype=torch.float64)
        ],
        -1,
    )
    # Central differences: R h^2 / 6 from the third derivative, and 50 px x 1e-16 / h from rounding, both near 1e-9.
    torch.testing.assert_close(modes, differences.nan_to_num(0.0), atol=1e-7, rtol=0)


@pytest.mark.parametrize("distortion", [None, row(-0.1, 0.02, 0.0)])
@pytest.mark.parametrize("name", ["pinhole", "pinhole6"])
def test_the_closed_forms_of_perspective_are_those_of_each_ball(
    name: str, distortion: torch.Tensor | None, points: torch.Tensor
) -> None:
    model = motion_models.MODELS[name]
    q = torch.stack((row(1.3, -0.4, 0.02, -0.05, 0.03, 0.01), row(-9.0, 5.0, 0.9, 0.4, -0.7, -0.2)))
    q = q[:, : motion_models.degrees_of_freedom(model)]
    views = [View(row(90.0, -40.0), row(300.0)[0], distortion), View(row(-30.0, 10.0), row(900.0)[0], distortion)]
    balls = [Geometry(row(radius)[0], view) for radius, view in zip((50.0, 48.0), views, strict=True)]
    both = None if distortion is None else torch.stack((distortion, distortion))
    view = View(torch.stack([v.centre for v in views]), torch.stack([v.focal for v in views]), both)
    batch, places = Geometry(row(50.0, 48.0), view), points.expand(2, -1, -1)
    for found, derivative, i in zip(
        motion_models.displacement(model, q, places, batch),
        motion_models.modes(model, q, places, batch),
        range(2),
        strict=True,
    ):
        expected = model(q[i], points, balls[i])
        torch.testing.assert_close(found, expected, atol=1e-10, rtol=0, equal_nan=True)
        slopes = torch.func.jacfwd(model)(q[i], points, balls[i])
        torch.testing.assert_close(derivative, slopes.nan_to_num(0.0), atol=1e-9, rtol=0)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(dx=shifts, dy=shifts, wx=angles, wy=angles, wz=angles)
def test_rigid_is_finite_to_first_order(dx: float, dy: float, wx: float, wy: float, wz: float) -> None:
    points = torch.tensor([[0.0, 0.0], [10, -20], [-30, 5], [25, 25]], dtype=torch.float64)
    w = math.hypot(wx, wy, wz)
    q = row(dx, dy, wx, wy, wz)
    difference = (
        (motion_models.rigid(q, points, GEOMETRY) - motion_models.finite(q, points, GEOMETRY)).norm(dim=-1).max()
    )
    # exp(W) P - P - W P is at most |w|^2 R / 2, and (4/3) of it allows for the higher orders up to 0.5 rad.
    assert difference <= 4 / 3 * w**2 * R / 2 + 1e-9


@settings(max_examples=30, deadline=None, derandomize=True)
@given(wx=angles, wy=angles, wz=angles)
@example(wx=0.0, wy=0.0, wz=0.046875)
@example(wx=0.0, wy=0.0, wz=1e-5)
def test_finite_moves_points_by_the_rotation_matrix(wx: float, wy: float, wz: float) -> None:
    points = torch.tensor([[0.0, 0.0], [10, -20], [-30, 5], [25, 25]], dtype=torch.float64)
    q = row(0.5, -0.25, wx, wy, wz)
    surface = torch.cat((points, -(R**2 - points.square().sum(-1, keepdim=True)).sqrt()), -1)
    expected = surface @ rotation_matrix(q[2:]).T
    moved = points + motion_models.finite(q, points, GEOMETRY)
    # Rounding of float64, at 50 px.
    torch.testing.assert_close(moved - q[:2], expected[:, :2], atol=1e-13, rtol=0)


def test_points_that_turn_out_of_sight_are_nan_and_have_no_modes() -> None:
    # 0.98 R lies 11.5 deg inside the limb. +wy moves the front to the left: 20 deg hide the left point.
    points = torch.tensor([[-0.98 * R, 0.0], [0.98 * R, 0.0], [0.0, 0.0]], dtype=torch.float64)
    q = row(0, 0, 0, math.radians(20), 0)
    assert motion_models.finite(q, points, GEOMETRY).isnan().all(-1).tolist() == [True, False, False]
    modes = motion_models.modes(motion_models.finite, q[None], points[None], GEOMETRY)[0]
    assert modes.isfinite().all()
    assert (modes[0] == 0).all()
    assert (modes[1] != 0).any()


def test_only_the_rotation_about_the_view_moves_the_outline() -> None:
    points = R * torch.tensor([[1.0, 0.0], [0.0, 1.0], [0.6, 0.8]], dtype=torch.float64)
    moved = motion_models.rigid(row(0, 0, 0.1, 0.1, 0), points, GEOMETRY)
    # 0.6 and 0.8 are not exact in binary: s = sqrt(R^2 1e-16) = 5e-7 px.
    torch.testing.assert_close(moved, torch.zeros_like(moved), atol=1e-6, rtol=0)


def test_a_batch_of_displacements_equals_its_rows(points: torch.Tensor) -> None:
    q = torch.tensor([[1.0, 0, 0.01, 0, 0], [0, 2, 0, 0.02, 0.03]], dtype=torch.float64)
    batch = motion_models.displacement(motion_models.finite, q, points.expand(2, -1, -1), GEOMETRY)
    for i in range(2):
        # The matrix exponential of a batch rounds differently; 50 px in float64 hold 1e-14 px each.
        torch.testing.assert_close(batch[i], motion_models.finite(q[i], points, GEOMETRY), atol=1e-11, rtol=0)
