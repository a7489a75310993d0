"""Combinations of the degrees of freedom whose errors are independent: what the search for a contact is fed with.

The errors of a position and of the rotation that looks like its motion, x and wy, y and wx, are one to 95 % and more:
what moves the speckle may be either. The search takes each degree of freedom for independent of the others, so from
each the errors are taken that quieter ones show. Across the force, say, nothing moves but by its errors; they leave of
the errors of the rotation that looks like it a third. Without, chance that looks like a rough force did so twice.
Of half-sines of 14 frames the forces were right to 213 instead of 320 N at a noise of 7.5 um and to 67 instead of 136 N
at 1.5 um, with nothing else changed; by Hertz' law to 343 and 161 instead of 519 and 242 N, of triangles to 518 and 277
instead of 568 and 300 N, with bands that hold as many or more.
"""

from __future__ import annotations

import torch
from torch import Tensor

#: What keeps the equations solvable where two values' errors are one, of their variances.
RIDGE = 1e-9


def separation(covariance: Tensor, value: Tensor, times: Tensor, seen: Tensor) -> Tensor:
    """Matrix (n, k, k), 1 on its diagonal, whose products with the values have errors that are independent.

    Parameters
    ----------
    covariance : Tensor
        Of the errors (n, t, k, k).
    value : Tensor
        What was measured (n, t, k), in units of the errors.
    times : Tensor
        Of the frames (n, t).
    seen : Tensor
        Where (n, t, k), bool.

    Notes
    -----
    Gram and Schmidt's method with the mean covariance, from the value that changes least beside a straight line: of its
    motion the others get a share. What was not seen in all of a value's frames is no part of it.
    """
    order = _spread(value, times, seen).argsort(-1).argsort(-1)
    quieter = order[:, None] < order[:, :, None]
    always = (seen[..., None, :] | ~seen[..., None]).all(1) & seen.any(1)[..., None]
    # Of the frames of each: the covariances of all others.
    mean = torch.einsum("nti,ntjl->nijl", seen.to(covariance), covariance)
    mean = mean / seen.sum(1).clamp_min(1)[..., None, None]
    own = mean.diagonal(dim1=-2, dim2=-1)
    usable = (quieter & always & (own > 0)).to(covariance)
    # The others' covariances, with 1 for those that are left out.
    others = mean * usable[..., None] * usable[..., None, :] + torch.diag_embed(1.0 - usable + RIDGE * own)
    across = torch.stack([mean[:, i, i] for i in range(mean.shape[1])], 1)
    weights = torch.linalg.solve(others, (across * usable)[..., None])[..., 0]
    return torch.eye(value.shape[-1]).to(value) - weights


def _spread(value: Tensor, times: Tensor, seen: Tensor) -> Tensor:
    """Variance (n, k) about a straight line of what was seen: the likelihood knows of no line, either."""
    weight = seen.to(value)
    count = weight.sum(1, keepdim=True).clamp_min(1.0)
    value, time = (weight * (v - (weight * v).sum(1, keepdim=True) / count) for v in (value, times[..., None]))
    slope = (time * value).sum(1, keepdim=True) / time.square().sum(1, keepdim=True).clamp_min(1e-12)
    return (value - slope * time).square().sum(1) / count[:, 0]
