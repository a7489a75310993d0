"""The model's grey levels as a linear function of the map: all rays of all pixels, with their places on the map."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

from torchsphere.kernels import map_design as loops
from torchsphere.kernels.jit import suits
from torchsphere.kernels.layout import Rays
from torchsphere.sphere_map import cube_map
from torchsphere.sphere_map.cube_map import Places


@dataclass(frozen=True)
class Design:
    """The model's grey levels as a linear function of the map's coefficients, in n images of s by s pixels.

    An image has t rays, in any order; those that an image does not need have the factor 0.
    """

    corner: Tensor  # first coefficient (n, t) of the sixteen around each ray
    offset: Tensor  # coordinates (n, t, 2) within the cell, along and across its rows
    factor: Tensor  # derivative (n, t) of the pixel's grey level by the map's value at the ray
    pixel: Tensor  # number (n, t) of the pixel that the ray belongs to, row by row
    fixed: Tensor  # grey levels (n, s, s) without the map
    cells: int

    @classmethod
    def joined(cls, parts: list[Design]) -> Design:
        """The images of all parts, one after the other."""
        if len(parts) == 1:
            return parts[0]
        most = max(part.factor.shape[1] for part in parts)

        def column(name: str) -> Tensor:
            values = [getattr(part, name) for part in parts]
            tail = [0, 0] * (values[0].ndim - 2)
            return torch.cat([F.pad(v, (*tail, 0, most - v.shape[1])) for v in values])

        corner, offset, factor, pixel = (column(name) for name in ("corner", "offset", "factor", "pixel"))
        return cls(corner, offset, factor, pixel, torch.cat([part.fixed for part in parts]), parts[0].cells)

    @classmethod
    def mean(cls, parts: list[Design], shares: list[float]) -> Design:
        """The mean of several models of the same images, each with its share."""
        factor = torch.cat([share * part.factor for share, part in zip(shares, parts, strict=True)], 1)
        fixed = torch.stack([share * part.fixed for share, part in zip(shares, parts, strict=True)]).sum(0)
        corner, offset, pixel = (torch.cat([getattr(p, n) for p in parts], 1) for n in ("corner", "offset", "pixel"))
        return cls(corner, offset, factor, pixel, fixed, parts[0].cells)

    def rows(self, start: int, stop: int) -> Design:
        """Images ``start`` to ``stop - 1``."""
        some = slice(start, stop)
        rays = self.corner[some], self.offset[some], self.factor[some], self.pixel[some]
        return Design(*rays, self.fixed[some], self.cells)

    def map_levels(self, coefficients: Tensor) -> Tensor:
        """The map's part (n, s, s) of the grey levels."""
        if suits(self.factor, coefficients):
            return loops.map_levels(self._rays(), coefficients, self.cells, self._pixels).reshape(self.fixed.shape)
        levels = self.factor * self._places().value(coefficients)
        return (
            levels.new_zeros(len(levels), self._pixels)
            .scatter_add(1, self.pixel.long(), levels)
            .reshape(self.fixed.shape)
        )

    @functools.cached_property
    def even(self) -> Tensor:
        """The map's part (n, s, s) of the grey levels, were all coefficients 1: splines sum to one."""
        sums = self.factor.new_zeros(len(self.factor), self._pixels).scatter_add(1, self.pixel.long(), self.factor)
        return sums.reshape(self.fixed.shape)

    def levels(self, coefficients: Tensor) -> Tensor:
        """Grey levels (n, s, s) with the map's ``coefficients`` (m,)."""
        return self.map_levels(coefficients) + self.fixed

    def adjoint(self, values: Tensor) -> Tensor:
        """Sums (m,) of the pixels' ``values`` (n, s, s) over the coefficients: the adjoint of `map_levels`."""
        count = cube_map.coefficient_count(self.cells)
        if suits(self.factor, values):
            return loops.adjoint(self._rays(), values.flatten(1), self.cells, count)
        return self._places().adjoint(self.factor * values.flatten(1).gather(1, self.pixel.long()), count)

    def coupling(self, values: Tensor, own: int) -> Tensor:
        """`adjoint` (m, n k + c) of the columns of ``values`` (n, s * s, k + c).

        The ``own`` first k columns of an image stand side by side, image after image. The others, which all images
        share, follow, summed over the images.
        """
        count = cube_map.coefficient_count(self.cells)
        if suits(self.factor, values):
            return loops.coupling(self._rays(), values, own, self.cells, count)
        n = len(values)
        images = torch.arange(n, device=values.device).unsqueeze(1)
        places = replace(self._places(), corner=self.corner + count * images)
        rays = self.factor.unsqueeze(-1) * values[images, self.pixel.long()]
        found = places.adjoint(rays, n * count).reshape(n, count, -1)
        return torch.cat((found[..., :own].movedim(0, 1).flatten(1), found[..., own:].sum(0)), 1)

    @property
    def _pixels(self) -> int:
        return self.fixed[0].numel()

    def _rays(self) -> Rays:
        return Rays(self.corner, self.offset, self.factor, self.pixel)

    def _places(self) -> Places:
        return Places(self.corner.long(), self.offset.movedim(-1, 0), self.offset.new_zeros(()), self.cells)
