"""The inner loops on a GPU: on tensors without values where there is none, against the CPU where there is one.

Torch's FakeTensorMode makes tensors on "cuda" without a device. It computes their shapes, types and devices, and
refuses mixed devices, `.numpy()`, and every wait for a number from the device.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

import pytest
import torch
from ball_models import RADIUS, one_share, poses, random, rough_ball, windows
from torch import Tensor
from torch._subclasses.fake_tensor import FakeTensor, FakeTensorMode
from torch.overrides import TorchFunctionMode

from torchsphere.correlation import plain, plain_engine, plain_reference
from torchsphere.correlation.options import Options
from torchsphere.geometry import motion_models
from torchsphere.geometry.motion_models import Geometry
from torchsphere.imaging import interpolation
from torchsphere.sphere_map import cube_map, elimination, forward_model, map_fit, pixel_weights, registration
from torchsphere.sphere_map.ball import Poses, TexturedBall
from torchsphere.sphere_map.map_fit import MapEquations
from torchsphere.sphere_map.window import Windows

N, CELLS = 3, 8


def moved(thing: Any, device: str) -> Any:
    """The tensor, or the dataclass with all its tensors, on the ``device``."""
    if isinstance(thing, Tensor):
        return thing.to(device)
    if is_dataclass(thing):
        return type(thing)(*(moved(getattr(thing, field.name), device) for field in fields(thing)))
    return thing


def given() -> tuple[Windows, Poses, TexturedBall]:
    """Windows, poses and ball in single precision, as a recording has them."""
    return windows(poses(N), torch.float32), poses(N), rough_ball(CELLS, torch.float32)


def all_tensors(thing: Any) -> list[Tensor]:
    if isinstance(thing, Tensor):
        return [thing]
    if is_dataclass(thing):
        return [t for field in fields(thing) for t in all_tensors(getattr(thing, field.name))]
    return [t for part in thing for t in all_tensors(part)] if isinstance(thing, tuple | list) else []


class WithoutGuard(TorchFunctionMode):
    """Square brackets and "~" as the operators that they stand for.

    A torch without CUDA refuses them on tensors of a GPU, even without values: it would switch to that GPU first.
    """

    def __torch_function__(  # type: ignore[no-untyped-def]
        self, function, types, args=(), kwargs=None
    ) -> Any:
        if function is Tensor.__getitem__:
            return indexed(*args)
        if function is Tensor.__setitem__:
            tensor, key, value = args
            put = torch.ops.aten.copy_.default if isinstance(value, Tensor) else torch.ops.aten.fill_.Scalar
            return put(indexed(tensor, key), value)
        if function is Tensor.__invert__:
            return torch.bitwise_not(*args)
        return function(*args, **(kwargs or {}))


def indexed(tensor: Tensor, key: Any) -> Tensor:
    """``tensor[key]`` by torch's operators."""
    keys = key if isinstance(key, tuple) else (key,)
    axes = sum(part is not None and part is not Ellipsis for part in keys)
    spread: list[Any] = []
    for part in keys:
        spread += (tensor.ndim - axes) * [slice(None)] if part is Ellipsis else [part]
    axis, chosen = 0, []
    for part in spread:
        if part is None:
            tensor = tensor.unsqueeze(axis)
        elif isinstance(part, int):
            tensor = tensor.select(axis, part)
            continue
        elif isinstance(part, slice):
            stop = 2**63 - 1 if part.stop is None else part.stop
            tensor = torch.ops.aten.slice.Tensor(tensor, axis, part.start or 0, stop, part.step or 1)
        else:
            numbers = part if isinstance(part, Tensor) else torch.tensor(part, device=tensor.device)
            chosen += (axis - len(chosen)) * [None] + [numbers]
        axis += 1
    return torch.ops.aten.index.Tensor(tensor, chosen) if chosen else tensor


class _Fake:
    """Windows, poses and ball on a GPU that need not be there."""

    def __init__(self, mode: OnFakeCuda) -> None:
        on_cpu = given()
        with mode:
            self.windows, self.poses, self.ball = (self._like(part) for part in on_cpu)

    def _like(self, thing: Any) -> Any:
        if isinstance(thing, Tensor):
            return torch.empty(thing.shape, dtype=thing.dtype, device="cuda")
        if is_dataclass(thing):
            return type(thing)(*(self._like(getattr(thing, field.name)) for field in fields(thing)))
        return thing


class OnFakeCuda:
    """A context in which tensors may be on a GPU that need not be there."""

    def __init__(self) -> None:
        self._modes = FakeTensorMode(allow_non_fake_inputs=False), WithoutGuard()

    def __enter__(self) -> None:
        for mode in self._modes:
            mode.__enter__()

    def __exit__(self, *error: object) -> None:
        for mode in reversed(self._modes):
            mode.__exit__(*error)


def forget_kept_matrices() -> None:
    """Matrices that were made on the CPU are no fake tensors, and fake ones must not be kept for other tests."""
    for module in (cube_map, map_fit, interpolation):
        for function in vars(module).values():
            if hasattr(function, "cache_clear"):
                function.cache_clear()


@pytest.fixture
def mode() -> Iterator[OnFakeCuda]:
    forget_kept_matrices()
    yield OnFakeCuda()
    forget_kept_matrices()


@pytest.fixture
def fake(mode: OnFakeCuda) -> _Fake:
    return _Fake(mode)


def assert_on_gpu(result: Any) -> None:
    """All tensors are fake and on the GPU."""
    tensors = all_tensors(result)
    assert tensors
    assert all(isinstance(tensor, FakeTensor) and tensor.device.type == "cuda" for tensor in tensors)


def equations(fake: _Fake) -> MapEquations:
    design = forward_model.design(fake.windows, fake.poses, fake.ball)
    return MapEquations.of(design, fake.windows.visibility, one_share)


def test_a_wait_for_a_number_of_the_device_is_refused(mode: OnFakeCuda) -> None:
    """This is what the other tests rely on."""
    with mode:
        values = torch.ones(3, device="cuda")
        for wait in (float, bool, Tensor.tolist, Tensor.numpy):
            with pytest.raises((RuntimeError, TypeError)):
                wait(values.sum())
        with pytest.raises(RuntimeError):
            values + torch.ones(3)


def test_the_forward_model_runs_on_a_gpu(mode: OnFakeCuda, fake: _Fake) -> None:
    with mode:
        model = forward_model.linearise(fake.windows, fake.poses, fake.ball)
        design = forward_model.design(fake.windows, fake.poses, fake.ball)
        assert_on_gpu(model)
        assert_on_gpu(design.levels(fake.ball.coefficients))
        assert_on_gpu(design.adjoint(fake.windows.visibility))
        assert_on_gpu(design.coupling(model.jacobian, elimination.PER_IMAGE))
        assert_on_gpu(model.normal(fake.windows.visibility, fake.windows.levels))


def test_the_fit_of_the_map_runs_on_a_gpu(mode: OnFakeCuda, fake: _Fake) -> None:
    with mode:
        of = equations(fake)
        right = of.gradient(fake.ball.coefficients, fake.windows.levels)
        assert_on_gpu(of.solve(right, 2))
        assert_on_gpu(of.leverage())
        assert_on_gpu(map_fit.refined(fake.ball.coefficients, CELLS, 2 * CELLS))


def test_the_joint_equations_run_on_a_gpu(mode: OnFakeCuda, fake: _Fake) -> None:
    with mode:
        model, of = forward_model.linearise(fake.windows, fake.poses, fake.ball), equations(fake)
        joint = elimination.joint_equations(model, of, fake.poses)
        _, parts = model.normal(fake.windows.visibility, fake.windows.levels)
        right = of.gradient(fake.ball.coefficients, fake.windows.levels)
        assert_on_gpu(joint.solve(right, elimination.spread_gradient(parts), 2))
        assert_on_gpu(joint.covariance)


def test_the_weights_of_the_pixels_run_on_a_gpu(mode: OnFakeCuda, fake: _Fake) -> None:
    with mode:
        seen, at = fake.windows, fake.poses
        sums = pixel_weights.ring_sums(seen, at, seen.levels, fake.ball.radius, seen.visibility)
        profile = pixel_weights.profile_of(sums, fake.ball.radius)
        assert_on_gpu(profile.weights(seen, at))
        assert_on_gpu(pixel_weights.estimate_visibility(seen, profile.at(seen, at), seen.levels))


def test_a_step_of_the_registration_runs_on_a_gpu(mode: OnFakeCuda, fake: _Fake) -> None:
    with mode:
        profile = pixel_weights.uniform_profile(fake.ball.radius, 4.0)
        assert_on_gpu(registration._step(fake.windows, fake.poses, fake.ball, profile))


def test_a_step_of_the_correlation_of_pairs_runs_on_a_gpu(mode: OnFakeCuda, monkeypatch: pytest.MonkeyPatch) -> None:
    """All but torch's own derivatives, which do not take tensors without values."""
    options = Options(model="finite")
    with mode:
        n, p, side = 2, 40, 50
        like = torch.empty(n, p, device="cuda")
        region = plain_reference.Region(
            points=torch.empty(n, p, 2, device="cuda"),
            weights=like,
            values=like,
            gradient=torch.empty(n, p, 2, device="cuda"),
            blurred_gradient=torch.empty(n, p, 2, device="cuda"),
            normals=torch.empty(n, p, 3, device="cuda"),
            noise=like[:, 0],
            geometry=Geometry(like[:, 0]),
        )
        q = torch.empty(n, 5, device="cuda")
        assert_on_gpu(plain_reference.spline_coefficients(torch.empty(n, side, side, device="cuda"), options.pre_blur))
        modes = torch.empty(n, p, 2, 5, device="cuda")
        monkeypatch.setattr(motion_models, "modes", lambda *_: modes)
        moved = region.points + motion_models.displacement(motion_models.finite, q, region.points, region.geometry)
        weights = region.weights * plain.view_weights(region, moved, q)
        assert_on_gpu(plain.gauss_newton_step(region, region.gradient, like, weights, q, motion_models.finite))
        assert_on_gpu(plain_engine.zncc(region.values, like, weights))


@pytest.mark.skipif(not torch.cuda.is_available(), reason="torch finds no CUDA device")
def test_cpu_and_gpu_register_images_to_the_same_poses() -> None:
    seen, at, ball = given()
    ball = replace(ball, coefficients=ball.coefficients)
    seen = replace(seen, levels=forward_model.linearise(seen, at, ball).levels + 2 * random(*seen.levels.shape).float())
    start = at.moved(torch.tensor([[0.2, -0.1, 0.15, 0.1, -0.2]]).expand(N, -1), RADIUS)
    profile = pixel_weights.uniform_profile(ball.radius, 4.0)
    on_cpu, on_gpu = (
        registration.register(*(moved(part, device) for part in (seen, start, ball, profile)))
        for device in ("cpu", "cuda")
    )
    assert bool(on_cpu.converged.all())
    assert bool(on_gpu.converged.all())
    assert float((on_cpu.poses.centre - on_gpu.poses.centre.cpu()).abs().max()) < 1e-3
    turned = (on_cpu.poses.orientation - on_gpu.poses.orientation.cpu()).abs().max()
    assert float(turned) * RADIUS < 1e-3
    torch.testing.assert_close(on_cpu.covariance, on_gpu.covariance.cpu(), rtol=1e-2, atol=1e-9)
