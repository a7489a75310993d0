"""Likelihood of poses under contact intervals and process intensities, from the innovations of small Kalman filters.

The search for the contact runs thousands of filters, in a loop that shares what they have in common
(`kernels.filter_bank`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchsphere.estimation.force_forms import NAMES
from torchsphere.estimation.process_model import PRIOR_VARIANCE, step_tables
from torchsphere.kernels import filter_bank as loops
from torchsphere.kernels.jit import arrays

#: Observations that the stated noise counts as (docs/constants.toml).
STATED_COUNTS = 20.0

#: Frames seen after the last contact before the flight is shared by all filters (docs/constants.toml).
SETTLING_FRAMES = 8

#: Fewest frames of a flight that all filters share (docs/constants.toml).
MIN_SHARED_FRAMES = 8


class Series(NamedTuple):
    """Poses of k degrees of freedom of n recordings, in units of their noise."""

    times: Tensor  # (n, t), frames, rising
    value: Tensor  # (n, k, t), read where seen
    variance: Tensor  # variance of the error of each value (n, k, t)
    drift: Tensor  # variance (n, k, t - 1) of errors that stay in all later values
    seen: Tensor  # (n, k, t), bool

    def repeated(self, count: int) -> Series:
        """Each recording ``count`` times, next to each other."""
        return Series(*(values.repeat_interleave(count, 0) for values in self))

    def rows(self, which: slice | Tensor) -> Series:
        """Some of the recordings."""
        return Series(*(values[which] for values in self))

    def between(self, start: int, stop: int, every: int = 1) -> Series:
        """Every so many-th of the frames ``start`` to ``stop - 1``; drifts of frames left out are added up."""
        part = slice(start, stop, every)
        drift = torch.nn.functional.pad(self.drift.cumsum(-1), (1, 0))[..., part].diff(dim=-1)
        times, value, variance, seen = (v[..., part] for v in (self.times, self.value, self.variance, self.seen))
        return Series(times, value, variance, drift, seen)


def log_likelihood(
    series: Series, windows: Tensor, flight: Tensor, contact: Tensor, forms: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """Log-likelihood up to a constant, and factor on the standard deviation of the noise, both (n, k, c, m).

    ``windows`` (n, c, 2) are contact intervals, ``flight`` and ``contact`` (n, k, c or 1, m) powers of ten of m pairs
    of intensities. ``forms`` (n, c, 6) are those of the force, all 0 for the rough process; None if all are rough.

    The factor on the variance is integrated out, with an inverse gamma distribution of `STATED_COUNTS` as prior:
    innovations ``e`` of variances ``s`` then follow Student's distribution.
    """
    n, k, _ = series.value.shape
    c, m = windows.shape[1], max(flight.shape[-1], contact.shape[-1])
    # A contact without intensity is exactly no contact, so that rounding does not make two idle processes differ.
    windows = torch.where((contact > -math.inf).flatten(1).any(1)[:, None, None], windows, 0.0)
    forms = windows.new_zeros(n, c, len(NAMES)) if forms is None else forms
    intensities = [(10.0**v).expand(n, k, c, m) for v in (flight, contact)]
    given = loops.Hypotheses(*arrays(*(v.cpu() for v in (windows, forms, *intensities))))
    limits = loops.Limits(PRIOR_VARIANCE, SETTLING_FRAMES, MIN_SHARED_FRAMES)
    logs, squares = np.empty((n, k, c, m)), np.empty((n, k, c, m))
    loops.run(loops.Frames(*arrays(*(v.cpu() for v in series))), given, step_tables(), limits, logs, squares)
    counts = STATED_COUNTS + series.seen.sum(-1).cpu().numpy()[:, :, None, None]
    scale = (STATED_COUNTS + squares) / counts
    fit = -0.5 * (logs + counts * np.log(scale))
    return torch.from_numpy(fit).to(flight), torch.from_numpy(np.sqrt(scale)).to(flight)
