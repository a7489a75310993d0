"""Motion of correlated pairs: increments, covariances, and a status per pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation import frame_status

#: Fields of `Correlation` with a row per pair that are tensors.
_TENSORS = ("q", "covariance", "zncc", "iterations", "growth", "sd_growth", "uneven_light", "explained")

#: Cells along a side of the square around the ball in `Correlation.explained` (docs/constants.toml).
CELLS = 12


@dataclass(frozen=True)
class Correlation:
    """Motion of n pairs; rows that are not "ok" are NaN in `q` and `covariance`.

    Attributes
    ----------
    q : Tensor
        Increment (n, 5) as (dx, dy, wx, wy, wz): px and rad, camera frame.
    covariance : Tensor
        (n, 5, 5), in the units of `q`.
    zncc : Tensor
        Zero-mean normalised cross-correlation coefficient (n,) over the region of interest, at the last iterate.
    iterations : Tensor
        Gauss-Newton steps taken (n,).
    growth, sd_growth : Tensor
        Relative change (n,) of the ball's size in the image and its standard deviation; 0 with models without it, NaN
        like `q`.
    uneven_light : Tensor
        (n,), True where the criterion allowed for light that changes unevenly over the ball.
    explained : Tensor
        Share (n, 2, c, c) of each cell of the square around the ball that the motion explains, in ``f`` and in ``g``: 1
        everywhere unless a part of the ball does not fit.
    status : ndarray
        Strings (n,) out of `frame_status.STATUSES`; from `torchsphere.correlate` "lost" where a value near the ball is
        not finite.
    """

    q: Tensor
    covariance: Tensor
    zncc: Tensor
    iterations: Tensor
    growth: Tensor
    sd_growth: Tensor
    uneven_light: Tensor
    explained: Tensor
    status: NDArray[np.str_]

    @property
    def turn(self) -> Tensor:
        """Angle (n,) of the rotation, rad; NaN where it was not measured."""
        return self.q[:, 2:].norm(dim=-1)

    @classmethod
    def of(
        cls,
        q: Tensor,
        covariance: Tensor,
        zncc: Tensor,
        iterations: Tensor,
        status: Tensor,
        *,
        uneven_light: bool = False,
    ) -> Correlation:
        """The result of n pairs by the unknowns ``q`` (n, k) of a model, and their covariance (n, k, k).

        Rows whose ``status`` (n,) is not that of "ok" are NaN. So is the uncertainty of what a model does not measure.
        """
        good, k = status == 0, q.shape[-1]
        unknowns = torch.where(good[:, None], torch.cat((q, q.new_zeros(len(q), 6 - k)), -1), torch.nan)
        stated = covariance.new_full((len(q), 6, 6), torch.nan)
        stated[:, :k, :k] = torch.where(good[:, None, None], covariance, torch.nan)
        return cls(
            q=unknowns[:, :5],
            covariance=stated[:, :5, :5],
            zncc=zncc,
            iterations=iterations,
            growth=unknowns[:, 5],
            sd_growth=torch.where(good, stated[:, 5, 5].sqrt() if k == 6 else 0.0, torch.nan),
            uneven_light=torch.full_like(good, uneven_light),
            explained=torch.ones(len(q), 2, CELLS, CELLS).to(q),
            status=frame_status.words(status),
        )

    @classmethod
    def joined(cls, parts: Sequence[Correlation]) -> Correlation:
        """The rows of all parts, one after the other."""
        fields = {name: torch.cat([getattr(part, name) for part in parts]) for name in _TENSORS}
        return cls(status=np.concatenate([part.status for part in parts]), **fields)

    def replaced(self, rows: Tensor, other: Correlation) -> Correlation:
        """A copy with the ``rows`` (m,) of ``other``."""
        status = self.status.copy()
        status[rows.cpu().numpy()] = other.status
        merged = {name: getattr(self, name).index_copy(0, rows, getattr(other, name)) for name in _TENSORS}
        return Correlation(status=status, **merged)
