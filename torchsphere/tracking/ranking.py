"""Choose among first guesses of one pair: each is refined on small images, and the best are kept."""

from __future__ import annotations

import dataclasses

import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from torch import Tensor

from torchsphere.correlation.correlate import correlate_pairs
from torchsphere.correlation.options import Options

#: Radius that the images are reduced to, px.
SMALL_RADIUS_PX = 25.0

#: Steps and tolerance, px, on the small images, and the coefficient below which a guess leads nowhere: low, because a
#: part of the ball may be hidden.
STEPS, TOLERANCE_PX, LEAST_ZNCC = 20, 0.01, 0.2


def ranked(
    pair: Tensor, centre: Tensor, radius: float, starts: Tensor, ignore: Tensor | None, options: Options
) -> Tensor:
    """First guesses (m, 5), refined, the best first; those that lead nowhere are left out.

    Parameters
    ----------
    pair : Tensor
        The two images (2, h, w).
    centre : Tensor
        Centre (2,) of the ball in the first, px, float64.
    radius : float
        Radius of the ball, px.
    starts : Tensor
        First guesses (k, 5) of the increment, px and rad, float64.
    ignore : Tensor, optional
        (h, w), True where the images are not to be used.
    options : Options
        Of the correlation that is to start from there.
    """
    factor = max(1, round(radius / SMALL_RADIUS_PX))
    unit = torch.tensor([factor, factor, 1, 1, 1], dtype=torch.float64)
    small = F.avg_pool2d(pair[:, None], factor)[:, 0]
    if ignore is not None:
        ignore = F.max_pool2d(ignore[None].to(pair.dtype), factor)[0] > 0
    # Pixel i of the small image is the mean of the pixels from i factor on.
    small_circle = torch.cat(((centre + 0.5) / factor - 0.5, torch.tensor([radius / factor], dtype=torch.float64)))
    f, g = (image.expand(len(starts), -1, -1) for image in small)
    coarse = dataclasses.replace(
        options,
        robust=False,
        max_iterations=STEPS,
        tolerance_px=TOLERANCE_PX,
        min_zncc=LEAST_ZNCC,
        camera=None if options.camera is None else options.camera.reduced(factor),
    )
    guess = correlate_pairs(f, g, small_circle.expand(len(starts), 3), starts / unit, ignore, coarse)
    found = guess.q.isfinite().all(-1)
    order = torch.where(found, guess.zncc, -1.0).argsort(descending=True)
    return (guess.q[order].double().cpu() * unit)[: int(found.sum())]
