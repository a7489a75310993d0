"""Rays from the ball's centre across its outline, and the grey levels along them."""

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
    """Angles of the rays, about one per px of the outline."""
    count = int(min(max(2 * math.pi * radius, 64), 720))
    return torch.arange(count, dtype=torch.float64) * (2 * math.pi / count)


def design(angles: Tensor) -> Tensor:
    """Derivatives (a, 3) of the outline's distance along the rays by the circle's x, y and radius."""
    return torch.stack((angles.cos(), angles.sin(), torch.ones_like(angles)), -1)


class Splines:
    """Splines of n images about a ball, made anew only where it asks for other crops than the last time.

    Parameters
    ----------
    images : Tensor
        Grey levels (n, h, w).
    ignore : Tensor, optional
        (h, w), True where the images are not to be used.
    """

    def __init__(self, images: Tensor, ignore: Tensor | None = None) -> None:
        self.images, self._ignore = images, ignore
        self._last: tuple[int, Tensor, crop.Crops, Tensor] | None = None

    def around(self, centres: Tensor, half: int) -> tuple[crop.Crops, Tensor]:
        """Crops of ``2 half + 1`` px around ``centres`` (n, 2), and the coefficients of the images blurred there."""
        middle = centres.round()
        if self._last is None or half != self._last[0] or not torch.equal(middle, self._last[1]):
            crops = crop.cut(self.images, centres, half, self._ignore)
            self._last = half, middle, crops, interpolation.coefficients(crops.images, PRE_BLUR_PX)
        return self._last[2:]


def across_edge(
    splines: Splines, circles: Tensor, steps: Tensor, angles: Tensor, camera: Camera | None
) -> tuple[Tensor, Tensor]:
    """Grey levels (n, a, m) at ``steps`` (m,), px outwards, from the outlines of ``circles`` (n, 3) along the rays.

    And which of the rays (n, a), on the CPU, lie in the image with all of their places. With a camera the circles are
    projected centres and radii at their depth: the outline is an ellipse.
    """
    edge = circles[:, 2:].expand(-1, len(angles))
    if camera is not None:
        edge = perspective.outline_distance(circles, angles, camera)
    sampled, inside = levels(splines, circles, (edge[..., None] + steps).clamp_min(0.5), angles)
    return sampled, inside.all(-1).cpu()


def levels(splines: Splines, circles: Tensor, radii: Tensor, angles: Tensor) -> tuple[Tensor, Tensor]:
    """Grey levels along rays from the centres.

    Parameters
    ----------
    splines : Splines
        Of n images.
    circles : Tensor
        Circles (n, 3) whose centres the rays start from.
    radii : Tensor
        Distances from the centre (n, a, m), px; 1 in place of a where they are the same for all rays.
    angles : Tensor
        Angles (a,) of the rays, rad, from x towards y.

    Returns
    -------
    levels : Tensor
        (n, a, m), of the image blurred by `PRE_BLUR_PX`.
    inside : Tensor
        (n, a, m), True where the place lies in the image, away from its border and from the ignored region.
    """
    height, width = splines.images.shape[-2:]
    crops, c = splines.around(circles[:, :2], math.ceil(float(radii.max())) + 4)
    direction = torch.stack((angles.cos(), angles.sin()))[..., None]
    centres = (circles[:, :2] - crops.origin)[..., None, None]
    # All x and all y lie together: twice as fast to sample as pairs of them.
    places = torch.addcmul(centres, radii[:, None], direction)
    points = places.flatten(2)
    sampled = interpolation.sample(c, points.to(c).mT).unflatten(1, places.shape[2:])
    if crops.usable is None:
        # The crops lie in the image, and all places in the crops, further from their border than need be.
        return sampled, torch.ones_like(sampled, dtype=torch.bool)
    limits = torch.tensor([width, height], dtype=torch.float64) - 1
    low, high = ((limit - crops.origin)[..., None, None] for limit in (torch.full((2,), 2.0), limits - 2))
    inside = ((places >= low) & (places <= high)).all(1).to(sampled.device)
    column, row = points.round().long().to(sampled.device).unbind(1)
    rows = torch.arange(len(sampled), device=sampled.device)[:, None]
    return sampled, inside & crops.usable[rows, row, column].unflatten(1, inside.shape[1:])
