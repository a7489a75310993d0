"""Interlaced video: rows of one parity show the ball half a frame later than the others, and smear a speckle's edge.

Where that is seen, one field is kept and the other interpolated from it: the field's images are a frame interval apart
like the frames themselves, so that the increments keep their meaning.
"""

from __future__ import annotations

import dataclasses

import torch
from torch import Tensor

from torchsphere.imaging.crop import Crops

#: Shift (x, y) between the fields above which an image counts as interlaced, px. Progressive images of the example
#: ball show up to 0.01 px along the rows and 0.03 across, where a row's interpolation errs; strongly compressed ones
#: 0.01 and 0.09. Fields nearer to each other than this do no harm.
MIN_SHIFT_PX = (0.05, 0.15)

#: A shift counts when it is as many of its standard deviations, and explains this share of what the rows differ by.
#: Where the texture is finer than a field's rows, the rows differ anyway: measured shares of 0.05 at most, and 0.14
#: where the fields are 3 px apart, far beyond the first order.
SIGNIFICANT, EXPLAINED = 5.0, 0.08

#: Share of the images that must agree, and how many of a batch are looked at: all of them cost a tenth of a pair.
MIN_SHARE, LOOKED_AT = 0.5, 4

#: Half a row further, by the cubic through four rows of one field.
MIDWAY = (-1 / 16, 9 / 16, 9 / 16, -1 / 16)


def field_shift(images: Tensor) -> Tensor:
    """Shift (n, 2) in px of each image's odd rows against what its even rows let expect, to first order."""
    between = _between(images)
    rest = images[:, 3:-3] - between
    slope_x = 0.5 * (between[:, 1:-1, 2:] - between[:, 1:-1, :-2])
    slope_y = 0.5 * (between[:, 2:, 1:-1] - between[:, :-2, 1:-1])
    rest = rest[:, 1:-1, 1:-1]
    # Rows take turns in being one field or the other, and so does the sign of their rest.
    sign = 1 - 2 * (torch.arange(rest.shape[1], device=rest.device) % 2)[:, None].to(rest)
    slopes = torch.stack((slope_x.flatten(1), slope_y.flatten(1)), 1)
    score = (slopes @ (sign * rest).flatten(1)[..., None])[..., 0].double()
    normal = (slopes @ slopes.mT).double() + 1e-6 * torch.eye(2, dtype=torch.float64, device=slopes.device)
    shift = torch.linalg.solve_ex(normal, score)[0]
    power = rest.square().mean((1, 2)).double()
    # Without texture the rows' noise alone would make a shift.
    noise = (power[:, None] * torch.linalg.inv_ex(normal)[0].diagonal(dim1=1, dim2=2)).sqrt()
    explained = (shift * score).sum(-1, keepdim=True) > EXPLAINED * power[:, None] * rest[0].numel()
    return torch.where((shift.abs() > SIGNIFICANT * noise) & explained, shift, 0.0)


def is_interlaced(crops: Crops) -> bool:
    """Whether most of the crops show the ball at two instants."""
    shift = field_shift(crops.images[:: max(1, len(crops.images) // LOOKED_AT)]).abs()
    apart = (shift > torch.tensor(MIN_SHIFT_PX).to(shift)).any(-1)
    return bool(apart.double().mean() > MIN_SHARE)


def one_field(crops: Crops) -> Crops:
    """The crops with the odd rows of the image interpolated from the even ones."""
    images = crops.images.clone()
    between = _between(images)
    odd = (crops.origin[:, 1].long()[:, None] + torch.arange(images.shape[1])) % 2 == 1
    odd = odd.to(images.device)[:, 3:-3, None]
    images[:, 3:-3] = torch.where(odd, between, images[:, 3:-3])
    return dataclasses.replace(crops, images=images)


def _between(images: Tensor) -> Tensor:
    """What the rows next to each row let expect of it, (n, h - 6, w)."""
    first, second, third, last = MIDWAY
    height = images.shape[1]
    rows = [images[:, 3 + step : height - 3 + step] for step in (-3, -1, 1, 3)]
    return first * rows[0] + second * rows[1] + third * rows[2] + last * rows[3]
