"""How likely poses are under a contact interval and intensities of the process: a Kalman filter per degree of freedom.

The search for the contact runs thousands of these small filters at once (`torchsphere.estimation.innovations`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchsphere.estimation.filter_bank import Array
from torchsphere.estimation.innovations import Recordings

#: Observations that the stated noise counts as: it is believed to some 15 %, and corrected where the data insist.
STATED_COUNTS = 20.0

#: Filters that are run at once: as many as stay near the processor; and of one interval.
AT_ONCE, IN_A_ROW = 8192, 1024


@dataclass(frozen=True)
class Series:
    """Poses of k degrees of freedom of n recordings, in units of their noise.

    Attributes
    ----------
    times : Tensor
        (n, t), frames, rising.
    value : Tensor
        (n, k, t); read where ``seen``.
    variance : Tensor
        Of the error of each value (n, k, t).
    drift : Tensor
        Variance (n, k, t - 1) of the errors that do not vanish with the next frame but stay in all later values.
    seen : Tensor
        (n, k, t), bool.
    """

    times: Tensor
    value: Tensor
    variance: Tensor
    drift: Tensor
    seen: Tensor

    def repeated(self, count: int) -> Series:
        """Each recording ``count`` times, one after the other."""
        return Series(*(getattr(self, f.name).repeat_interleave(count, 0) for f in dataclasses.fields(self)))

    def rows(self, which: slice | Tensor) -> Series:
        """Some of the recordings."""
        return Series(*(getattr(self, f.name)[which] for f in dataclasses.fields(self)))

    def arrays(self) -> tuple[Array, ...]:
        """Times, value, variance, drift and what was seen, as NumPy arrays."""
        return tuple(getattr(self, f.name).cpu().numpy() for f in dataclasses.fields(self))

    def between(self, start: int, stop: int, every: int = 1) -> Series:
        """Every so many-th of the frames ``start`` to ``stop - 1``; what drifts meanwhile is added up."""
        part = slice(start, stop, every)
        total = torch.nn.functional.pad(self.drift.cumsum(-1), (1, 0))[..., part]
        return Series(
            times=self.times[:, part],
            value=self.value[..., part],
            variance=self.variance[..., part],
            drift=total.diff(dim=-1),
            seen=self.seen[..., part],
        )


def log_likelihood(
    series: Series,
    windows: Tensor,
    flight: Tensor,
    contact: Tensor,
    smooth: Tensor | None = None,
    springs: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """Logarithm of the likelihood, up to a constant, and factor on the noise's standard deviation, (n, k, c, m) both.

    Parameters
    ----------
    series : Series
    windows : Tensor
        Contact intervals (n, c, 2), frames.
    flight, contact : Tensor
        Powers of ten of m intensities each, (n, k, c, m) or (n, k, 1, m).
    smooth : Tensor, optional
        (m,), whether the contact's intensity is that of the smooth process. By default none is.
    springs : Tensor, optional
        Those of the smooth process, (n, c); by default none.

    Notes
    -----
    The factor on the variance is integrated out, with an inverse gamma distribution of `STATED_COUNTS` before the data:
    what remains of innovations ``e`` with variances ``s`` is Student's distribution of them all.
    """
    n, k, _ = series.value.shape
    c, m = windows.shape[1], max(flight.shape[-1], contact.shape[-1])
    # A contact of no intensity is none: exactly so, lest rounding tells two processes that do nothing from each other.
    windows = torch.where((contact > -math.inf).flatten(1).any(1)[:, None, None], windows, 0.0)
    powers = [v.expand(n, k, v.shape[2], m).cpu().numpy() for v in (flight, contact)]
    size = math.ceil(m / math.ceil(k * m / IN_A_ROW))
    is_smooth = np.zeros(m, dtype=bool) if smooth is None else smooth.cpu().numpy()
    every = np.zeros((n, c)) if springs is None else springs.cpu().numpy()
    logs, squares = np.empty((2, n, k, c, m))
    for rows in _together(series, windows, max(1, AT_ONCE // (c * k * size))):
        some = Recordings.of(series.rows(rows).arrays(), windows[rows].cpu().numpy())
        own = [10.0 ** v[rows.numpy()] for v in powers]
        for kind in np.unique(is_smooth):
            columns = np.flatnonzero(is_smooth == kind)
            for part in np.array_split(columns, math.ceil(len(columns) / size)):
                spring = every[rows.numpy()] if kind else None
                sums = some.sums(own[0][..., part], own[1][..., part], spring, AT_ONCE)
                place = np.ix_(rows.numpy(), np.arange(k), np.arange(c), part)
                logs[place], squares[place] = sums
    counts = STATED_COUNTS + series.seen.sum(-1).cpu().numpy()[:, :, None, None]
    scale = (STATED_COUNTS + squares) / counts
    fit = -0.5 * (logs + counts * np.log(scale))
    return torch.from_numpy(fit).to(flight), torch.from_numpy(np.sqrt(scale)).to(flight)


def _together(series: Series, windows: Tensor, at_once: int) -> Iterator[Tensor]:
    """Numbers of recordings with the same times, so many at once: those with a contact, then those without."""
    if not (series.times == series.times[:1]).all():
        at_once = 1
    touching = (windows[..., 1] > windows[..., 0]).any(1)
    for which in (touching.cpu(), ~touching.cpu()):
        yield from (part for part in which.nonzero()[:, 0].split(at_once) if len(part))
