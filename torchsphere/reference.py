"""The reference image of each pair, looked at once: region of interest, values, gradients, noise."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchsphere import criterion, crop, interpolate, motion, turning
from torchsphere.motion import Displacement, Geometry
from torchsphere.perspective import Camera, view_of

#: How far the ball may be from the middle of its crop, px: what the crop's margin leaves after pre-blur and spline.
SLACK_PX = 3.0

#: Models whose displacement and modes `torchsphere.turning` knows.
IN_CLOSED_FORM = (motion.rigid, motion.finite)


@dataclass(frozen=True)
class Reference:
    """What is known of n pairs before the deformed image is looked at.

    Attributes
    ----------
    points : Tensor
        Pixels of the region of interest (n, p, 2), px from the ball's centre; a view of (n, 2, p), so that all x and
        all y lie together.
    surface : Tensor
        The ball's front there (n, 3, p), px from its centre.
    weights : Tensor
        (n, p), 1 where a point counts and 0 where it does not.
    values, gradient : Tensor
        The blurred reference image (n, p) and its gradient (n, 2, p) at the points.
    blurred_gradient : Tensor
        The gradient blurred once more (n, 2, p), which carries the pixels' noise into the covariance.
    noise : Tensor
        Standard deviation (n,) of the image noise as the raw reference shows it, grey levels; an upper bound where
        the texture is fine.
    geometry : Geometry
    places : Tensor
        Column and row (p, 2) of each point on a square grid of `side` px, the same for all pairs, whole numbers.
    side : int
        Side of that grid.
    """

    points: Tensor
    surface: Tensor
    weights: Tensor
    values: Tensor
    gradient: Tensor
    blurred_gradient: Tensor
    noise: Tensor
    geometry: Geometry
    places: Tensor
    side: int

    def take(self, rows: Tensor) -> Reference:
        """The given rows (m,) alone."""
        names = ("surface", "weights", "values", "gradient", "blurred_gradient", "noise")
        taken = {name: getattr(self, name)[rows] for name in names}
        points = self.points.mT[rows].mT
        return dataclasses.replace(self, points=points, **taken, geometry=motion.taken(self.geometry, rows))


@functools.lru_cache(maxsize=16)
def _region(reach: int, limit: float, every: int) -> Tensor:
    """Every so many-th of the pixels (p, 2), as whole (x, y) from the middle one, within ``limit`` px of it."""
    steps = torch.arange(-reach, reach + 1)
    grid = torch.stack(torch.meshgrid(steps, steps, indexing="xy"), -1).reshape(-1, 2)
    return grid[grid.double().norm(dim=-1) < limit][::every]


def build_reference(
    crops: crop.Crops,
    c: Tensor,
    circles: Tensor,
    roi: float,
    pre_blur: float,
    camera: Camera | None = None,
    *,
    every: int = 1,
) -> Reference:
    """Points, values and gradients of the reference image over the region of interest.

    ``circles`` (n, 3): the ball in the reference images, px, float64 on the CPU, within `SLACK_PX` of where they were
    cut around; ``camera`` for models that need one. With ``every`` above 1 only so many-th of the points are taken, to
    find the motion roughly; then nothing is known of the noise, and the gradient stands for its blurred self.
    """
    half = crops.images.shape[-1] // 2
    centres, radii = circles[:, :2], circles[:, 2]
    # Whole pixels of the crop; its origin is no whole number where pixels were averaged.
    offset = (centres - crops.origin).round().long()
    nearest = crops.origin + offset
    largest = float(radii.max())
    reach = min(math.ceil(roi * largest) + 1, half - 1)
    # The same pixels for all rows: those that some sub-pixel position of the centre brings into the region.
    grid = _region(reach, roi * largest + 0.71, every)
    points = grid.T.to(c).contiguous() + (nearest - centres).to(c)[..., None]
    radius = radii.to(c)
    weights = (points.square().sum(1) < (roi * radius[:, None]) ** 2).to(c)
    if crops.usable is not None:
        weights = weights * _looked_up([crops.usable], grid, offset)[0]
    # The nodes' arrays lack the crop's outermost pixel.
    inner = [interpolate.node_values(c), *interpolate.node_gradient(c)]
    values, *gradient = _looked_up(inner, grid, offset - 1)
    blurred, noise = gradient, torch.zeros_like(radius)
    if every == 1:
        twice = interpolate.blur_within(c, pre_blur)
        border = (c.shape[-1] - twice.shape[-1]) // 2 + 1
        blurred = _looked_up(interpolate.node_gradient(twice), grid, offset - border)
        (noise,) = _looked_up([_image_noise(crops.images)], grid, offset - 1)
        noise = torch.linalg.vecdot(noise, weights) / weights.sum(-1).clamp_min(1)
    return Reference(
        points=points.mT,
        surface=turning.surface(points, radius),
        weights=weights,
        values=values,
        gradient=torch.stack(gradient, 1),
        blurred_gradient=torch.stack(blurred, 1),
        noise=noise,
        geometry=Geometry(radius, None if camera is None else view_of(camera, centres, c)),
        places=(grid + reach).to(c.device),
        side=2 * reach + 1,
    )


def _looked_up(maps: Sequence[Tensor], grid: Tensor, offset: Tensor) -> list[Tensor]:
    """Values (n, p) of each of the maps (n, h, w) at the pixels ``grid`` (p, 2) around ``offset`` (n, 2), as (x, y)."""
    step = torch.tensor([1, maps[0].shape[-1]])
    index = (grid @ step) + (offset @ step)[:, None]
    index = index.clamp_(0, maps[0][0].numel() - 1).to(maps[0].device)
    return [values.flatten(1).gather(1, index) for values in maps]


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
    """Change of grey level per px of each unknown (n, k, p): modes . ``gradient`` (n, 2, p)."""
    if model in IN_CLOSED_FORM:
        found = turning.slopes(q, reference.surface, gradient, exact=model is motion.finite)
    else:
        modes = motion.modes(model, q, reference.points, reference.geometry)
        found = torch.einsum("npck,ncp->nkp", modes, gradient)
    return found / scale(reference, q.shape[-1])[..., None]


def nuisances(reference: Reference, model: Displacement, weights: Tensor) -> Tensor:
    """What may change besides the motion (n, m, p): see `criterion.nuisances`.

    The printed criterion, equation (3), knows no light: the printed modes and translations alone are measured with it.
    """
    turns = model in (*IN_CLOSED_FORM, *motion.EXACT)
    normals = reference.surface / reference.geometry.radius[:, None, None] if turns else None
    return criterion.nuisances(reference.values, weights, normals)
