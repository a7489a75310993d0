"""The reference image of each pair, looked at once: region of interest, values, gradients, noise."""

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

#: How far the ball may be from the middle of its crop, px: what the crop's margin leaves after pre-blur and spline.
SLACK_PX = 3.0

#: Distance of neighbouring points, px, where every second pixel is taken like the black squares of a chessboard. A blur
#: of so many px, and more, leaves nothing to learn from the others: standard deviations of all five components agree
#: to 2 % with those from all pixels up to 2 deg per frame, to 5 % at 5 and 10 deg (R = 50, speckle 2.5 to 4 px, noise
#: 0.5 to 8 grey levels).
#: Every second pixel of every second row costs 3 to 45 %. Balls with fewer points keep them all.
CHESSBOARD, MIN_CHESSBOARD_BLUR_PX, MIN_CHESSBOARD_POINTS = math.sqrt(2), 0.7, 2000

#: Every how many points the noise's way into the increment is summed over, which takes a sixth of a pair's time
#: otherwise: the standard deviations then scatter by 2 to 3 % (R = 30 to 75 px).
COVARIANCE_STEP = 4


class Filtered(NamedTuple):
    """Crops of n images as the correlation sees them.

    Attributes
    ----------
    crops : Crops
    c : Tensor
        Spline coefficients (n, s, s) of the blurred images.
    """

    crops: crop.Crops
    c: Tensor

    @classmethod
    def of(cls, crops: crop.Crops, pre_blur: float) -> Filtered:
        """The crops, blurred by ``pre_blur`` px."""
        return cls(crops, interpolation.coefficients(crops.images, pre_blur))

    @classmethod
    def joined(cls, parts: Sequence[Filtered]) -> Filtered:
        """The images of all parts, whose crops have one size, one after the other."""
        if len(parts) == 1:
            return parts[0]
        crops, c = zip(*parts, strict=True)
        return cls(crop.Crops.joined(crops), torch.cat(c))

    def rows(self, start: int, stop: int) -> Filtered:
        """Images ``start`` to ``stop - 1``."""
        return Filtered(self.crops.rows(start, stop), self.c[start:stop])

    def take(self, rows: Tensor) -> Filtered:
        """The given rows (m,) alone."""
        return Filtered(self.crops.take(rows), self.c[rows])


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
        The gradient blurred once more, which carries the pixels' noise into the covariance: (n, 2, p'), at every
        `COVARIANCE_STEP`-th point alone.
    noise : Tensor
        Standard deviation (n,) of the image noise as the raw reference shows it, grey levels; an upper bound where
        the texture is fine.
    geometry : Geometry
    places : Tensor
        Number (p,) of each point's place on a square grid, row by row, the same for all pairs. On a chessboard the grid
        lies at 45 deg to the image.
    side : int
        Points along a side of that grid.
    spacing : float
        Distance of its points, px.
    pre_blur : float
        Standard deviation of the blur that the values have been through, px.
    uneven_light : bool
        Allow for light that changes unevenly over the ball, see `znssd.nuisances`.
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
    spacing: float
    pre_blur: float
    uneven_light: bool = False

    def take(self, rows: Tensor) -> Reference:
        """The given rows (m,) alone."""
        names = ("surface", "weights", "values", "gradient", "blurred_gradient", "noise")
        taken = {name: getattr(self, name)[rows] for name in names}
        points = self.points.mT[rows].mT
        return dataclasses.replace(self, points=points, **taken, geometry=motion_models.taken(self.geometry, rows))

    def thinned(self) -> Reference:
        """With the points alone that the `blurred_gradient` is known at."""
        names = ("surface", "weights", "values", "gradient")
        taken = {name: getattr(self, name)[..., ::COVARIANCE_STEP] for name in names}
        points = self.points[:, ::COVARIANCE_STEP]
        return dataclasses.replace(self, points=points, **taken, places=self.places[::COVARIANCE_STEP])


def point_spacing(radius_px: float, pre_blur: float) -> float:
    """Distance of the points, px, that a region of interest of this radius needs under this pre-blur, px."""
    return CHESSBOARD if pre_blur >= MIN_CHESSBOARD_BLUR_PX and math.pi * radius_px**2 >= MIN_CHESSBOARD_POINTS else 1.0


@functools.lru_cache(maxsize=16)
def _region(reach: int, limit: float, spacing: float, every: int) -> tuple[Tensor, Tensor, int]:
    """Every so many-th of the pixels (p, 2), as whole (x, y) from the middle one, within ``limit`` px of it.

    With them their `places` and the `side` of `Reference`.
    """
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

    ``circles`` (n, 3): the ball in the reference images, px, float64 on the CPU, within `SLACK_PX` of where they were
    cut around; ``camera`` for models that need one; ``spacing`` of the points 1 px or `CHESSBOARD`. With ``every``
    above 1 only so many-th of these are taken, to find the motion roughly; then nothing is known of the noise. There,
    and where no covariance is asked of the pairs (``blurred_every`` None), the gradient stands for its blurred self.
    Otherwise that is taken at so many-th of the points, `COVARIANCE_STEP` wherever there is a covariance of its own.
    """
    crops, c = images.crops, images.c
    half = c.shape[-1] // 2
    centres, radii = circles[:, :2], circles[:, 2]
    # Whole pixels of the crop; its origin is no whole number where pixels were averaged.
    offset = (centres - crops.origin).round().long()
    nearest = crops.origin + offset
    largest = float(radii.max())
    reach = min(math.ceil(roi * largest) + 1, half - 1)
    # The same pixels for all rows: those that some sub-pixel position of the centre brings into the region.
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
    """What may change besides the motion (n, m, p): see `znssd.nuisances`.

    The printed criterion, equation (3), knows no light: the printed modes and translations alone are measured with it.
    """
    turns = model in motion_models.RIGID_BALL
    normals = reference.surface / reference.geometry.radius[:, None, None] if turns else None
    if normals is None or not reference.uneven_light:
        return znssd.nuisances(reference.values, weights, normals)
    along = reference.pre_blur**2 * reference.gradient / reference.geometry.radius[:, None, None]
    # Along the surface: the normal stays of unit length. The limb itself has no gradient to follow.
    inwards = (normals[:, :2] * along).sum(1, keepdim=True) / -normals[:, 2:].clamp_max(-0.1)
    return znssd.nuisances(reference.values, weights, normals, torch.cat((along, inwards), 1))
