"""A ray caster for the shots of the demo, the plans and the tests: pose and pattern of a ball -> image.

The view is orthographic, or that of a camera; the rotation is exact, and the image differentiable with respect to the
pose.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F  # noqa: N812  (torch's convention)
from torch import Tensor

from torchsphere.geometry.camera import Camera, outline_distance, undistorted
from torchsphere.imaging.interpolation import blur
from torchsphere.kernels import jit
from torchsphere.kernels import ray_caster as loops

#: Half width of the pattern's cube in radii, which keeps the ball's surface off the border.
CUBE_HALF_WIDTH = 1.1

#: Rays of a pixel at the limb, two Fibonacci numbers: the share of the ball in it errs by 0.004. With 3 x 3 rays it
#: would by 0.05, and alike in all frames of a ball that moves by whole pixels.
LIMB_RAYS, LIMB_STEP = 233, 144


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
    return Pattern((low + (high - low) * 0.5 * (1 + torch.erf(1.2 * field))).contiguous())


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
    for images of a ``shape`` (h, w). A pixel is the mean of ``subsamples`` x ``subsamples`` rays, at the limb
    of `LIMB_RAYS`. With a ``camera`` the centres are projected ones and the radius, px, is that at their depth.
    """
    if isinstance(background, Tensor):
        still = background.to(centres)
    elif shape is not None:
        still = torch.full(shape, float(background), dtype=centres.dtype, device=centres.device)
    else:
        raise ValueError("render: the background is a number; give the shape (h, w) of the images as well")
    volume = pattern.volume.to(centres).contiguous()
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

    def meet(points: Tensor) -> tuple[Tensor, Tensor]:
        if camera is None:
            return _parallel_rays(points - centre, radius)
        return _rays_of_camera(points, centre, radius, camera)

    def mean(pixels: Tensor, offsets: Tensor) -> Tensor:
        """Mean grey levels (m,) of the rays at the ``offsets`` (k, 2) from the ``pixels`` (m, 2)."""
        if camera is None:
            return _mean_of_parallel_rays(volume, pixels, offsets, centre, orientation, still, radius)
        return _mean_level(volume, pixels, meet(pixels[:, None].to(centre) + offsets), orientation, still)

    device = centre.device
    pixels = torch.cartesian_prod(torch.arange(y0, y1, device=device), torch.arange(x0, x1, device=device)).flip(1)
    drawn = mean(pixels, _square(subsamples).to(centre))
    at_corners = meet(pixels[:, None].to(centre) + _CORNERS.to(centre))[0]
    at_limb = at_corners.any(1) & ~at_corners.all(1)
    drawn = drawn.masked_scatter(at_limb, mean(pixels[at_limb], _lattice().to(centre)))
    return still.index_put((pixels[:, 1], pixels[:, 0]), drawn)


@jit.in_loops(functools.partial(loops.mean_levels, half_width=CUBE_HALF_WIDTH))
def _mean_of_parallel_rays(
    volume: Tensor,
    pixels: Tensor,
    offsets: Tensor,
    centre: Tensor,
    orientation: Tensor,
    still: Tensor,
    radius: float,
) -> Tensor:
    """`_mean_level` of the parallel rays at the ``offsets`` (k, 2) from each pixel."""
    met = _parallel_rays(pixels[:, None].to(centre) + offsets - centre, radius)
    return _mean_level(volume, pixels, met, orientation, still)


def _mean_level(
    volume: Tensor, pixels: Tensor, met: tuple[Tensor, Tensor], orientation: Tensor, still: Tensor
) -> Tensor:
    """Mean grey levels (m,) of the rays of ``pixels`` (m, 2), which do or do not meet the ball, and where."""
    hit, surface = met
    # A row vector times A is A^T times the column: from the camera's axes to the body's.
    body = (surface @ orientation) / CUBE_HALF_WIDTH
    grey = F.grid_sample(volume[None, None], body[None, None], align_corners=True)[0, 0, 0]
    return torch.where(hit, grey, still[pixels[:, 1], pixels[:, 0], None]).mean(1)


#: Offsets of a pixel's corners from its centre, px.
_CORNERS = torch.tensor([[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]])


def _square(side: int) -> Tensor:
    """Offsets (side^2, 2) of evenly spaced rays from a pixel's centre, px."""
    steps = (torch.arange(side, dtype=torch.float64) + 0.5) / side - 0.5
    return torch.cartesian_prod(steps, steps)


def _lattice() -> Tensor:
    """Offsets (`LIMB_RAYS`, 2) of a Fibonacci lattice: an edge along the rows passes its rays one at a time."""
    k = torch.arange(LIMB_RAYS, dtype=torch.float64)
    return (torch.stack((k, k * LIMB_STEP % LIMB_RAYS), 1) + 0.5) / LIMB_RAYS - 0.5


def _parallel_rays(points: Tensor, radius: float) -> tuple[Tensor, Tensor]:
    """Which rays at ``points`` (..., 2) from the centre, px, hit the ball (...), and where (..., 3), radii."""
    squared = points.square().sum(-1)
    height = (radius**2 - squared).clamp_min(1e-6).sqrt()
    return squared < radius**2, torch.cat((points, -height[..., None]), -1) / radius


def _rays_of_camera(points: Tensor, centre: Tensor, radius: float, camera: Camera) -> tuple[Tensor, Tensor]:
    """As `_parallel_rays`, at ``points`` (..., 2) in the image of a ``camera``."""
    assert camera.focal_px is not None
    principal, distortion = (torch.tensor(v).to(points) for v in (camera.principal_px, camera.distortion))
    offset = undistorted((points - principal) / camera.focal_px, distortion)
    towards = undistorted((centre - principal) / camera.focal_px, distortion)
    rays = torch.cat((offset, torch.ones_like(offset[..., :1])), -1)
    ball = torch.cat((towards, torch.ones_like(towards[:1]))).expand_as(rays)
    # The cross product of the offset alone is as exact for a far camera as for a near one.
    beside = torch.cat((offset - towards, torch.zeros_like(offset[..., :1])), -1)
    across = camera.focal_px / radius * torch.linalg.cross(beside, ball)
    square = rays.square().sum(-1)
    root = square - across.square().sum(-1)
    nearest = torch.linalg.cross(rays, across)
    return root > 0, (nearest - root.clamp_min(1e-12).sqrt()[..., None] * rays) / square[..., None]


def _reach(centre: Tensor, radius: float, camera: Camera) -> float:
    """Largest distance of the outline from the projected centre, px."""
    circle = torch.tensor([[*centre.detach().tolist(), radius]], dtype=torch.float64)
    angles = torch.arange(16, dtype=torch.float64) * (math.pi / 8)
    return float(outline_distance(circle, angles, camera).max())
