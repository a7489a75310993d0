"""A ray caster for the shots of the demo, the plans and the tests: pose and pattern of a ball -> image.

The view is orthographic, or that of a camera; the rotation is exact, and the image differentiable with respect to the
pose.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F  # noqa: N812  (torch's convention)
from torch import Tensor

from torchsphere.geometry.camera import Camera, outline_distance, undistorted
from torchsphere.imaging.interpolation import blur

#: Half width of the pattern's cube in radii, which keeps the ball's surface off the border.
CUBE_HALF_WIDTH = 1.1


@dataclass(frozen=True)
class Pattern:
    """Solid pattern on a cube around the ball, in body axes: no seam, no pole."""

    volume: Tensor  # grey levels (d, d, d), indexed [z, y, x], over ``[-1.1, 1.1]^3`` radii


def speckle(
    seed: int, *, radius_px: float = 50.0, speckle_px: float = 4.0, low: float = 30.0, high: float = 220.0
) -> Pattern:
    """Random speckle between the grey levels ``low`` and ``high``; a seed gives one pattern.

    ``speckle_px``: full width at half maximum of the Gaussian that smooths white noise, px in an image of a ball of
    ``radius_px``; the pattern's autocorrelation is wider by about a third.
    """
    cells = int(min(max(4 * radius_px, 64), 192))
    generator = torch.Generator().manual_seed(seed)
    noise = torch.randn(cells, cells, cells, generator=generator)
    sigma = speckle_px / 2.3548 * cells / (2 * CUBE_HALF_WIDTH * radius_px)
    for _ in range(3):
        # Two axes at a time, so that three rounds blur each axis twice.
        noise = blur(noise, sigma / 2**0.5).permute(1, 2, 0)
    field = (noise - noise.mean()) / noise.std()
    return Pattern(low + (high - low) * 0.5 * (1 + torch.erf(1.2 * field)))


def render(
    pattern: Pattern,
    centres: Tensor,
    radius: float,
    orientations: Tensor,
    background: Tensor | float,
    *,
    shape: tuple[int, int] | None = None,
    subsamples: int = 3,
    camera: Camera | None = None,
) -> Tensor:
    """Images (n, h, w) of the ball, grey levels without noise, not rounded, in the precision of ``centres`` (n, 2), px.

    ``orientations`` (n, 3, 3): rotation matrices in the camera frame. ``background``: an image (h, w), or a grey level
    for images of a ``shape`` (h, w). A pixel is the mean of ``subsamples`` x ``subsamples`` rays. With a ``camera`` the
    centres are projected ones and the radius, px, is that at their depth.
    """
    if isinstance(background, Tensor):
        still = background.to(centres)
    elif shape is not None:
        still = torch.full(shape, float(background), dtype=centres.dtype, device=centres.device)
    else:
        raise ValueError("render: the background is a number; give the shape (h, w) of the images as well")
    volume = pattern.volume.to(centres)
    settled = None if camera is None else camera.settled(tuple(still.shape), radius)
    frames = [
        _frame(volume, centre, radius, orientation, still, subsamples, settled)
        for centre, orientation in zip(centres, orientations.to(centres), strict=True)
    ]
    return torch.stack(frames)


def _frame(
    volume: Tensor,
    centre: Tensor,
    radius: float,
    orientation: Tensor,
    still: Tensor,
    subsamples: int,
    camera: Camera | None,
) -> Tensor:
    """One image (h, w) of the ball in front of the ``still`` background."""
    rows, columns = still.shape
    reach = radius if camera is None else _reach(centre, radius, camera)
    left, top = (int(v) for v in (centre.detach() - reach - 2).floor())
    span = int(2 * reach) + 6
    x0, x1 = max(left, 0), min(left + span, columns)
    y0, y1 = max(top, 0), min(top + span, rows)
    if x0 >= x1 or y0 >= y1:
        return still
    offsets = (torch.arange(subsamples, dtype=centre.dtype, device=centre.device) + 0.5) / subsamples - 0.5
    x = (torch.arange(x0, x1, device=centre.device)[:, None] + offsets).flatten()
    y = (torch.arange(y0, y1, device=centre.device)[:, None] + offsets).flatten()
    if camera is None:
        hit, surface = _parallel_rays(x - centre[0], y - centre[1], radius)
    else:
        hit, surface = _rays_of_camera(x, y, centre, radius, camera)
    # A row vector times A is A^T times the column: from the camera's axes to the body's.
    body = (surface @ orientation) / CUBE_HALF_WIDTH
    grey = F.grid_sample(volume[None, None], body[None, None], align_corners=True)[0, 0, 0]
    behind = still[y0:y1, x0:x1].repeat_interleave(subsamples, 0).repeat_interleave(subsamples, 1)
    rays = torch.where(hit, grey, behind)
    pixels = F.avg_pool2d(rays[None, None], subsamples)[0, 0]
    return still.index_put(
        (torch.arange(y0, y1, device=still.device)[:, None], torch.arange(x0, x1, device=still.device)[None]), pixels
    )


def _parallel_rays(x: Tensor, y: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    """Which rays at ``x`` (k,) and ``y`` (m,) from the centre, px, hit the ball (m, k), and where (m, k, 3), radii."""
    squared = (x**2)[None, :] + (y**2)[:, None]
    height = (radius**2 - squared).clamp_min(1e-6).sqrt()
    surface = torch.stack((x.expand(len(y), -1), y[:, None].expand(-1, len(x)), -height), -1)
    return squared < radius**2, surface / radius


def _rays_of_camera(x: Tensor, y: Tensor, centre: Tensor, radius: float, camera: Camera) -> tuple[Tensor, Tensor]:
    """As `_parallel_rays`, at ``x`` and ``y`` in the image of a ``camera``."""
    assert camera.focal_px is not None
    principal, distortion = (torch.tensor(v).to(x) for v in (camera.principal_px, camera.distortion))
    seen = torch.stack((x.expand(len(y), -1), y[:, None].expand(-1, len(x))), -1)
    one = torch.ones_like(seen[..., :1])
    rays = torch.cat((undistorted((seen - principal) / camera.focal_px, distortion), one), -1)
    towards = undistorted((centre - principal) / camera.focal_px, distortion)
    ball = camera.focal_px / radius * torch.cat((towards, torch.ones_like(towards[:1])))
    along, square = rays @ ball, rays.square().sum(-1)
    root = along.square() - square * (ball.square().sum() - 1)
    nearer = (along - root.clamp_min(1e-12).sqrt()) / square
    return root > 0, nearer[..., None] * rays - ball


def _reach(centre: Tensor, radius: float, camera: Camera) -> float:
    """Largest distance of the outline from the projected centre, px."""
    circle = torch.tensor([[*centre.detach().tolist(), radius]], dtype=torch.float64)
    angles = torch.arange(16, dtype=torch.float64) * (math.pi / 8)
    return float(outline_distance(circle, angles, camera).max())
