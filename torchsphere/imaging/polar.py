"""Grey levels along rays from the ball's centre across its outline."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchsphere.geometry import camera as perspective
from torchsphere.geometry.camera import Camera
from torchsphere.imaging import crop, interpolation

#: Pre-blur of the images, px.
PRE_BLUR_PX = 0.0


def angles(radius: float) -> Tensor:
    """Angles (a,) of the rays, rad, about one ray per px of the outline."""
    count = int(min(max(2 * math.pi * radius, 64), 720))
    return torch.arange(count, dtype=torch.float64) * (2 * math.pi / count)


def design(angles: Tensor) -> Tensor:
    """Derivatives (a, 3) of the outline's distance along the rays by the circle's x, y and radius."""
    return torch.stack((angles.cos(), angles.sin(), torch.ones_like(angles)), -1)


def ellipse(angles: Tensor) -> Tensor:
    """Derivatives (a, 2) of the outline's distance along the rays by the half difference of axes along x and y.

    The second column is that of axes at 45 deg.
    """
    return torch.stack(((2 * angles).cos(), (2 * angles).sin()), -1)


class Splines:
    """Splines of crops of ``images`` (n, h, w) around a ball; the last ones are kept and used again.

    ``ignore`` (h, w) is True where the images are not to be used.
    """

    def __init__(self, images: Tensor, ignore: Tensor | None = None) -> None:
        self.images, self._ignore = images, ignore
        self._last: tuple[int, Tensor, crop.Crops, Tensor] | None = None

    def around(self, centres: Tensor, half: int) -> tuple[crop.Crops, Tensor]:
        """Crops of ``2 half + 1`` px around ``centres`` (n, 2), and the coefficients of their splines."""
        middle = centres.round()
        if self._last is None or half != self._last[0] or not torch.equal(middle, self._last[1]):
            crops = crop.cut(self.images, centres, half, self._ignore)
            self._last = half, middle, crops, interpolation.coefficients(crops.images, PRE_BLUR_PX)
        return self._last[2:]


def across_edge(
    splines: Splines,
    circles: Tensor,
    steps: Tensor,
    angles: Tensor,
    camera: Camera | None,
    beyond: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """Grey levels (n, a, m) along the rays at ``steps`` (m,), px outwards, from the outlines of ``circles`` (n, 3).

    Also a mask (n, a), on the CPU, of the rays that lie fully in the image. With a camera the circles are projected
    centres and radii at their depth: the outline is an ellipse. It may lie ``beyond`` (n, a) the circle, px.
    """
    edge = circles[:, 2:].expand(-1, len(angles))
    if camera is not None:
        edge = perspective.outline_distance(circles, angles, camera)
    if beyond is not None:
        edge = edge + beyond
    sampled, inside = levels(splines, circles, (edge[..., None] + steps).clamp_min(0.5), angles)
    return sampled, inside.all(-1).cpu()


def levels(splines: Splines, circles: Tensor, radii: Tensor, angles: Tensor) -> tuple[Tensor, Tensor]:
    """Grey levels (n, a, m) along rays from the centres of ``circles`` (n, 3), and a mask of the usable places.

    The rays have the ``angles`` (a,), rad, from x towards y; ``radii`` (n, a, m) or (n, 1, m) are distances from the
    centre, px. Usable places lie away from the image's border and from the ignored region.
    """
    height, width = splines.images.shape[-2:]
    crops, c = splines.around(circles[:, :2], math.ceil(float(radii.max())) + 4)
    direction = torch.stack((angles.cos(), angles.sin()))[..., None]
    centres = (circles[:, :2] - crops.origin)[..., None, None]
    # All x lie together in memory, and all y: twice as fast to sample as pairs (x, y).
    places = torch.addcmul(centres, radii[:, None], direction)
    points = places.flatten(2)
    sampled = interpolation.sample(c, points.to(c).mT).unflatten(1, places.shape[2:])
    if crops.usable is None:
        # The crops lie in the image, and all places lie in the crops, far enough from the border.
        return sampled, torch.ones_like(sampled, dtype=torch.bool)
    limits = torch.tensor([width, height], dtype=torch.float64) - 1
    low, high = ((limit - crops.origin)[..., None, None] for limit in (torch.full((2,), 2.0), limits - 2))
    inside = ((places >= low) & (places <= high)).all(1).to(sampled.device)
    column, row = points.round().long().to(sampled.device).unbind(1)
    rows = torch.arange(len(sampled), device=sampled.device)[:, None]
    return sampled, inside & crops.usable[rows, row, column].unflatten(1, inside.shape[1:])
