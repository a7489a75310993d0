"""Interlaced video: rows of one parity show the ball half a frame later than the others.

Of such images one field is kept, and the other interpolated from it. Images of one field are a frame interval apart
like the frames, so that the increments keep their meaning.
"""

from __future__ import annotations

import dataclasses

import torch
from torch import Tensor

from torchsphere.imaging.crop import Crops
from torchsphere.kernels import fields, jit

#: Shift (x, y) between the fields above which an image counts as interlaced, px (docs/constants.toml).
MIN_SHIFT_PX = (0.05, 0.15)

#: Least ratio of a shift to its standard deviation.
MIN_SIGNIFICANCE = 5.0

#: Least share of the difference between the rows that a shift explains (docs/constants.toml).
MIN_EXPLAINED = 0.08

#: Least combing of an image of two instants that are so far apart that no small shift explains it
#: (docs/constants.toml).
MIN_COMBING = 2.0

#: Least share of the examined images that are interlaced.
MIN_SHARE = 0.5

#: Number of images of a batch that are examined: all of them would cost a tenth of the time of a pair.
EXAMINED_IMAGES = 4

#: Weights of four rows of one field in the cubic through them, at half a row behind the second.
MIDWAY_WEIGHTS = (-1 / 16, 9 / 16, 9 / 16, -1 / 16)


def field_shift(images: Tensor) -> Tensor:
    """Shift (n, 2) in px of each image's odd rows against an interpolation of its even rows, to first order."""
    products = row_products(images).double()
    normal = products[:, :2, :2] + 1e-6 * torch.eye(2, dtype=torch.float64, device=images.device)
    score, power = products[:, :2, 2], products[:, 2, 2]
    shift = torch.linalg.solve_ex(normal, score)[0]
    # Without texture, the noise of the rows alone would give a shift.
    pixels = (images.shape[1] - 8) * (images.shape[2] - 2)
    variance = power[:, None] / pixels * torch.linalg.inv_ex(normal)[0].diagonal(dim1=1, dim2=2)
    explained = (shift * score).sum(-1, keepdim=True) > MIN_EXPLAINED * power[:, None]
    return torch.where((shift.abs() > MIN_SIGNIFICANCE * variance.sqrt()) & explained, shift, 0.0)


@jit.in_loops(fields.products)
def row_products(images: Tensor) -> Tensor:
    """Sums (n, 3, 3) of the products of slope along x, slope along y and rest, over the pixels of ``images`` (n, h, w).

    The rest is an image minus the interpolation of each of its rows from the other field. Its sign alternates from row
    to row, since rows belong to either field in turn; the slopes are those of the interpolation.
    """
    between = _interpolate_rows(images)
    rest = (images[:, 3:-3] - between)[:, 1:-1, 1:-1]
    slope_x = 0.5 * (between[:, 1:-1, 2:] - between[:, 1:-1, :-2])
    slope_y = 0.5 * (between[:, 2:, 1:-1] - between[:, :-2, 1:-1])
    sign = 1 - 2 * (torch.arange(rest.shape[1], device=rest.device) % 2)[:, None].to(rest)
    values = torch.stack((slope_x, slope_y, sign * rest), 1).flatten(2)
    return values @ values.mT


def combing(images: Tensor) -> Tensor:
    """How much less (n,) a row resembles its neighbours, which are rows of the other field, than rows of its own field.

    The ratio of the mean squares that both interpolations leave: below 1 for an image of one instant, 1 for noise.
    """
    images = images.to(torch.float32)
    rest = [
        images[:, 6:-6] - _interpolate_rows(images, distance)[:, 6 - 3 * distance :][:, : images.shape[1] - 12]
        for distance in (1, 2)
    ]
    by_other, by_own = (values.square().mean((1, 2)) for values in rest)
    return by_other / by_own.clamp_min(torch.finfo(torch.float32).tiny)


def is_interlaced(crops: Crops) -> bool:
    """Whether most of the crops show the ball at two instants, by a small shift between them or by comb-like edges."""
    examined = crops.images[:: max(1, len(crops.images) // EXAMINED_IMAGES)]
    shift = field_shift(examined).abs()
    apart = (shift > torch.tensor(MIN_SHIFT_PX).to(shift)).any(-1) | (combing(examined) > MIN_COMBING)
    return bool(apart.double().mean() > MIN_SHARE)


def of_even_rows(images: Tensor) -> Tensor:
    """Whole ``images`` (n, h, w) with their odd rows interpolated from the even ones, floating point."""
    images = (images if images.is_floating_point() else images.float()).clone()
    images[:, 3:-3][:, ::2] = _interpolate_rows(images)[:, ::2]
    return images


def one_field(crops: Crops) -> Crops:
    """The crops with the odd rows of the image interpolated from the even ones."""
    images = crops.images.clone()
    between = _interpolate_rows(images)
    odd = (crops.origin[:, 1].long()[:, None] + torch.arange(images.shape[1])) % 2 == 1
    odd = odd.to(images.device)[:, 3:-3, None]
    images[:, 3:-3] = torch.where(odd, between, images[:, 3:-3])
    return dataclasses.replace(crops, images=images)


def _interpolate_rows(images: Tensor, distance: int = 1) -> Tensor:
    """Each row interpolated from those at 1 and 3 times the ``distance``, (n, h - 6 distance, w).

    At a distance of 1 these are rows of the other field, at 2 rows of its own.
    """
    first, second, third, last = MIDWAY_WEIGHTS
    height, reach = images.shape[1], 3 * distance
    rows = [images[:, reach + step : height - reach + step] for step in (-reach, -distance, distance, reach)]
    return first * rows[0] + second * rows[1] + third * rows[2] + last * rows[3]
