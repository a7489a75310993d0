"""A whole recording on its map, on a GPU that is pretended: each tensor stays on its device, and the poses are right.

`test_on_fake_cuda` also refuses waits for a number of the device, but takes the inner loops alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from pretended_gpu import CPU, CUDA, PretendedGpu
from shots import shot
from torch import Tensor

from torchsphere.geometry import camera as camera_model
from torchsphere.geometry.camera import Camera
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import interpolation
from torchsphere.recording.frame_source import Source
from torchsphere.sphere_map import map_fit, perspective, poses
from torchsphere.sphere_map.poses import MapPoses, MapRequest

RADIUS, WIDTH, N = 15.0, 256, 6

#: A camera forty radii away, with a lens that bends.
CAMERA = Camera(focal_px=600.0, principal_px=(120.0, 120.0), distortion=(-0.1, 0.0, 0.0))


def forget_kept_matrices() -> None:
    """Matrices that are kept from call to call are kept on one device."""
    for module in (map_fit, interpolation):
        for function in vars(module).values():
            if hasattr(function, "cache_clear"):
                function.cache_clear()


@pytest.fixture
def without_derivatives(monkeypatch: pytest.MonkeyPatch) -> None:
    """The outline in perspective by the CPU: tensors lose their mark within torch's own derivatives."""

    def outline_distance(circles: Tensor, angles: Tensor, camera: Camera) -> Tensor:
        assert circles.device == angles.device
        return camera_model.outline_distance(circles.cpu(), angles.cpu(), camera).to(circles.device)

    monkeypatch.setattr(perspective, "outline_distance", outline_distance)


def found_on(device: torch.device, camera: Camera | None, ignore: Tensor | None) -> MapPoses:
    made = shot(3, n=N, radius=RADIUS, rotation_deg=(0.5, 2.0, 0.3))
    source = Source(lambda a, b: made.images[a:b, :, :WIDTH], N, device, torch.float32)
    initial: Any = made.centres.numpy() + 0.1, made.orientations.numpy()
    circle = Circle(*made.circle)
    found = poses.poses_on_map(MapRequest(source, *initial, np.full(N, RADIUS), 0.002, circle, ignore, 0.35, camera))
    assert isinstance(found, MapPoses), found
    return found


def test_a_mix_of_devices_is_refused() -> None:
    """This is what the other test relies on."""
    values = torch.arange(3.0)
    with PretendedGpu():
        there = values.to("cuda")
        assert there.device == CUDA
        assert there.is_cuda
        assert (2 * there[1:]).device == CUDA
        assert torch.zeros_like(there).device == CUDA
        assert there.cpu().device == CPU
        assert values.device == CPU
        number = values.sum()
        assert (there + number).device == CUDA
        for refused in (
            lambda: there + values,
            lambda: values * there.sum(),
            lambda: torch.cat((there, values)),
            lambda: values[there.long()],
            there.numpy,
        ):
            with pytest.raises(RuntimeError):
                refused()


@pytest.mark.usefixtures("without_derivatives")
@pytest.mark.parametrize(
    ("camera", "ignored"), [(None, False), (CAMERA, True)], ids=["unknown distance", "camera and ignored pixels"]
)
def test_all_frames_come_to_their_map_on_a_gpu(camera: Camera | None, ignored: bool) -> None:
    ignore = None
    if ignored:
        ignore = torch.zeros(256, WIDTH, dtype=torch.bool)
        ignore[118:122] = True
    on_cpu = found_on(CPU, camera, ignore)
    forget_kept_matrices()
    try:
        with PretendedGpu():
            on_gpu = found_on(CUDA, camera, ignore)
    finally:
        forget_kept_matrices()
    np.testing.assert_allclose(on_gpu.position, on_cpu.position, atol=1e-3)
    np.testing.assert_allclose(RADIUS * on_gpu.orientation, RADIUS * on_cpu.orientation, atol=1e-3)
    variances = (np.diagonal(found.step_covariance, axis1=1, axis2=2) for found in (on_gpu, on_cpu))
    np.testing.assert_allclose(*variances, rtol=0.02)
