"""Rays from the ball's centre across its outline, and the grey levels along them."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchsphere import crop, interpolate, perspective
from torchsphere.perspective import Camera

#: Pre-blur of the images, px.
PRE_BLUR_PX = 0.0


def angles(radius: float) -> Tensor:
    """Angles of the rays, about one per px of the outline."""
    count = int(min(max(2 * math.pi * radius, 64), 720))
    return torch.arange(count, dtype=torch.float64) * (2 * math.pi / count)


def design(angles: Tensor) -> Tensor:
    """Derivatives (a, 3) of the outline's distance along the rays by the circle's x, y and radius."""
    return torch.stack((angles.cos(), angles.sin(), torch.ones_like(angles)), -1)


def across_edge(
    images: Tensor,
    circles: Tensor,
    steps: Tensor,
    angles: Tensor,
    ignore: Tensor | None,
    camera: Camera | None,
) -> tuple[Tensor, Tensor]:
    """Grey levels (n, a, m) at ``steps`` (m,), px outwards, from the outlines of ``circles`` (n, 3) along the rays.

    And which of the rays (n, a), on the CPU, lie in the image with all of their places. With a camera the circles are
    projected centres and radii at their depth: the outline is an ellipse.
    """
    edge = circles[:, 2:].expand(-1, len(angles))
    if camera is not None:
        edge = perspective.outline_distance(circles, angles, camera)
    sampled, inside = levels(images, circles, (edge[..., None] + steps).clamp_min(0.5), angles, ignore)
    return sampled, inside.all(-1).cpu()


def levels(
    images: Tensor, circles: Tensor, radii: Tensor, angles: Tensor, ignore: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """Grey levels along rays from the centres.

    Parameters
    ----------
    images : Tensor
        Grey levels (n, h, w).
    circles : Tensor
        Circles (n, 3) whose centres the rays start from.
    radii : Tensor
        Distances from the centre (n, a, m), px; 1 in place of a where they are the same for all rays.
    angles : Tensor
        Angles (a,) of the rays, rad, from x towards y.
    ignore : Tensor, optional
        (h, w), True where the images are not to be used.

    Returns
    -------
    levels : Tensor
        (n, a, m), of the image blurred by `PRE_BLUR_PX`.
    inside : Tensor
        (n, a, m), True where the place lies in the image, away from its border and from the ignored region.
    """
    height, width = images.shape[-2:]
    direction = torch.stack((angles.cos(), angles.sin()), -1)
    half = math.ceil(float(radii.max())) + 4
    crops = crop.cut(images, circles[:, :2], half, ignore)
    c = interpolate.coefficients(crops.images, PRE_BLUR_PX)
    places = radii[..., None] * direction[:, None, :] + circles[:, None, None, :2]
    limits = torch.tensor([width, height], dtype=torch.float64) - 1
    inside = ((places >= 2) & (places <= limits - 2)).all(-1)
    points = (places - crops.origin[:, None, None]).flatten(1, 2)
    sampled = interpolate.sample(c, points.to(c)).unflatten(1, inside.shape[1:])
    inside = inside.to(images.device)
    if crops.usable is not None:
        column, row = points.round().long().to(images.device).unbind(-1)
        rows = torch.arange(len(images), device=images.device)[:, None]
        inside = inside & crops.usable[rows, row, column].unflatten(1, inside.shape[1:])
    return sampled, inside
