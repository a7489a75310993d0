"""A small ray caster: pose and pattern of a ball -> image, in torch, differentiable with respect to the pose.

It makes the synthetic shots of the demo, the plans and the tests. The view is orthographic and the rotation exact. Each
pixel is the mean over a grid of sub-pixel rays, so that the outline is as soft as that of a real pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F  # noqa: N812  (torch's convention)
from torch import Tensor

from torchsphere.imaging.interpolation import blur

#: Half width of the pattern's cube in radii: the ball's surface never reaches its border.
CUBE_HALF_WIDTH = 1.1


@dataclass(frozen=True)
class Pattern:
    """Solid pattern: grey levels on a cube around the ball, in body axes, in units of the ball's radius.

    Attributes
    ----------
    volume : Tensor
        Grey levels (d, d, d), indexed [z, y, x], over ``[-1.1, 1.1]^3``.
    """

    volume: Tensor


def speckle(
    seed: int, *, radius_px: float = 50.0, speckle_px: float = 4.0, low: float = 30.0, high: float = 220.0
) -> Pattern:
    """Random speckle with a given full width at half maximum, between two grey levels.

    Parameters
    ----------
    seed : int
        The same seed gives the same pattern.
    radius_px, speckle_px : float
        Radius of the ball in the image, and full width at half maximum of the Gaussian that smooths white noise to
        spots, px; the pattern's autocorrelation is wider by about a third.
    low, high : float
        Grey levels between which the speckle swings.

    Returns
    -------
    Pattern
        A solid pattern: no seam, no pole.
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
) -> Tensor:
    """Images of the ball, one per pose.

    Parameters
    ----------
    pattern : Pattern
        Pattern of the ball.
    centres : Tensor
        Centre in the image (n, 2), px.
    radius : float
        Radius of the outline, px.
    orientations : Tensor
        Rotation matrices (n, 3, 3), camera frame, from the reference orientation to the present one.
    background : Tensor or float
        Grey levels behind the ball: one number (then give ``shape``) or an image (h, w).
    shape : tuple of int, optional
        (h, w) of the images, if ``background`` is a number.
    subsamples : int
        Rays along each side of a pixel.

    Returns
    -------
    Tensor
        Grey levels (n, h, w) in the precision of ``centres``, not rounded, without noise.

    Raises
    ------
    ValueError
        If neither the background nor ``shape`` gives the shape of the images.
    """
    if isinstance(background, Tensor):
        still = background.to(centres)
    elif shape is not None:
        still = torch.full(shape, float(background), dtype=centres.dtype, device=centres.device)
    else:
        raise ValueError("render: the background is a number; give the shape (h, w) of the images as well")
    volume = pattern.volume.to(centres)
    frames = [
        _frame(volume, centre, radius, orientation, still, subsamples)
        for centre, orientation in zip(centres, orientations.to(centres), strict=True)
    ]
    return torch.stack(frames)


def _frame(
    volume: Tensor, centre: Tensor, radius: float, orientation: Tensor, still: Tensor, subsamples: int
) -> Tensor:
    """One image (h, w) of the ball in front of the ``still`` background."""
    rows, columns = still.shape
    # Rays are cast for the pixels around the ball only.
    left, top = (int(v) for v in (centre.detach() - radius - 2).floor())
    span = int(2 * radius) + 6
    x0, x1 = max(left, 0), min(left + span, columns)
    y0, y1 = max(top, 0), min(top + span, rows)
    if x0 >= x1 or y0 >= y1:
        return still
    offsets = (torch.arange(subsamples, dtype=centre.dtype, device=centre.device) + 0.5) / subsamples - 0.5
    x = (torch.arange(x0, x1, device=centre.device)[:, None] + offsets).flatten() - centre[0]
    y = (torch.arange(y0, y1, device=centre.device)[:, None] + offsets).flatten() - centre[1]
    squared = (x**2)[None, :] + (y**2)[:, None]
    hit = squared < radius**2
    height = (radius**2 - squared).clamp_min(1e-6).sqrt()
    surface = torch.stack((x.expand(len(y), -1), y[:, None].expand(-1, len(x)), -height), -1)
    # A row vector times A is A^T times the column: from the camera frame to the body's.
    body = (surface @ orientation) / (radius * CUBE_HALF_WIDTH)
    grey = F.grid_sample(volume[None, None], body[None, None], align_corners=True)[0, 0, 0]
    behind = still[y0:y1, x0:x1].repeat_interleave(subsamples, 0).repeat_interleave(subsamples, 1)
    rays = torch.where(hit, grey, behind)
    pixels = F.avg_pool2d(rays[None, None], subsamples)[0, 0]
    return still.index_put(
        (torch.arange(y0, y1, device=still.device)[:, None], torch.arange(x0, x1, device=still.device)[None]), pixels
    )
