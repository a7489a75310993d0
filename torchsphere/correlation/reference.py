"""Pairs of images, and the reference image of each pair: region of interest, values, gradients, noise."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.correlation import reference_lookup, znssd
from torchsphere.geometry import motion_models, rotation
from torchsphere.geometry.camera import Camera, view_of
from torchsphere.geometry.motion_models import Displacement, Geometry
from torchsphere.imaging import crop, interpolation

#: Largest distance of the ball from the middle of its crop, px; the crop's margin exceeds pre-blur and spline by it.
SLACK_PX = 3.0

#: Distance of neighbouring points on a chessboard of pixels, px.
CHESSBOARD = math.sqrt(2)

#: Least pre-blur, px, and least number of pixels of a region that uses a chessboard of them (docs/constants.toml).
MIN_CHESSBOARD_BLUR_PX, MIN_CHESSBOARD_POINTS = 0.7, 2000

#: Every how many points the covariance uses (docs/constants.toml).
COVARIANCE_STEP = 4


class Filtered(NamedTuple):
    """Crops of n images, blurred."""

    crops: crop.Crops
    c: Tensor  # spline coefficients (n, s, s) of the blurred images

    @classmethod
    def of(cls, crops: crop.Crops, pre_blur: float) -> Filtered:
        """The crops, blurred by ``pre_blur`` px."""
        return cls(crops, interpolation.coefficients(crops.images, pre_blur))

    @classmethod
    def joined(cls, parts: Sequence[Filtered]) -> Filtered:
        """The images of all parts, one after the other; their crops have one size."""
        if len(parts) == 1:
            return parts[0]
        crops, c = zip(*parts, strict=True)
        return cls(crop.Crops.joined(crops), torch.cat(c))

    def rows(self, start: int, stop: int) -> Filtered:
        """Images ``start`` to ``stop - 1``."""
        return Filtered(self.crops.rows(start, stop), self.c[start:stop])

    def take(self, rows: Tensor) -> Filtered:
        """The given rows (m,)."""
        return Filtered(self.crops.take(rows), self.c[rows])


class Pairs(NamedTuple):
    """n pairs of images."""

    f: Filtered  # crops of the reference images
    g: Filtered  # crops of the deformed images
    circles: Tensor  # the ball in the reference images (n, 3), px, float64 on the CPU

    @property
    def shift(self) -> Tensor:
        """The ball's centre in the reference image, from the origin of the deformed image's crop (n, 2), px."""
        return (self.circles[:, :2] - self.g.crops.origin).to(self.g.c)

    def rows(self, start: int, stop: int) -> Pairs:
        """Pairs ``start`` to ``stop - 1``."""
        return Pairs(self.f.rows(start, stop), self.g.rows(start, stop), self.circles[start:stop])

    def take(self, rows: Tensor) -> Pairs:
        """The given rows (m,)."""
        return Pairs(self.f.take(rows), self.g.take(rows), self.circles[rows.cpu()])


@dataclass(frozen=True)
class Reference:
    """The reference images of n pairs at p points of the region of interest."""

    points: Tensor  # pixels (n, p, 2), px from the ball's centre; a view of (n, 2, p)
    surface: Tensor  # the ball's front there (n, 3, p), px from its centre
    weights: Tensor  # (n, p), 0 to 1
    values: Tensor  # the blurred reference image (n, p), grey levels
    gradient: Tensor  # its gradient (n, 2, p), grey levels per px
    blurred_gradient: Tensor  # the gradient blurred once more (n, 2, p'), at every `COVARIANCE_STEP`-th point
    noise: Tensor  # standard deviation (n,) of the raw image's noise, grey levels; an upper bound for fine texture
    geometry: Geometry
    places: Tensor  # index (p,) of each point on a square grid, row by row; a chessboard's grid is turned by 45 deg
    side: int  # points along a side of that grid
    spacing: float  # distance of its points, px
    pre_blur: float  # standard deviation of the blur of the values, px
    uneven_light: bool = False  # allow for light that changes unevenly over the ball: `znssd.nuisances`

    def take(self, rows: Tensor) -> Reference:
        """The given rows (m,)."""
        names = ("surface", "weights", "values", "gradient", "blurred_gradient", "noise")
        taken = {name: getattr(self, name)[rows] for name in names}
        points = self.points.mT[rows].mT
        return dataclasses.replace(self, points=points, **taken, geometry=motion_models.taken(self.geometry, rows))

    def thinned(self) -> Reference:
        """The same at the points of the `blurred_gradient` alone."""
        names = ("surface", "weights", "values", "gradient")
        taken = {name: getattr(self, name)[..., ::COVARIANCE_STEP] for name in names}
        points = self.points[:, ::COVARIANCE_STEP]
        return dataclasses.replace(self, points=points, **taken, places=self.places[::COVARIANCE_STEP])


def point_spacing(radius_px: float, pre_blur: float) -> float:
    """Distance of the points of a region of interest of this radius under this pre-blur, all px."""
    blurred = pre_blur >= MIN_CHESSBOARD_BLUR_PX
    return CHESSBOARD if blurred and math.pi * radius_px**2 >= MIN_CHESSBOARD_POINTS else 1.0


@functools.lru_cache(maxsize=16)
def _region(reach: int, limit: float, spacing: float, every: int) -> tuple[Tensor, Tensor, int]:
    """Every ``every``-th pixel (p, 2), as whole (x, y) from the middle, within ``limit`` px; their places and side."""
    steps = torch.arange(-reach, reach + 1)
    grid = torch.stack(torch.meshgrid(steps, steps, indexing="xy"), -1).reshape(-1, 2)
    grid = grid[grid.double().norm(dim=-1) < limit]
    places = grid
    if spacing == CHESSBOARD:
        grid = grid[grid.sum(-1) % 2 == 0]
        places = torch.stack((grid.sum(-1), grid[:, 0] - grid[:, 1]), -1) // 2
    places = places - places.min()
    side = int(places.max()) + 1
    return grid[::every], (places[:, 1] * side + places[:, 0])[::every].contiguous(), side


def build_reference(
    images: Filtered,
    circles: Tensor,
    roi: float,
    pre_blur: float,
    camera: Camera | None = None,
    *,
    spacing: float = 1.0,
    every: int = 1,
    blurred_every: int | None = COVARIANCE_STEP,
) -> Reference:
    """Points, values and gradients of the reference image over the region of interest.

    ``circles`` (n, 3): the ball, px, float64 on the CPU, within `SLACK_PX` of the centre of its crop; ``spacing`` of
    the points 1 px or `CHESSBOARD`. A coarse solution uses every ``every``-th point and knows no noise. There, and with
    ``blurred_every`` None, the gradient stands for the blurred gradient; otherwise it is blurred at every
    ``blurred_every``-th point, `COVARIANCE_STEP` for a covariance.
    """
    crops, c = images.crops, images.c
    half = c.shape[-1] // 2
    centres, radii = circles[:, :2], circles[:, 2]
    # Whole pixels of the crop, whose origin is fractional where pixels were averaged.
    offset = (centres - crops.origin).round().long()
    nearest = crops.origin + offset
    largest = float(radii.max())
    reach = min(math.ceil(roi * largest) + 1, half - 1)
    # The same pixels for all rows: all that a sub-pixel position of the centre brings into the region.
    grid, places, side = _region(reach, roi * largest + 0.71, spacing, every)
    radius = radii.to(c)
    surface, weights = reference_lookup.front(grid, (nearest - centres).to(c), radius, roi * radius)
    if crops.usable is not None:
        weights = weights * reference_lookup.gather_pixels([crops.usable], grid, offset)[0]
    values, gradient = reference_lookup.levels(c, grid, offset)
    carrying, noise = gradient[..., ::COVARIANCE_STEP], torch.zeros_like(radius)
    if every == 1 and blurred_every is not None:
        carrying = reference_lookup.blurred_gradient(c, grid[::blurred_every], offset, pre_blur)
    if every == 1:
        noise = reference_lookup.noise(crops.images, grid, offset, weights)
    return Reference(
        points=surface[:, :2].mT,
        surface=surface,
        weights=weights,
        values=values,
        gradient=gradient,
        blurred_gradient=carrying,
        noise=noise,
        geometry=Geometry(radius, None if camera is None else view_of(camera, centres, c)),
        places=places.to(c.device),
        side=side,
        spacing=spacing,
        pre_blur=pre_blur,
    )


def scale(reference: Reference, k: int) -> Tensor:
    """Factors (n, k) that turn an increment into px: 1 for translations, the radius for rotations and for growth."""
    radius = reference.geometry.radius[:, None]
    return torch.cat((torch.ones(len(radius), 2).to(radius), radius.expand(-1, k - 2)), -1)


def slopes(gradient: Tensor, q: Tensor, model: Displacement, reference: Reference) -> Tensor:
    """Change of grey level per px of each unknown (n, k, p): modes . ``gradient`` (n, 2, p)."""
    if model in motion_models.CLOSED_FORM:
        found = rotation.slopes(q, reference.surface, gradient, exact=model is motion_models.finite)
    else:
        modes = motion_models.modes(model, q, reference.points, reference.geometry)
        found = torch.einsum("npck,ncp->nkp", modes, gradient)
    return found / scale(reference, q.shape[-1])[..., None]


def nuisances(reference: Reference, model: Displacement, weights: Tensor) -> Tensor:
    """Changes besides the motion (n, m, p), see `znssd.nuisances`: light only in the models of a rigid ball.

    The printed criterion, equation (3), has gain and offset alone.
    """
    rigid = model in motion_models.RIGID_BALL
    normals = reference.surface / reference.geometry.radius[:, None, None] if rigid else None
    if normals is None or not reference.uneven_light:
        return znssd.nuisances(reference.values, weights, normals)
    along = reference.pre_blur**2 * reference.gradient / reference.geometry.radius[:, None, None]
    # The normal keeps its length; the limb itself has no gradient.
    inwards = (normals[:, :2] * along).sum(1, keepdim=True) / -normals[:, 2:].clamp_max(-0.1)
    return znssd.nuisances(reference.values, weights, normals, torch.cat((along, inwards), 1))
