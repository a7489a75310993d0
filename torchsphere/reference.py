"""The reference image of each pair, looked at once: region of interest, values, gradients, noise."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field

import torch
from torch import Tensor

from torchsphere import crop, interpolate, motion
from torchsphere.motion import Displacement, Geometry
from torchsphere.perspective import Camera, view_of


@dataclass(frozen=True)
class Reference:
    """What is known of n pairs before the deformed image is looked at.

    Attributes
    ----------
    points : Tensor
        Pixels of the region of interest (n, p, 2), px from the ball's centre.
    weights : Tensor
        (n, p), 1 where a point counts and 0 where it does not.
    values, gradient : Tensor
        The blurred reference image (n, p) and its gradient (n, p, 2) at the points.
    blurred_gradient : Tensor
        The gradient blurred once more (n, p, 2), which carries the pixels' noise into the covariance.
    noise : Tensor
        Standard deviation (n,) of the image noise as the raw reference shows it, grey levels; an upper bound where
        the texture is fine.
    geometry : Geometry
    places : Tensor
        Column and row (p, 2) of each point on a square grid of `side` px, the same for all pairs, whole numbers.
    side : int
        Side of that grid.
    memo : list
        The model, the increments and the modes that were asked for last: `slopes` is called several times for one `q`.
    """

    points: Tensor
    weights: Tensor
    values: Tensor
    gradient: Tensor
    blurred_gradient: Tensor
    noise: Tensor
    geometry: Geometry
    places: Tensor
    side: int
    memo: list[tuple[Displacement, Tensor, Tensor]] = field(default_factory=list, compare=False, repr=False)

    def take(self, rows: Tensor) -> Reference:
        """The given rows (m,) alone."""
        names = ("points", "weights", "values", "gradient", "blurred_gradient", "noise")
        taken = {name: getattr(self, name)[rows] for name in names}
        return dataclasses.replace(self, **taken, geometry=motion.taken(self.geometry, rows), memo=[])


def build_reference(
    crops: crop.Crops, c: Tensor, circles: Tensor, roi: float, pre_blur: float, camera: Camera | None = None
) -> Reference:
    """Points, values and gradients of the reference image over the region of interest.

    ``circles`` (n, 3): the ball in the reference images, px, float64 on the CPU; ``camera`` for models that need one.
    """
    half = crops.images.shape[-1] // 2
    middle = crops.origin + half
    centres, radii = circles[:, :2], circles[:, 2]
    largest = float(radii.max())
    reach = min(math.ceil(roi * largest) + 1, half - 1)
    steps = torch.arange(-reach, reach + 1)
    grid = torch.stack(torch.meshgrid(steps, steps, indexing="xy"), -1).reshape(-1, 2)
    # The same pixels for all rows: those that some sub-pixel position of the centre brings into the region.
    grid = grid[grid.double().norm(dim=-1) < roi * largest + 0.71]
    points = (grid[None] + (middle - centres)[:, None]).to(c)
    radius = radii.to(c)
    weights = (points.square().sum(-1) < (roi * radius[:, None]) ** 2).to(c)
    columns, rows = ((grid + half).to(c.device)).unbind(-1)
    if crops.usable is not None:
        weights = weights * crops.usable[:, rows, columns]
    # The nodes' arrays lack the crop's outermost pixel.
    inner = (slice(None), rows - 1, columns - 1)
    gradient = torch.stack([d[inner] for d in interpolate.node_gradient(c)], -1)
    twice = interpolate.blur(c, pre_blur)
    blurred_gradient = torch.stack([d[inner] for d in interpolate.node_gradient(twice)], -1)
    return Reference(
        points=points,
        weights=weights,
        values=interpolate.node_values(c)[inner],
        gradient=gradient,
        blurred_gradient=blurred_gradient,
        noise=_image_noise(crops.images)[inner].mul(weights).sum(-1).div(weights.sum(-1).clamp_min(1)),
        geometry=Geometry(radius, None if camera is None else view_of(camera, centres, c)),
        places=(grid + reach).to(c.device),
        side=2 * reach + 1,
    )


def _image_noise(images: Tensor) -> Tensor:
    """Standard deviation of noise per pixel, (n, h, w) -> (n, h - 2, w - 2); its mean over a region is meant.

    Mean absolute response of the difference of two Laplacians (J. Immerkaer, Computer Vision and Image Understanding
    64 (1996) 300, doi:10.1006/cviu.1996.0060), which a smooth image does not excite.
    """
    rows = images[:, :-2] - 2 * images[:, 1:-1] + images[:, 2:]
    both = rows[:, :, :-2] - 2 * rows[:, :, 1:-1] + rows[:, :, 2:]
    return both.abs() * (math.sqrt(math.pi / 2) / 6)


def scale(reference: Reference, k: int) -> Tensor:
    """Factors (n, k) that turn an increment into px: 1 for translations, the radius for rotations and for growth."""
    radius = reference.geometry.radius[:, None]
    return torch.cat((torch.ones(len(radius), 2).to(radius), radius.expand(-1, k - 2)), -1)


def slopes(gradient: Tensor, q: Tensor, model: Displacement, reference: Reference) -> Tensor:
    """Change of grey level per px of each unknown: modes . gradient, (n, p, k)."""
    if not (reference.memo and reference.memo[0][0] is model and reference.memo[0][1] is q):
        modes = motion.modes(model, q, reference.points, reference.geometry)
        reference.memo[:] = [(model, q, modes)]
    modes = reference.memo[0][2]
    return (modes * gradient[..., None]).sum(-2) / scale(reference, q.shape[-1])[:, None]
