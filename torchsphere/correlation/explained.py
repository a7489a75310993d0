"""The parts of the ball that a motion explains: a pair may follow only what the pair before followed.

A still plate in front of the ball matches with no motion at all as well as the ball matches with its own. A part of
the image counts as explained where its texture is the same after the motion. Parts without texture count as
unexplained, as they match any motion.
"""

from __future__ import annotations

import torch
from torch import Tensor

from torchsphere.correlation.occlusion import FIRST_ZNCC
from torchsphere.correlation.reference import Reference
from torchsphere.correlation.residual_noise import local_zncc
from torchsphere.correlation.result import CELLS
from torchsphere.geometry import motion_models, rotation
from torchsphere.geometry.motion_models import Displacement

#: Least correlation coefficient of an explained point, as a share of the median (docs/constants.toml).
TYPICAL_SHARE = 0.9

#: Least share of the explained parts of two pairs that must be the same (docs/constants.toml).
MIN_COMMON_SHARE = 0.5


def explained_cells(reference: Reference, warped: Tensor, seen: Tensor, q: Tensor, model: Displacement) -> Tensor:
    """Share (n, 2, c, c) of each cell that the motion ``q`` (n, k) explains, before and after the motion.

    ``warped`` (n, p) is the deformed image at the displaced points, ``seen`` (n, p) their weights in sight.
    """
    counted = (seen > 0).to(warped)
    shape = local_zncc(reference, warped, seen)
    alike = (counted > 0) & (shape > FIRST_ZNCC)
    # Half a speckle beside its place, the texture has about that coefficient, too.
    typical = torch.where(alike, shape, torch.nan).nanmedian(-1, keepdim=True).values
    alike = (alike & (shape > TYPICAL_SHARE * typical)).to(warped)
    if model in motion_models.CLOSED_FORM:
        after = rotation.moved(q, reference.surface, exact=model is motion_models.finite)[:, :2].mT
    else:
        moved = reference.points + motion_models.displacement(model, q, reference.points, reference.geometry)
        after = moved - q[:, None, :2]
    places = (reference.points, after.nan_to_num(0.0))
    return torch.stack([_shares(at, reference.geometry.radius, alike, counted) for at in places], 1)


def _shares(points: Tensor, radius: Tensor, alike: Tensor, counted: Tensor) -> Tensor:
    """Share (n, c, c) of the ``counted`` ``points`` (n, p, 2) in each cell that are ``alike``; 0 without a point."""
    at = ((points / radius[:, None, None] + 1) * (CELLS / 2)).long().clamp(0, CELLS - 1)
    cell = at[..., 1] * CELLS + at[..., 0]
    total = torch.zeros(len(points), CELLS * CELLS).to(alike)
    shares = total.scatter_add(1, cell, alike) / total.scatter_add(1, cell, counted).clamp_min(1)
    return shares.unflatten(1, (CELLS, CELLS))


def is_same_part(after: Tensor, before: Tensor) -> Tensor:
    """True (n,) where two pairs follow the same part of the image that they share.

    ``after`` (n, c, c): cells that the first pair explains, in its deformed image; ``before`` (n, c, c): those of the
    second pair, in its reference image.
    """
    smaller = torch.minimum(after.sum((1, 2)), before.sum((1, 2)))
    return torch.minimum(after, before).sum((1, 2)) >= MIN_COMMON_SHARE * smaller
