"""The ball's circle in an image, fitted to its outline and its limb."""

from __future__ import annotations

import dataclasses
import math

import torch
from torch import Tensor

from torchsphere.detection import blurred_limb, disc_filter, limb_fit, outline_fit
from torchsphere.detection.blurred_limb import LimbBlur
from torchsphere.detection.candidates import MIN_SUPPORT
from torchsphere.detection.silhouette import saturated
from torchsphere.geometry.camera import Camera
from torchsphere.geometry.circle import Circle
from torchsphere.settings.arrays import check_finite_around

#: Largest distance of the likeliest limb from the circle through the edges, px and share of the radius.
MAX_LIMB_SHIFT_PX, MAX_LIMB_SHIFT = 2.0, 0.04


def refine_circle(image: Tensor, circle: Circle, window: float | None = None, camera: Camera | None = None) -> Circle:
    """The circle fitted to the outline in ``image`` (h, w), from a circle that is right to ``window`` px.

    With a camera, circles are projected centres and radii at their depth. Raises if the image shows no outline there.
    """
    guess = torch.tensor([[circle.x, circle.y, circle.radius]], dtype=torch.float64)
    reach = max(2.0, 0.06 * circle.radius) if window is None else window
    check_finite_around(image, circle.x, circle.y, circle.radius + outline_fit.OUTWARDS * reach)
    plain = outline_fit.is_plain(image, guess[0])
    fit = outline_fit.refine(image[None], guess, window=reach, plain=plain, patterned=not plain, camera=camera)
    difference = (image - _around(image, fit.circle[0]).median()).abs()
    silhouette = saturated(difference, _around(difference, fit.circle[0]))
    explained = disc_filter.explained_by(silhouette, fit.circle[0])
    if float(fit.support[0]) < MIN_SUPPORT or explained < disc_filter.MIN_EXPLAINED:
        raise ValueError(
            f"no outline was found near the circle ({circle.x:g}, {circle.y:g}, {circle.radius:g}): give one that is "
            f"right to {reach:.1f} px, or track with the circle as given"
        )
    rough = as_circle(fit.circle[0], fit.covariance[0], circle.frame)
    if plain:
        return rough
    return unblurred(image, at_limb(image[None], rough, camera=camera), camera=camera)[0]


def at_limb(views: Tensor, circle: Circle, ignore: Tensor | None = None, camera: Camera | None = None) -> Circle:
    """The circle at the likeliest limb of a speckled ball, from a ``circle`` that is right to about a px.

    ``views`` (m, h, w): one image as recorded and minus its background, of which the most certain one counts. Where
    every limb is too far from the circle, the circle is returned with that distance as a guessed standard deviation.
    """
    guess = torch.tensor([[circle.x, circle.y, circle.radius]], dtype=torch.float64)
    fitted, covariance = limb_fit.fit(views, guess.expand(len(views), -1), ignore=ignore, camera=camera)
    far = max(MAX_LIMB_SHIFT_PX, MAX_LIMB_SHIFT * circle.radius)
    variance = covariance.diagonal(dim1=1, dim2=2).sum(-1)
    near = ((fitted - guess).abs() < far).all(-1) & variance.isfinite()
    if not bool(near.any()):
        return dataclasses.replace(circle, sd_x=far, sd_y=far, sd_radius=far, sd_guessed=True)
    best = int(variance.where(near, torch.inf).argmin())
    return dataclasses.replace(as_circle(fitted[best], covariance[best], circle.frame), others=circle.others)


def unblurred(
    image: Tensor,
    circle: Circle,
    *,
    motion: Tensor | None = None,
    ignore: Tensor | None = None,
    camera: Camera | None = None,
) -> tuple[Circle, LimbBlur | None]:
    """The ``circle`` of `at_limb` where the limb in ``image`` (h, w) is blurred, with the blur; as it is where not.

    ``motion`` (2,) of the ball from frame to frame, px.
    """
    if circle.sd_guessed:
        return circle, None
    guess = torch.tensor([[circle.x, circle.y, circle.radius]], dtype=torch.float64)
    moves = None if motion is None else motion[None]
    found = blurred_limb.fit_as_needed(
        image[None], guess, motion=moves, ignore=ignore, camera=camera, only_blurred=True
    )
    if found is None:
        return circle, None
    fitted, covariance, blur = found
    far = max(MAX_LIMB_SHIFT_PX, MAX_LIMB_SHIFT * circle.radius, 1.5 * math.sqrt(blur.variance))
    if bool(((fitted - guess).abs() > far).any()):
        return circle, None
    return dataclasses.replace(as_circle(fitted[0], covariance[0], circle.frame), others=circle.others), blur


def as_circle(values: Tensor, covariance: Tensor, frame: int) -> Circle:
    """A `Circle` of the ``values`` (3,) and their ``covariance`` (3, 3)."""
    x, y, radius, sd_x, sd_y, sd_radius = torch.cat((values, covariance.diagonal().sqrt())).tolist()
    return Circle(x, y, radius, sd_x, sd_y, sd_radius, frame)


def as_values(circle: Circle) -> Tensor:
    """Centre and radius (3,) of a circle, px, float64."""
    return torch.tensor([circle.x, circle.y, circle.radius], dtype=torch.float64)


def _around(image: Tensor, circle: Tensor) -> Tensor:
    """Values (n,) of the image (h, w) in a ring around the circle; all values where the image shows no such ring."""
    x, y, radius = circle.tolist()
    rows, columns = (torch.arange(size, device=image.device) for size in image.shape)
    distance = ((rows[:, None] - y) ** 2 + (columns - x) ** 2).sqrt()
    ring = image[(distance > 1.1 * radius) & (distance < disc_filter.RING * radius)]
    return ring if len(ring) else image.flatten()
