"""Correlate pairs that turn fast in both directions and take the mean.

Errors of even order in the rotation have the same sign from f to g and from g to f, and cancel in the mean. Errors from
the changing view of the texture are alike both ways, and stay (`torchsphere.tracking.steady_error`).
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import torch
from torch import Tensor

from torchsphere.correlation.options import Options
from torchsphere.correlation.reference import Pairs
from torchsphere.correlation.result import Correlation
from torchsphere.correlation.solve import solve

#: Least turn per pair that is measured both ways, rad (docs/constants.md).
MIN_TWO_WAY_TURN = math.radians(1.0)

#: Largest difference of both ways at the ball's front, share of the radius (docs/constants.md).
MAX_DISAGREEMENT = 0.05

#: Largest difference of both ways in the translation alone, share of the radius (docs/constants.md).
MAX_SHIFT_DISAGREEMENT = 0.1


def solve_both_ways(pairs: Pairs, targets: Tensor, found: Correlation, options: Options) -> Correlation:
    """``found`` (f to g), with the mean of both directions in the rows that turn by `MIN_TWO_WAY_TURN` or more.

    ``targets`` (n, 3): circles of the ball in the deformed images. A row whose way back fails takes its status; a row
    whose ways disagree has not converged.
    """
    turn = found.q[:, 2:].norm(dim=-1)
    chosen = torch.nonzero(turn >= MIN_TWO_WAY_TURN)[:, 0]
    if len(chosen) == 0:
        return found
    forth = found.q[chosen]
    rows = chosen.cpu()
    some = pairs.take(chosen)
    back = solve(Pairs(some.g, some.f, targets[rows]), -forth, options)
    dx, dy, wx, wy, wz = (forth + back.q).unbind(-1)
    radius = some.circles[:, 2].to(dx)
    # The motion of the ball's front is known better than translation or rotation alone.
    front = torch.stack((dx - radius * wy, dy + radius * wx, radius * wz), -1).norm(dim=-1)
    # A way back that failed is NaN: the comparison is False, and its own status is kept.
    disagree = (front > MAX_DISAGREEMENT * radius) | (torch.hypot(dx, dy) > MAX_SHIFT_DISAGREEMENT * radius)
    status = found.status.copy()
    status[rows.numpy()] = np.where(disagree.cpu().numpy(), "not_converged", back.status)
    good = torch.from_numpy(status[rows.numpy()] == "ok").to(forth.device)
    q, covariance, zncc, growth = (v.clone() for v in (found.q, found.covariance, found.zncc, found.growth))
    q[chosen] = torch.where(good[:, None], (forth - back.q) / 2, torch.nan)
    covariance[chosen] = torch.where(good[:, None, None], covariance[chosen], torch.nan)
    zncc[chosen] = torch.minimum(zncc[chosen], back.zncc)
    growth[chosen] = torch.where(good, (growth[chosen] - back.growth) / 2, torch.nan)
    return dataclasses.replace(found, q=q, covariance=covariance, zncc=zncc, growth=growth, status=status)
