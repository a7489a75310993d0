"""Measure a pair in both directions where the ball turns fast, and take the mean.

From f to g and from g to f the errors of even order in the rotation have the same sign and cancel in the mean, such as
the second order of a linearised rotation. Measured over 64 pairs at 4.5 deg per frame, region 0.95 R: `rigid` errs by
0.052 deg one way and by 0.0001 deg in the mean; with `finite` the scatter of all components falls by a tenth to a
quarter. What the changing view of the texture does to the match is alike both ways, and stays (`steady_error`).
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import torch
from torch import Tensor

from torchsphere.correlation.options import Options
from torchsphere.correlation.pairs import Pairs
from torchsphere.correlation.result import Correlation
from torchsphere.correlation.solve import solve

#: Rotation from which a pair is measured both ways, rad. Below, the mean changes nothing that noise does not hide.
MIN_TWO_WAY_TURN = math.radians(1.0)

#: Both ways must give one increment to this share of the radius, in px on the ball's front; otherwise one of them is
#: wrong. Measured over right pairs: 0.001 to 0.01, from 1 to 20 deg per frame.
MAX_DISAGREEMENT = 0.05

#: The same for the translation alone, of which a part passes for rotation where perspective or hidden parts disturb.
MAX_SHIFT_DISAGREEMENT = 0.1


def solve_both_ways(pairs: Pairs, there: Tensor, found: Correlation, options: Options) -> Correlation:
    """``found`` (f to g), with the mean of both directions in the rows that turn by `MIN_TWO_WAY_TURN` or more.

    ``there`` (n, 3): the ball in the deformed images. A row whose way back fails takes its status from there; one whose
    ways disagree has not converged.
    """
    turn = found.q[:, 2:].norm(dim=-1)
    chosen = torch.nonzero(turn >= MIN_TWO_WAY_TURN)[:, 0]
    if len(chosen) == 0:
        return found
    forth = found.q[chosen]
    here = chosen.cpu()
    some = pairs.take(chosen)
    back = solve(Pairs(some.g, some.f, there[here]), -forth, options)
    dx, dy, wx, wy, wz = (forth + back.q).unbind(-1)
    radius = some.circles[:, 2].to(dx)
    # How differently both ways move the front of the ball; translation and rotation alone are known less well.
    front = torch.stack((dx - radius * wy, dy + radius * wx, radius * wz), -1).norm(dim=-1)
    # A way back that failed is NaN, which is not apart: it keeps its own status.
    wrong = (front > MAX_DISAGREEMENT * radius) | (torch.hypot(dx, dy) > MAX_SHIFT_DISAGREEMENT * radius)
    apart = wrong.cpu().numpy()
    status = found.status.copy()
    status[here.numpy()] = np.where(apart, "not_converged", back.status)
    good = torch.from_numpy(status[here.numpy()] == "ok").to(forth.device)
    q, covariance, zncc = found.q.clone(), found.covariance.clone(), found.zncc.clone()
    q[chosen] = torch.where(good[:, None], (forth - back.q) / 2, torch.nan)
    covariance[chosen] = torch.where(good[:, None, None], covariance[chosen], torch.nan)
    zncc[chosen] = torch.minimum(zncc[chosen], back.zncc)
    growth = found.growth.clone()
    growth[chosen] = torch.where(good, (growth[chosen] - back.growth) / 2, torch.nan)
    return dataclasses.replace(found, q=q, covariance=covariance, zncc=zncc, growth=growth, status=status)
