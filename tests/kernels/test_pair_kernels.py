"""The compiled loops against torch's operations: float32 takes the loops, float64 torch."""

import dataclasses
import math
import os
import subprocess
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numba
import numpy as np
import pytest
import torch
from shots import noisy, pair
from torch import Tensor

from torchsphere import correlate
from torchsphere.correlation import illumination, occlusion, reference_lookup, residual_noise, warp, znssd
from torchsphere.correlation.gauss_newton import Solution, SolverSettings, gauss_newton
from torchsphere.correlation.reference import Filtered, Pairs, Reference, build_reference
from torchsphere.geometry import motion_models, rotation
from torchsphere.imaging import interlacing, interpolation
from torchsphere.imaging.crop import Crops, cut, half_size
from torchsphere.kernels import jit
from torchsphere.kernels.operator import solve as solved

MOTION = (0.6, -0.4, 0.3, -0.5, 0.7)
CLOSED = [motion_models.rigid, motion_models.finite]


@lru_cache(maxsize=1)
def patterns() -> list[tuple[Tensor, Tensor, tuple[float, float, float]]]:
    return [pair(MOTION, seed=seed) for seed in (0, 1)]


@lru_cache(maxsize=4)
def pairs(dtype: torch.dtype, noise: float = 2.0) -> Pairs:
    """Two patterns of the example ball, off the pixels' middles."""
    made = patterns()
    circles = torch.tensor([circle for _, _, circle in made], dtype=torch.float64)
    half = half_size(float(circles[0, 2]), 8.0)

    def filtered(images: list[Tensor], seed: int) -> Filtered:
        stack = noisy(torch.stack(images), noise, seed).to(dtype)
        return Filtered.of(cut(stack, circles[:, :2], half), 1.0)

    return Pairs(filtered([f for f, _, _ in made], 1), filtered([g for _, g, _ in made], 2), circles)


def reference_of(dtype: torch.dtype, **options: float) -> Reference:
    some = pairs(dtype)
    return build_reference(some.f, some.circles, 0.95, 1.0, **options)  # type: ignore[arg-type]


def unknowns(dtype: torch.dtype, off: float = 0.0) -> Tensor:
    q = torch.tensor([*MOTION[:2], *np.deg2rad(MOTION[2:])], dtype=torch.float64) + off
    return q.to(dtype).expand(2, 5).contiguous()


def assert_loops_agree(function: Callable[[torch.dtype], Tensor], tolerance: float) -> None:
    """The float32 result, from compiled loops, equals the float64 result, from torch's operations.

    To within ``tolerance`` of the largest value.
    """
    patterns()  # drawn in double precision
    with pytest.MonkeyPatch.context() as patch:
        taken: list[bool] = []
        suits = jit.suits

        def recorded(*tensors: Tensor, dtype: torch.dtype = torch.float32) -> bool:
            suitable = suits(*tensors, dtype=dtype)
            # Cholesky factors are float64 in both.
            taken.extend([suitable] if dtype == torch.float32 else [])
            return suitable

        patch.setattr(jit, "suits", recorded)
        single = function(torch.float32)
        assert taken
        assert all(taken)
        taken.clear()
        double = function(torch.float64)
        assert taken
        assert not any(taken)
    largest = float(double.double().abs().max())
    assert largest > 0
    torch.testing.assert_close(single.double(), double.double(), atol=tolerance * largest, rtol=0)


def test_loops_take_float32_on_the_cpu_without_derivatives() -> None:
    single = torch.zeros(3)
    assert jit.suits(single)
    assert not jit.suits(single, single.double())
    assert not jit.suits(single.clone().requires_grad_())
    assert not jit.suits(torch.zeros(3, device="meta"))


@pytest.mark.parametrize("pre_blur", [0.0, 0.6, 1.0])
@pytest.mark.parametrize("shape", [(3, 40, 31), (1, 7, 9), (2, 1, 5), (1, 2, 2)])
def test_coefficients(shape: tuple[int, ...], pre_blur: float) -> None:
    images = torch.rand(shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    assert_loops_agree(lambda dtype: interpolation.coefficients(images.to(dtype), pre_blur), 2e-6)


def test_coefficients_of_images_that_are_not_contiguous() -> None:
    images = torch.rand(2, 60, 50, generator=torch.Generator().manual_seed(1))
    part = images[:, 10:40, 5:45]
    assert torch.equal(interpolation.coefficients(part), interpolation.coefficients(part.clone()))
    assert torch.equal(interpolation.coefficients(part.mT), interpolation.coefficients(part.mT.clone()))


def test_samples_and_their_gradient_up_to_the_last_cell() -> None:
    c = torch.rand(2, 30, 40, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    places = torch.rand(2, 500, 2, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    places = 1 + places * torch.tensor([37.0, 27.0])
    places[:, 0], places[:, 1] = torch.tensor([1.0, 1.0]), torch.tensor([38.0, 28.0])
    places = places.float().double()  # the same places in both precisions
    assert_loops_agree(lambda dtype: interpolation.sample(c.to(dtype), places.to(dtype)), 1e-6)
    assert_loops_agree(lambda dtype: interpolation.sample_with_gradient(c.to(dtype), places.to(dtype))[0], 1e-6)
    assert_loops_agree(lambda dtype: interpolation.sample_with_gradient(c.to(dtype), places.to(dtype))[1], 2e-6)


def test_a_place_that_is_nan_or_far_outside_stays_within_the_array() -> None:
    c = torch.ones(1, 8, 8)
    places = torch.tensor([[[torch.nan, 3.0], [3.0, torch.inf], [-1e30, 1e30], [-torch.inf, torch.nan]]])
    assert interpolation.sample(c, places).tolist() == [[1.0] * 4]


@pytest.mark.parametrize("every", [1, 4])
@pytest.mark.parametrize("name", ["surface", "weights", "values", "gradient", "blurred_gradient", "noise"])
def test_the_reference(name: str, every: int) -> None:
    if name == "noise" and every > 1:
        assert float(reference_of(torch.float32, every=4).noise.abs().max()) == 0  # not asked for there
        return
    assert_loops_agree(lambda dtype: getattr(reference_of(dtype, every=every), name), 5e-6)


def test_pixels_at_the_border_of_a_crop() -> None:
    images = torch.rand(1, 9, 11, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    grid = torch.tensor([[x, y] for x in range(-4, 5) for y in range(-3, 4)])
    middle = torch.tensor([[5, 4]])
    assert_loops_agree(lambda dtype: reference_lookup.levels(images.to(dtype), grid, middle)[0], 1e-6)
    assert_loops_agree(lambda dtype: reference_lookup.levels(images.to(dtype), grid, middle)[1], 2e-6)


@pytest.mark.parametrize("model", CLOSED)
def test_the_deformed_image_at_the_displaced_points(model: motion_models.Displacement) -> None:
    def look(dtype: torch.dtype) -> tuple[Tensor, Tensor, Tensor]:
        some = pairs(dtype)
        return warp.warp_with_gradient(reference_of(dtype), some.g.c, some.shift, unknowns(dtype), model)

    for part, tolerance in ((0, 1e-5), (1, 1e-7), (2, 2e-5)):
        assert_loops_agree(lambda dtype, part=part: look(dtype)[part], tolerance)  # type: ignore[misc]


def test_points_that_turn_to_the_back_or_leave_the_crop_are_not_counted() -> None:
    def weights(q: list[float], dtype: torch.dtype = torch.float32) -> Tensor:
        some = pairs(dtype)
        q_of_both = torch.tensor(q, dtype=dtype).expand(2, 5).contiguous()
        return warp.warp(reference_of(dtype), some.g.c, some.shift, q_of_both, motion_models.finite)[1]

    counted = float(weights([0, 0, 0, 0, 0]).sum())
    for q in ([0, 0, 0, 1.0, 0], [30.0, 0, 0, 0, 0], [0, -30.0, 0, 0, 0]):
        assert 0.2 * counted < float(weights(q).sum()) < 0.9 * counted
        assert float(weights(q).sum()) == pytest.approx(float(weights(q, torch.float64).sum()), rel=2e-3)
    for at in range(5):
        q = [0.0] * 5
        q[at] = math.nan
        assert float(weights(q).sum()) == 0


@pytest.mark.parametrize("model", CLOSED)
def test_slopes_projected_off_the_nuisances(model: motion_models.Displacement) -> None:
    def slopes(dtype: torch.dtype) -> tuple[Tensor, Tensor]:
        made = reference_of(dtype)
        return warp.projected_slopes(made, made.gradient, unknowns(dtype), model, made.weights)

    assert_loops_agree(lambda dtype: slopes(dtype)[0], 5e-6)
    assert_loops_agree(lambda dtype: slopes(dtype)[1], 5e-6)
    assert_loops_agree(lambda dtype: znssd.operator(slopes(dtype)[0], reference_of(dtype).weights), 5e-6)


def test_small_systems_of_equations() -> None:
    generator = np.random.default_rng(1)
    root, right = generator.normal(size=(5, 5)), generator.normal(size=(5, 3))
    matrix = root @ root.T
    found = right.copy()
    solved(matrix.copy(), found)
    np.testing.assert_allclose(matrix @ found, right, atol=1e-8)
    for wrong in (-matrix, np.full((5, 5), np.nan)):
        untouched = right.copy()
        solved(wrong.copy(), untouched)
        np.testing.assert_array_equal(untouched, right)


def descended(dtype: torch.dtype, model: motion_models.Displacement, steps: int = 40) -> Solution:
    some = pairs(dtype)
    return gauss_newton(
        reference_of(dtype), some.g.c, some.shift, unknowns(dtype, off=0.002), model, SolverSettings(steps, 2e-4, False)
    )


@pytest.mark.parametrize("model", CLOSED)
def test_gauss_newton_takes_the_same_steps_to_the_same_place(model: motion_models.Displacement) -> None:
    assert_loops_agree(lambda dtype: descended(dtype, model).q, 3e-5)  # 2e-5 px, as below
    single, double = descended(torch.float32, model), descended(torch.float64, model)
    assert bool(single.converged.all())
    assert single.iterations.tolist() == double.iterations.tolist()
    size = torch.tensor([1, 1, 50, 50, 50])
    assert float(((single.q - double.q) * size).abs().max()) < 2e-5  # px
    for name in ("warped", "weights", "jacobian", "factor"):
        one, other = getattr(single, name).double(), getattr(double, name).double()
        torch.testing.assert_close(one, other, atol=2e-5 * float(other.abs().max()), rtol=0)


def test_gauss_newton_ends_after_the_most_steps_and_at_a_step_that_is_nan() -> None:
    one = descended(torch.float32, motion_models.finite, steps=1)
    assert one.converged.tolist() == [False, False]
    assert one.iterations.tolist() == [1, 1]
    some, made = pairs(torch.float32), reference_of(torch.float32)
    c = some.g.c.clone()
    c[1] = torch.nan
    start = unknowns(torch.float32)
    found = gauss_newton(made, c, some.shift, start, motion_models.finite, SolverSettings(40, 2e-4, False))
    assert found.converged.tolist() == [True, False]
    assert found.iterations.tolist()[1] == 1
    assert torch.equal(found.q[1], start[1])


def test_agreement_of_both_images() -> None:
    made, some = reference_of(torch.float64), pairs(torch.float64)
    warped, weights = warp.warp(made, some.g.c, some.shift, unknowns(torch.float64), motion_models.finite)

    def images(dtype: torch.dtype) -> tuple[Tensor, Tensor, Tensor]:
        return made.values.to(dtype), warped.to(dtype), weights.to(dtype)

    assert_loops_agree(lambda dtype: znssd.residual(*images(dtype)), 5e-5)  # of images that are 40 times as large
    assert_loops_agree(lambda dtype: znssd.zncc(*images(dtype)), 1e-6)
    flat = torch.ones(1, 50)
    assert znssd.zncc(flat, torch.rand(1, 50), flat).tolist() == [0.0]
    assert bool(znssd.zncc(flat * torch.nan, flat, flat).eq(0).all())


def test_sums_over_windows_and_blocks_and_power_of_the_residual() -> None:
    noise = torch.rand(2, 5, 20_000, generator=torch.Generator().manual_seed(4), dtype=torch.float64)

    def given(dtype: torch.dtype) -> tuple[Reference, Tensor, Tensor]:
        made = reference_of(dtype)
        return made, noise[..., : made.values.shape[-1]].to(dtype), made.weights

    def block_sums(dtype: torch.dtype, fading: bool) -> Tensor:
        made, values, weights = given(dtype)
        return residual_noise.block_sums(made, values, weights, fading=fading)

    assert_loops_agree(lambda dtype: block_sums(dtype, fading=True), 5e-6)
    assert_loops_agree(lambda dtype: block_sums(dtype, fading=False), 5e-6)
    assert_loops_agree(
        lambda dtype: residual_noise.local_mean(given(dtype)[0], given(dtype)[1][:, 0], given(dtype)[2]), 1e-6
    )

    def power(dtype: torch.dtype) -> residual_noise.ResidualPower:
        made, values, weights = given(dtype)
        return residual_noise.ResidualPower.of(made, values[:, 0] - 0.5, weights)

    for name in residual_noise.ResidualPower._fields:
        assert_loops_agree(lambda dtype, name=name: getattr(power(dtype), name), 5e-6)  # type: ignore[misc]


@pytest.mark.parametrize("every", [1, 8])
@pytest.mark.parametrize("model", CLOSED)
def test_products_of_the_modes(model: motion_models.Displacement, every: int) -> None:
    def gram(dtype: torch.dtype) -> Tensor:
        made, exact = reference_of(dtype), model is motion_models.finite
        return rotation.gram(unknowns(dtype), made.surface, made.weights, exact=exact, every=every)

    assert_loops_agree(gram, 2e-6)


def test_shift_between_the_fields() -> None:
    images = pairs(torch.float64).f.crops.images.clone()
    images[1, 1::2] = images[1, 1::2].roll(1, -1)
    assert_loops_agree(lambda dtype: interlacing.row_products(images.to(dtype)), 1e-6)
    still, shifted = interlacing.field_shift(images.float())
    assert still.tolist() == [0.0, 0.0]
    assert float(shifted[0]) > 0.3


def test_judgements_of_a_pair() -> None:
    def doubts(dtype: torch.dtype, judge: Callable[[Reference, Solution], Tensor]) -> list[bool]:
        made, found = reference_of(dtype), descended(dtype, motion_models.finite)
        warped = found.warped.clone()
        warped[1, 800:1100] = 250.0  # an occluder on one of both
        judged: list[bool] = judge(made, found._replace(warped=warped)).tolist()
        return judged

    for judge in (
        lambda made, found: occlusion.is_occluded(made, found, motion_models.finite),
        lambda made, found: illumination.light_is_uneven(made, found, motion_models.finite),
    ):
        assert doubts(torch.float32, judge) == doubts(torch.float64, judge)
    assert doubts(torch.float32, lambda made, found: occlusion.is_occluded(made, found, motion_models.finite)) == [
        False,
        True,
    ]


@pytest.mark.parametrize("model", CLOSED)
def test_weights_of_a_view_that_changes(model: motion_models.Displacement) -> None:
    fast = torch.tensor([[0, 0, 0.1, -0.2, 0.05], [0, 0, 0, 0, 0]], dtype=torch.float64)
    assert_loops_agree(lambda dtype: occlusion.weight_by_view(reference_of(dtype), fast.to(dtype), model).weights, 1e-6)


@pytest.mark.parametrize("size", [1e-9, 9e-3, 1.1e-2, 0.3, 3.0])
def test_rotations_and_their_tangents(size: float) -> None:
    vectors = size * torch.randn(20, 3, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    vectors = vectors.float().double()
    assert_loops_agree(lambda dtype: rotation.rotations(vectors.to(dtype)), 1e-6)
    assert_loops_agree(lambda dtype: rotation.tangents(vectors.to(dtype)), 1e-6)


@pytest.mark.parametrize("turn", [0.0, 0.5, 3.0])
def test_increments_and_their_uncertainty(turn: float) -> None:
    f, g, circle = pair((0.4, 0.3, 0.5 * turn, turn, -0.3 * turn))
    f, g = noisy(f, 2.0, 1), noisy(g, 2.0, 2)
    single, double = correlate(f.float(), g.float(), circle), correlate(f.double(), g.double(), circle)
    assert single.status.tolist() == double.status.tolist() == ["ok"]
    size = torch.tensor([1, 1, 50, 50, 50])
    assert float(((single.q - double.q) * size).abs().max()) < 1e-4  # px
    torch.testing.assert_close(single.covariance, double.covariance, rtol=2e-3, atol=0)
    torch.testing.assert_close(single.zncc.double(), double.zncc, rtol=0, atol=1e-5)


def test_ignored_parts_of_an_image_have_no_weight() -> None:
    some = pairs(torch.float32)
    usable = torch.ones_like(some.f.crops.images, dtype=torch.bool)
    usable[:, :60] = False
    crops = Crops(some.f.crops.images, usable, some.f.crops.origin)
    made = build_reference(some.f._replace(crops=crops), some.circles, 0.95, 1.0)
    whole = reference_of(torch.float32)
    above = made.points[..., 1] < -3
    assert float(made.weights[above].sum()) == 0
    below = made.points[..., 1] > 3
    assert torch.equal(made.weights[below], whole.weights[below])


def test_without_a_writable_cache_each_process_compiles_for_itself() -> None:
    homeless: dict[str, Callable[..., np.float32]] = {}
    exec("def first(values):\n    return values[0]", homeless)
    with pytest.raises(RuntimeError, match="cannot cache"):
        numba.njit(cache=True)(homeless["first"])
    assert jit.compiled(homeless["first"])(np.ones(3, np.float32)) == 1


#: Grey levels of an image at its pixels, as bytes: functions that call others, in loops with reordered sums.
LOOKED_UP = """
import sys, torch
from torchsphere.correlation import reference_lookup
c = torch.rand(2, 40, 50, generator=torch.Generator().manual_seed(1))
grid = torch.tensor([[x, y] for y in range(-12, 13) for x in range(-12, 13)])
for found in reference_lookup.levels(c, grid, torch.full((2, 2), 20)):
    sys.stdout.buffer.write(found.numpy().tobytes())
"""


def test_the_compiling_process_and_later_ones_give_the_same_values(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", LOOKED_UP]
    first, second = (subprocess.run(command, env=environment, capture_output=True, check=True) for _ in range(2))
    assert list(tmp_path.rglob("*.nbc"))
    assert len(first.stdout) == 3 * 2 * 625 * 4
    assert first.stdout == second.stdout


def test_a_thinned_reference_gives_the_same_slopes_at_its_points() -> None:
    made = reference_of(torch.float32)
    few = made.thinned()
    assert few.values.shape[-1] == math.ceil(made.values.shape[-1] / 4)
    one, _ = warp.projected_slopes(few, few.gradient, unknowns(torch.float32), motion_models.finite, few.weights)
    kept = dataclasses.replace(few, **{n: getattr(few, n).contiguous() for n in ("surface", "values", "weights")})
    gradient = few.gradient.contiguous()
    other, _ = warp.projected_slopes(kept, gradient, unknowns(torch.float32), motion_models.finite, kept.weights)
    assert torch.equal(one, other)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: interpolation.sample(torch.zeros(2, 8, 8), torch.zeros(3, 5, 2)),
        lambda: interpolation.sample(torch.zeros(2, 3, 8), torch.zeros(2, 5, 2)),
        lambda: znssd.residual(torch.zeros(2, 9), torch.zeros(2, 9), torch.zeros(1, 9)),
        lambda: znssd.zncc(torch.zeros(2, 9), torch.zeros(2, 8), torch.zeros(2, 9)),
        lambda: znssd.operator(torch.zeros(2, 5, 9), torch.zeros(2, 8)),
        lambda: reference_lookup.levels(
            torch.zeros(2, 2, 9), torch.zeros(4, 2, dtype=torch.long), torch.zeros(2, 2).long()
        ),
    ],
)
def test_arrays_of_unequal_sizes_are_refused(wrong: Callable[[], object]) -> None:
    with pytest.raises(ValueError, match="got shape"):
        wrong()
