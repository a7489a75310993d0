"""The view along the line to the ball's centre: outline, turn, derivatives, distortion, and the ray caster's images."""

import math
from dataclasses import replace

import pytest
import torch
from ball_models import RADIUS, SIZE, grown, poses, random, rough_ball, smooth_ball
from shots import rotation_matrix
from torch import Tensor

from torchsphere.geometry.camera import Camera, outline_distance
from torchsphere.sphere_map import forward_model, registration
from torchsphere.sphere_map.ball import Poses, TexturedBall
from torchsphere.sphere_map.perspective import Optics, orthographic
from torchsphere.sphere_map.pixel_weights import uniform_profile
from torchsphere.sphere_map.window import Windows, cut_windows

CPU = torch.device("cpu")

#: A camera six radii away, whose axis meets the image far from the ball, and one with a lens that bends.
NEAR = Camera(focal_px=120.0, principal_px=(-20.0, 70.0))
BENT = replace(NEAR, distortion=(-0.12, 0.02, 0.0))


def seen_by(camera: Camera, at: Poses) -> Windows:
    background = 40 + 5 * random(SIZE, SIZE, seed=4)
    images = 90 + 9 * random(len(at), SIZE, SIZE, seed=5)
    return cut_windows(images, background, at.centre, at.radii(RADIUS), optics=Optics.of(camera, CPU))


def single(seen: Windows) -> Windows:
    bend = None if seen.bend is None else seen.bend.float()
    parts = (seen.levels.float(), seen.background.float(), seen.visibility.float())
    return Windows(*parts, seen.origin, seen.optics, bend)


def straight_poses(n: int = 2) -> Poses:
    """Poses well within the image, with the lens's distortion removed."""
    at = poses(n)
    return replace(at, centre=Optics.of(BENT, CPU).straightened(at.centre))


@pytest.mark.parametrize("camera", [NEAR, BENT], ids=["pinhole", "distortion"])
def test_the_outline_is_a_circle_along_the_line_to_the_centre(camera: Camera) -> None:
    """The tangent cone of the sphere, by the formula of the camera model, lies at one radius."""
    optics, angles = Optics.of(camera, CPU), torch.arange(12, dtype=torch.float64) * (math.pi / 6)
    centre = torch.tensor([[31.0, 22.0]], dtype=torch.float64)
    reach = outline_distance(torch.tensor([[31.0, 22.0, RADIUS]], dtype=torch.float64), angles, camera)[0]
    points = centre + reach[:, None] * torch.stack((angles.cos(), angles.sin()), -1)
    straight, middle = optics.straightened(points), optics.straightened(centre)
    offset = (straight - middle).reshape(1, 1, -1, 2)
    x, y = optics.view(middle).offsets(offset[..., 0], offset[..., 1])
    torch.testing.assert_close((x.square() + y.square()).sqrt()[0, 0], torch.full((12,), RADIUS).double())
    # The outline's distances from the projected centre differ by several px.
    assert float(reach.max() - reach.min()) > 2


def test_a_lens_bends_points_and_straightens_them_again() -> None:
    optics = Optics.of(BENT, CPU)
    points = torch.tensor([[5.0, 9.0], [50.0, 55.0]], dtype=torch.float64)
    torch.testing.assert_close(optics.straightened(optics.bent(points)), points, atol=1e-6, rtol=0)
    assert float((optics.bent(points) - points).norm(dim=1).min()) > 0.5


def test_a_camera_infinitely_far_away_sees_what_an_orthographic_view_shows() -> None:
    at, ball = poses(), rough_ball()
    far = cut_windows(90 + random(2, SIZE, SIZE), 40 + random(SIZE, SIZE), at.centre, RADIUS)
    optics = orthographic((SIZE, SIZE), CPU)
    expected, found = (forward_model.linearise(w, at, ball) for w in (far, far.seen_by(optics)))
    torch.testing.assert_close(found.levels, expected.levels, atol=1e-10, rtol=0)
    torch.testing.assert_close(found.jacobian, expected.jacobian, atol=1e-8, rtol=1e-8)


def test_a_ball_that_moves_right_shows_its_left_side() -> None:
    """As if it had turned by -step / distance about y: +w_y moves the front to the left."""
    optics = Optics.of(Camera(focal_px=200.0, principal_px=(30.0, 30.0)), CPU)
    centre = torch.tensor([[30.0, 30.0], [31.0, 30.0]], dtype=torch.float64)
    along = optics.view(centre).along(torch.eye(3, dtype=torch.float64).repeat(2, 1, 1))
    turned = along[1] @ along[0].T
    torch.testing.assert_close(turned, rotation_matrix(torch.tensor([0.0, -math.atan(1 / 200), 0.0]).double()))
    motion = optics.view(centre).motion(torch.full((2,), RADIUS).double())[0]
    # Rotations times the radius: 20 / 200 px about y per px to the right; the step itself is not changed.
    torch.testing.assert_close(motion[:, 0], torch.tensor([1.0, 0.0, 0.0, -0.1, 0.0]).double())


def levels_of(unknowns: Tensor, seen: Windows, at: Poses, ball: TexturedBall) -> Tensor:
    """Grey levels (p,) of one image after a change (6,) of pose and radius, px, rotations times the radius."""
    x, y, z = unknowns[2:5] / at.radii(RADIUS)
    none = torch.zeros_like(x)
    turn = torch.linalg.matrix_exp(torch.stack((none, -z, y, z, none, -x, -y, x, none)).reshape(3, 3))
    moved = replace(at, centre=at.centre + unknowns[:2], orientation=turn @ at.orientation)
    ball = replace(ball, radius=ball.radius + unknowns[5])
    return forward_model.design(seen, moved, ball).levels(ball.coefficients).flatten()


@pytest.mark.parametrize("camera", [NEAR, BENT], ids=["pinhole", "distortion"])
def test_the_derivatives_in_perspective_are_those_of_automatic_differentiation(camera: Camera) -> None:
    at, ball = grown(straight_poses(1)), smooth_ball()
    seen = seen_by(camera, at)
    exact = torch.func.jacfwd(lambda u: levels_of(u, seen, at, ball))(torch.zeros(6, dtype=torch.float64))
    found = forward_model.linearise(seen, at, ball).jacobian[0, :, :6]
    x, y = seen.offsets(at.centre)
    inner = ((x.square() + y.square()).sqrt() < 0.85 * RADIUS).flatten() & (seen.visibility > 0).flatten()
    rms = exact[inner].square().mean(0).sqrt()
    # Rotations are exact. A step is taken for one across the line of sight of all points, which near the limb errs by

    assert float(((found - exact)[inner][:, 2:5].abs() / rms[2:5]).max()) < 1e-9
    off = (found - exact)[inner].square().mean(0).sqrt() / rms
    assert float(off[:2].max()) < 0.02
    assert float(off[5]) < 0.02


@pytest.mark.parametrize("camera", [NEAR, BENT], ids=["pinhole", "distortion"])
def test_loops_and_torch_give_the_same_model_in_perspective(camera: Camera) -> None:
    at, ball = grown(straight_poses()), rough_ball()
    seen = seen_by(camera, at)
    fast_ball = replace(ball, coefficients=ball.coefficients.float())
    exact, fast = forward_model.linearise(seen, at, ball), forward_model.linearise(single(seen), at, fast_ball)
    visible = seen.visibility > 0
    assert float((fast.levels - exact.levels)[visible].abs().max()) < 0.03
    scale = exact.jacobian[visible.flatten(1)].square().mean(0).sqrt()
    assert float(((fast.jacobian - exact.jacobian)[visible.flatten(1)].square().mean(0).sqrt() / scale).max()) < 1e-3
    drawn = forward_model.design(single(seen), at, fast_ball).levels(fast_ball.coefficients)
    assert float((drawn - exact.levels)[visible].abs().max()) < 0.03


@pytest.mark.parametrize("grows", [False, True])
def test_a_registration_in_perspective_is_the_same_by_loops_and_by_torch(*, grows: bool) -> None:
    at, ball = grown(straight_poses()), replace(rough_ball(), grows=grows)
    seen = seen_by(BENT, at)
    seen = replace(seen, levels=forward_model.linearise(seen, at, ball).levels + random(*seen.levels.shape, seed=8))
    start = at.moved(torch.tensor([[0.1, -0.1, 0.05, 0.1, -0.05]]).repeat(2, 1), RADIUS)
    profile = uniform_profile(ball.radius, 1.0)
    fast_ball = replace(ball, coefficients=ball.coefficients.float())
    exact, fast = (
        registration.register(*given, profile) for given in ((seen, start, ball), (single(seen), start, fast_ball))
    )
    torch.testing.assert_close(fast.poses.centre, exact.poses.centre, atol=1e-4, rtol=0)
    torch.testing.assert_close(fast.poses.orientation, exact.poses.orientation, atol=1e-5, rtol=0)
    torch.testing.assert_close(fast.covariance, exact.covariance, atol=1e-6, rtol=1e-2)
    assert float((exact.poses.centre - at.centre).abs().max()) < 0.05
    off = (fast.poses.added_radius - exact.poses.added_radius).abs()
    assert float(off.max()) < 1e-4 if grows else float(off.max()) == 0
    assert bool((exact.covariance[:, 5, 5] > 0).all()) == grows
