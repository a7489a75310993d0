"""The forward model: coverage, grey levels, derivatives, loops against torch, and agreement with the ray caster."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from ball_models import (
    CELLS,
    RADIUS,
    SIZE,
    dense_design,
    distances,
    grown,
    poses,
    random,
    random_directions,
    rough_ball,
    smooth_ball,
    sums_of_factors,
    windows,
)
from torch import Tensor

from torchsphere.sphere_map import cube_map, forward_model, map_fit, rays
from torchsphere.sphere_map.ball import Poses, TexturedBall, uniform_light
from torchsphere.sphere_map.design import Design
from torchsphere.sphere_map.forward_model import Linearisation
from torchsphere.sphere_map.window import Windows, cut_windows
from torchsphere.synthetic import ray_caster

#: Difference of the derivatives at the limb from those of the five rays there, as shares of a column. The derivatives
#: are those of the mean over a pixel: 2 to 4 % of a smooth texture, up to 17 % of white noise.
LIMB_ERRORS = (0.06, 0.2)

BENT = replace(smooth_ball(), edge_bend=0.4)
either_ball = pytest.mark.parametrize("ball", [smooth_ball(), rough_ball(), BENT], ids=["smooth", "rough", "bent"])


def single(seen: Windows) -> Windows:
    """The windows in single precision, for which the loops compute."""
    return Windows(seen.levels.float(), seen.background.float(), seen.visibility.float(), seen.origin)


def in_single(ball: TexturedBall) -> TexturedBall:
    return replace(ball, coefficients=ball.coefficients.float())


def levels_of(unknowns: Tensor, seen: Windows, at: Poses, ball: TexturedBall) -> Tensor:
    """Grey levels (p,) of one image after a change (9,) of the unknowns; differentiable."""
    x, y, z = unknowns[2:5] / at.radii(ball.radius.detach())
    none = torch.zeros_like(x)
    turn = torch.linalg.matrix_exp(torch.stack((none, -z, y, z, none, -x, -y, x, none)).reshape(3, 3))
    brightness = at.gain + unknowns[7], at.offset + unknowns[8]
    moved = Poses(at.centre + unknowns[:2], turn @ at.orientation, *brightness, at.added_radius)
    changed = replace(ball, radius=ball.radius + unknowns[5], edge_blur=ball.edge_blur + unknowns[6])
    return forward_model.design(seen, moved, changed).levels(ball.coefficients).flatten()


either_size = pytest.mark.parametrize("at", [poses(), grown(poses())], ids=["one size", "grows"])


def at_limb(seen: Windows, at: Poses) -> Tensor:
    """Pixels (n, s, s) for which the model draws more than two rays."""
    radius = at.radii(RADIUS).reshape(-1, 1, 1)
    return distances(seen, at) > (rays.LIMB_FROM * radius).minimum(radius - rays.LEAST_LIMB_PX) - rays.LIMB_RAMP_PX


def rms(values: Tensor) -> Tensor:
    return values.square().mean(0).sqrt()


def test_the_weights_of_a_pixels_rays_sum_to_its_share() -> None:
    at, ball = poses(), rough_ball()
    seen = windows(at)
    share, _, _ = rays.coverage(*seen.offsets(at.centre), ball.radius, ball.edge_blur)
    total = sums_of_factors(forward_model.design(seen, at, ball))
    torch.testing.assert_close(total, at.gain.reshape(-1, 1, 1) * share, atol=1e-12, rtol=0)
    fast = sums_of_factors(forward_model.design(single(seen), at, ball))
    visible = seen.visibility > 0
    assert float((fast - total)[visible].abs().max()) < 1e-4


def many_rays(seen: Windows, at: Poses, ball: TexturedBall, per_side: int) -> Tensor:
    """Grey levels (s, s) of one image as means over ``per_side`` x ``per_side`` rays, without blur of the edge."""
    x, y = seen.offsets(at.centre)
    total = torch.zeros_like(seen.levels)
    steps = (torch.arange(per_side, dtype=torch.float64) + 0.5) / per_side - 0.5
    for right in steps:
        for down in steps:
            u, v = torch.broadcast_tensors((x + right) / ball.radius, (y + down) / ball.radius)
            squared = u.square() + v.square()
            points = torch.stack((u, v, -(1 - squared.clamp_max(1 - 1e-9)).sqrt()))
            turned = torch.einsum("nij,inab->jnab", at.orientation, points)
            light = ball.light[0] + (ball.light[1:].reshape(3, 1, 1, 1) * points).sum(0)
            value = light * cube_map.places(turned, ball.cells).value(ball.coefficients)
            total += torch.where(squared < 1, value, seen.background)
    return (at.gain * total / per_side**2 + at.offset)[0]


def blurred(coefficients: Tensor, cells: int, variance: float) -> Tensor:
    """The map's coefficients (m,) blurred along both axes of each face by that variance, cells squared."""
    faces = coefficients.reshape(6, cells + 3, cells + 3)
    for axis in (1, 2):
        turned = faces.movedim(axis, 0)
        inner = (1 - variance) * turned[1:-1] + variance / 2 * (turned[2:] + turned[:-2])
        faces = torch.cat((turned[:1], inner, turned[-1:])).movedim(0, axis)
    return faces.flatten()


def test_the_grey_level_of_a_pixel_at_the_outline_is_the_mean_over_its_area() -> None:
    """With too few rays there, neighbouring pixels have equal errors, which bias a step."""
    at, cells = poses(1), 31
    seen = windows(at)
    least = torch.tensor(forward_model.MIN_BLUR_PX, dtype=torch.float64)
    texture = 110 + 29 * random(cube_map.coefficient_count(cells))
    sharp = TexturedBall(rough_ball().radius, least, cells, texture, uniform_light(least))
    # The map holds the texture as a pixel in front of it sees it.
    pixel = (cells / (cube_map.CELLS_PER_RADIUS * RADIUS)) ** 2 / 12
    ball = replace(sharp, coefficients=blurred(texture, cells, pixel))
    error = forward_model.linearise(seen, at, ball).levels[0] - many_rays(seen, at, sharp, 30)
    outline = (distances(seen, at)[0] - RADIUS).abs() < 0.8
    # White noise of 29 grey levels rms in cells of about one px. The error is 1.4; three rays leave 3.6, two 4.3.
    assert float(error[outline].square().mean().sqrt()) < 1.8


ball_and_error = pytest.mark.parametrize(
    ("ball", "limb_error"),
    [(smooth_ball(), LIMB_ERRORS[0]), (rough_ball(), LIMB_ERRORS[1]), (BENT, LIMB_ERRORS[0])],
    ids=["smooth", "rough", "bent"],
)


@either_size
@ball_and_error
def test_the_derivatives_are_those_of_automatic_differentiation(
    ball: TexturedBall, limb_error: float, at: Poses
) -> None:
    seen = windows(at)
    model, limb, visible = forward_model.linearise(seen, at, ball), at_limb(seen, at), seen.visibility > 0
    for i in range(len(at)):
        args = seen.take(slice(i, i + 1)), at.take(slice(i, i + 1)), ball
        exact = torch.func.jacfwd(lambda u, args=args: levels_of(u, *args))(torch.zeros(9, dtype=torch.float64))
        error, scale = model.jacobian[i] - exact, rms(exact[visible[i].flatten()])
        inner, outer = (visible[i] & part for part in (~limb[i], limb[i]))
        # Motion, radius: the limit of the distance from the outline's normal. All else is exact.
        assert float((error[inner.flatten()].abs() / scale).max()) < 1e-4
        exact_columns = [2, 3, 4, 6, 7, 8]
        assert float((error[:, exact_columns][visible[i].flatten()].abs() / scale[exact_columns]).max()) < 1e-9
        # At the limb the derivative is that of the mean over the pixel, in which rays stay in their place. Here it is
        # that of the rule's five rays.
        assert float((rms(error[outer.flatten()]) / rms(exact[outer.flatten()])).max()) < limb_error


@ball_and_error
def test_the_derivatives_of_the_grey_levels_are_difference_quotients(ball: TexturedBall, limb_error: float) -> None:
    at, step = poses(1), 1e-6
    seen = windows(at)
    visible, limb = (part.flatten() for part in (seen.visibility > 0, at_limb(seen, at)))
    changes = step * torch.eye(9, dtype=torch.float64)
    found = torch.stack(
        [(levels_of(u, seen, at, ball) - levels_of(-u, seen, at, ball)) / (2 * step) for u in changes], 1
    )
    error = forward_model.linearise(seen, at, ball).jacobian[0] - found
    scale = rms(found[visible])
    # Rounding of the grey levels over the step, and the derivative at the limb as above.
    assert float((error[visible & ~limb].abs() / scale).max()) < 1e-4
    assert float((rms(error[visible & limb]) / rms(found[visible & limb])).max()) < limb_error


@pytest.mark.parametrize(("dtype", "steps"), [(torch.float32, 400), (torch.float64, 40)], ids=["loops", "torch"])
def test_no_level_jumps_as_the_ball_moves(dtype: torch.dtype, steps: int) -> None:
    """A ball with white noise as its texture, which does not jump at the seams of the map, moves in small steps."""
    cells, step = 31, 0.0025
    along = step * torch.arange(steps, dtype=torch.float64)
    one = poses(1)
    at = Poses.at(one.centre + torch.stack((along, 0.3 * along), 1), one.orientation.expand(steps, 3, 3))
    seen = windows(one).take(torch.zeros(steps, dtype=torch.int64))
    values = 110 + 29 * random(cube_map.coefficient_count(cells))
    joined = cube_map.joined_at_seams(values, cells) / cube_map.faces_of_nodes(values, cells)
    ball = replace(rough_ball(), cells=cells, coefficients=map_fit.to_nodes(joined, cells).to(dtype))
    seen = single(seen) if dtype == torch.float32 else seen
    changes = torch.diff(forward_model.design(seen, at, ball).levels(ball.coefficients), dim=0).abs()
    # The texture has up to 220 levels per px. Without ramps between the rules of the rays levels jump by 12 and by 30,
    # and by 3 and by 27 in the shorter way of the reference, which takes a hundred times as long.
    assert float(changes.max()) < 1.0


def test_columns_have_the_signs_of_the_motion() -> None:
    """A bright ball that moves right uncovers background on its left; +w_y moves the front to the left."""
    at = Poses.at(*(getattr(poses(1), name) for name in ("centre", "orientation")))
    seen = windows(at)
    plain = replace(rough_ball(), light=uniform_light(torch.zeros(1, dtype=torch.float64)))
    plain = replace(plain, coefficients=torch.full_like(plain.coefficients, 200.0))
    model = forward_model.linearise(seen, at, plain)
    x, _ = seen.offsets(at.centre)
    left, right = (sign * x > 0.9 * RADIUS for sign in (-1, 1))
    by_x = model.jacobian[0, :, 0].reshape(model.levels.shape)
    assert float((by_x * left).sum()) < -100
    assert float((by_x * right).sum()) > 100
    # Grey levels that rise to the right: the front moves left, and brighter points come into view.
    rising = replace(plain, coefficients=as_coefficients(lambda d: 100 + 50 * (at.orientation[0] @ d)[0], CELLS))
    turned = forward_model.linearise(seen, at, rising).jacobian[0].reshape(*model.levels.shape, 9)
    middle = distances(seen, at) < 0.3 * RADIUS
    assert float(turned[..., 3][middle].max() / turned[..., 3][middle].mean()) < 1.5
    # The slope of the texture is 50 per radius, and the front moves by one px for a rotation of one px.
    assert float(turned[..., 3][middle].mean()) == pytest.approx(50 / RADIUS, rel=0.1)
    assert float(turned[..., 0][middle].mean()) == pytest.approx(-50 / RADIUS, rel=0.1)
    # +w_x moves the front down, which this texture does not show.
    assert abs(float(turned[..., 2][middle].mean())) < 0.05 * 50 / RADIUS


@either_size
@either_ball
def test_loops_and_torch_give_the_same_model(ball: TexturedBall, at: Poses) -> None:
    seen = windows(at)
    visible = seen.visibility > 0
    exact, fast = (forward_model.linearise(*given) for given in ((seen, at, ball), (single(seen), at, in_single(ball))))
    assert fast.levels.dtype == torch.float32
    # Single precision has 7 digits of grey levels of some hundred, and of places of some ten cells.
    assert float((fast.levels - exact.levels)[visible].abs().max()) < 0.02
    pixels = visible.flatten(1)
    difference = (fast.jacobian - exact.jacobian)[pixels].abs() / rms(exact.jacobian[pixels])
    limb = at_limb(seen, at).flatten(1)[pixels]
    assert float(difference[~limb].max()) < 3e-4
    # Distances from the outline, of which the roots are taken, lose digits: a single pixel may err by 0.002.
    assert float(difference[limb].max()) < 4e-3
    assert float(rms(difference[limb]).max()) < 3e-4


def designs(ball: TexturedBall, at: Poses) -> tuple[Windows, Design, Design]:
    seen = windows(at)
    return seen, forward_model.design(seen, at, ball), forward_model.design(single(seen), at, ball)


@either_size
@either_ball
def test_the_design_gives_the_levels_of_the_linearisation(ball: TexturedBall, at: Poses) -> None:
    seen, exact, fast = designs(ball, at)
    visible = seen.visibility > 0
    levels = forward_model.linearise(seen, at, ball).levels
    torch.testing.assert_close(exact.levels(ball.coefficients), levels, atol=1e-10, rtol=0)
    found = fast.levels(ball.coefficients.float())
    assert found.dtype == torch.float32
    assert float((found - levels)[visible].abs().max()) < 0.02
    # Pixels that no ray needs to be drawn for have none.
    assert float(sums_of_factors(fast)[~visible].abs().max()) == 0
    assert fast.factor.shape[1] < exact.factor.shape[1] / 2


def test_products_with_the_map_and_their_adjoints_belong_together() -> None:
    ball = rough_ball()
    seen, exact, fast = designs(ball, poses())
    shown = (seen.visibility > 0).double()
    values = shown * random(*shown.shape)
    total = exact.adjoint(values)
    # The two scalar products of an operator and its adjoint are equal.
    assert float(total @ ball.coefficients) == pytest.approx(
        float((values * exact.map_levels(ball.coefficients)).sum()), rel=1e-10
    )
    assert float((fast.adjoint(values.float()) - total).abs().max()) < 1e-4 * float(total.abs().max())


def test_an_even_map_is_drawn_without_a_look_up() -> None:
    _, exact, fast = designs(rough_ball(), poses())
    ones = torch.ones(cube_map.coefficient_count(exact.cells), dtype=torch.float64)
    torch.testing.assert_close(exact.even, exact.map_levels(ones), atol=1e-12, rtol=0)
    torch.testing.assert_close(fast.even, fast.map_levels(ones.float()), atol=1e-5, rtol=0)


def test_the_coupling_is_the_adjoint_of_each_column() -> None:
    seen, exact, fast = designs(rough_ball(), poses())
    shown = (seen.visibility > 0).double()
    columns, own = shown.flatten(1).unsqueeze(-1) * random(2, shown[0].numel(), 5), 3
    found = exact.coupling(columns, own)
    assert found.shape[1] == 2 * own + 2

    def alone(k: int, some: slice) -> Tensor:
        return exact.rows(some.start, some.stop).adjoint(columns[some, :, k].reshape(-1, *shown.shape[1:]))

    for k in range(own):
        for i in range(2):
            expected = alone(k, slice(i, i + 1))
            torch.testing.assert_close(found[:, own * i + k], expected, atol=1e-10, rtol=0)
    for k in range(own, 5):
        torch.testing.assert_close(found[:, own + k], alone(k, slice(0, 2)), atol=1e-10, rtol=0)
    assert float((fast.coupling(columns.float(), own) - found).abs().max()) < 1e-4 * float(found.abs().max())


def test_normal_equations_are_sums_over_the_pixels() -> None:
    at, ball = poses(), rough_ball()
    seen = windows(at)
    model = forward_model.linearise(seen, at, ball)
    weights, residual = seen.visibility * random(*seen.levels.shape).abs(), random(*seen.levels.shape, seed=7)
    expected = torch.einsum("npa,np,npb->nab", model.jacobian, weights.flatten(1), model.jacobian)
    right = torch.einsum("npa,np,np->na", model.jacobian, weights.flatten(1), residual.flatten(1))
    scale = expected.diagonal(dim1=1, dim2=2).sqrt()
    of_single = Linearisation(model.levels.float(), model.jacobian.float())
    for found, tolerance in (
        (model.normal(weights, residual), 1e-12),
        (of_single.normal(weights.float(), residual.float()), 3e-5),
    ):
        assert all(part.dtype == torch.float64 for part in found)
        assert float(((found[0] - expected) / (scale[:, :, None] * scale[:, None])).abs().max()) < tolerance
        assert float(((found[1] - right) / scale).abs().max()) < tolerance


def test_images_of_a_batch_are_those_one_by_one() -> None:
    at, ball = poses(3), in_single(rough_ball())
    seen = single(windows(at))
    whole = forward_model.linearise(seen, at, ball)
    parts = [forward_model.linearise(seen.take(slice(i, i + 1)), at.take(slice(i, i + 1)), ball) for i in range(3)]
    joined = Linearisation.joined(parts)
    torch.testing.assert_close(joined.levels, whole.levels, atol=0, rtol=0)
    torch.testing.assert_close(joined.jacobian, whole.jacobian, atol=0, rtol=0)
    drawn = [forward_model.design(seen.take(slice(i, i + 1)), at.take(slice(i, i + 1)), ball) for i in range(3)]
    together = Design.joined(drawn).levels(ball.coefficients)
    torch.testing.assert_close(together, forward_model.design(seen, at, ball).levels(ball.coefficients), atol=0, rtol=0)


def as_coefficients(levels: Callable[[Tensor], Tensor], cells: int) -> Tensor:
    """Coefficients (m,) of the texture ``levels(directions)``, by least squares in many directions."""
    directions = random_directions(6000, seed=3)
    design = dense_design(cube_map.places(directions, cells))
    regular = 1e-9 * torch.eye(design.shape[1], dtype=torch.float64)
    return torch.linalg.solve(design.T @ design + regular, design.T @ levels(directions))


def test_two_rays_hold_what_the_footprint_has_more_than_in_front() -> None:
    """The map of a spherical harmonic, blurred by a pixel, against means over pixels of the sharp harmonic."""
    radius, degree, cells = 12.0, 10, 14
    blur = math.exp(-degree * (degree + 1) / radius**2 / 24)

    def sectoral(directions: Tensor) -> Tensor:
        x, _, z = directions
        return torch.complex(x, z).pow(degree).real

    at = Poses.at(poses(1).centre, torch.eye(3, dtype=torch.float64)[None])
    small = torch.tensor(radius, dtype=torch.float64)
    sharp = TexturedBall(small, small * 0 + 0.3, cells, 50 * as_coefficients(sectoral, cells), uniform_light(small))
    seen = windows(at)
    expected = many_rays(seen, at, sharp, 12)
    found = forward_model.linearise(seen, at, replace(sharp, coefficients=blur * sharp.coefficients)).levels[0]
    one = many_rays(seen, at, replace(sharp, coefficients=blur * sharp.coefficients), 1)
    distance = distances(seen, at)[0]
    oblique = (distance > 0.6 * radius) & (distance < 0.87 * radius)
    two_rays, one_ray = (float((levels - expected)[oblique].square().mean().sqrt()) for levels in (found, one))
    assert two_rays < 0.3 * one_ray, (two_rays, one_ray)


def test_the_model_agrees_with_the_ray_caster_on_a_smooth_texture() -> None:
    """A solid pattern that is linear in space is, on the map, nearly linear in the direction."""
    grid = torch.linspace(-1.1, 1.1, 64)
    z, y, x = torch.meshgrid(grid, grid, grid, indexing="ij")
    pattern = ray_caster.Pattern(120 + 50 * x - 30 * y + 20 * z)
    at = Poses.at(poses(2).centre, poses(2).orientation)
    shape, slope = (SIZE, SIZE), torch.tensor([50.0, -30.0, 20.0], dtype=torch.float64)
    expected = ray_caster.render(pattern, at.centre, RADIUS, at.orientation, 40.0, shape=shape, subsamples=24)
    seen = cut_windows(expected, torch.full(shape, 40.0), at.centre, RADIUS)
    least = torch.tensor(forward_model.MIN_BLUR_PX, dtype=torch.float64)
    coefficients = as_coefficients(lambda directions: 120 + slope @ directions, 8)
    ball = TexturedBall(rough_ball().radius, least, 8, coefficients, uniform_light(least))
    difference = (forward_model.linearise(seen, at, ball).levels - seen.levels)[seen.visibility > 0]
    # The texture spans 110 grey levels, and the steps at the outline reach 140.
    assert float(difference.abs().max()) < 2.0
    assert float(difference.square().mean().sqrt()) < 0.2
