"""How likely poses are under a contact interval and intensities of the process: a Kalman filter per degree of freedom.

The search for the contact runs thousands of these small filters at once. Each is written out in the different entries
of its covariance, one array of all filters per entry: measured 4 times faster than products of small matrices.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from torchsphere.process import ROUGH, STATES, STEADY, Transitions, transitions

#: Variance of what is not known beforehand, in units of the noise's: less would matter, more would cost digits.
UNKNOWN = 1e8

#: Observations that the stated noise counts as: it is believed to some 15 %, and corrected where the data insist.
STATED_COUNTS = 20.0

#: Frames whose values are spread out over all filters at a time.
AT_ONCE = 64

#: The different entries of a symmetric matrix, by row and column.
Entries = dict[tuple[int, int], Tensor]


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

    def row(self, number: int) -> Series:
        """One recording alone."""
        return Series(*(getattr(self, f.name)[number : number + 1] for f in dataclasses.fields(self)))

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
    series: Series, windows: Tensor, flight: Tensor, contact: Tensor, smooth: Tensor | None = None
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
        (m,), whether the contact's intensity is that of the smooth process. By default none is, which is faster.

    Notes
    -----
    The factor on the variance is integrated out, with an inverse gamma distribution of `STATED_COUNTS` before the data:
    what remains of innovations ``e`` with variances ``s`` is Student's distribution of them all.
    """
    n, k, _ = series.value.shape
    c, m = windows.shape[1], max(flight.shape[-1], contact.shape[-1])
    states = ROUGH if smooth is None else STATES
    steps = _Steps.of(transitions(series.times, windows), states)

    def arranged(values: Tensor) -> Tensor:
        return values.expand(n, k, c, m).permute(0, 2, 1, 3).reshape(n * c, k * m)

    q_flight, q_contact = 10.0 ** arranged(flight), 10.0 ** arranged(contact)
    kinds = [q_contact]
    if smooth is not None:
        kinds = [torch.where(arranged(smooth == kind), q_contact, 0.0) for kind in (False, True)]
    seen, variance, value, drift = (
        _by_frame(v.to(q_flight), c, m) for v in (series.seen, series.variance, series.value, series.drift)
    )
    mean = [torch.zeros_like(q_flight) for _ in range(STEADY)]
    # What is not seen has no weight.
    spread = {(i, j): torch.full_like(q_flight, UNKNOWN if i == j else 0.0) for i, j in _pairs(STEADY)}
    squares, logs = torch.zeros_like(q_flight), torch.zeros_like(q_flight)
    for i, (visible, noise, measured) in enumerate(zip(seen, variance, value, strict=True)):
        if i:
            mean, spread = steps.moved(i - 1, mean, spread, q_flight, kinds)
            spread[0, 0] += next(drift)
        total = spread[0, 0] + noise
        off = measured - mean[0]
        share = visible / total
        squares.addcmul_(share * off, off)
        logs.addcmul_(visible, total.log_())
        first = [spread[0, j] for j in range(len(mean))]
        gain = [entry * share for entry in first]
        mean = [torch.addcmul(state, part, off) for state, part in zip(mean, gain, strict=True)]
        spread = {(a, b): torch.addcmul(entry, gain[a], first[b], value=-1) for (a, b), entry in spread.items()}
    counts = arranged(series.seen.sum(-1)[:, :, None, None].to(q_flight))
    scale = (STATED_COUNTS + squares) / (STATED_COUNTS + counts)
    fit = -0.5 * (logs + (STATED_COUNTS + counts) * scale.log())

    def back(values: Tensor) -> Tensor:
        return values.reshape(n, c, k, m).permute(0, 2, 1, 3)

    return back(fit), back(scale.sqrt())


def _by_frame(values: Tensor, c: int, m: int) -> Iterator[Tensor]:
    """Values (n, k, t) of each frame, (n c, k m): the same for all intervals and intensities.

    Spread out for some frames at a time: of 1000 all together were 0.4 GB.
    """
    for part in values.split(AT_ONCE, -1):
        yield from part.permute(2, 0, 1).repeat_interleave(c, 1).repeat_interleave(m, 2)


def _pairs(states: int) -> list[tuple[int, int]]:
    """Rows and columns of the different entries of a symmetric matrix."""
    return [(i, j) for i in range(states) for j in range(i, states)]


@dataclass(frozen=True)
class _Steps:
    """Transitions of b = n c rows, entry by entry: each (t - 1, b, 1).

    Attributes
    ----------
    matrix : dict
        Entries of the upper triangle of the state's matrix; the first three on its diagonal are 1.
    flight : dict
        Entries of the covariance that flight adds; they are 0 beyond the first three states.
    contact : list of dict
        Those that the rough process adds, and the smooth one.
    touching : list of bool
        Whether any row is in contact between frame i and the next.
    states : int
        How many there are in contact.
    """

    matrix: Entries
    flight: Entries
    contact: list[Entries]
    touching: list[bool]
    states: int

    @classmethod
    def of(cls, moves: Transitions, states: int) -> _Steps:
        """The same, entry by entry."""

        def entries(matrices: Tensor, size: int) -> Entries:
            return {(i, j): matrices[..., i, j].flatten(0, 1).T[..., None].contiguous() for i, j in _pairs(size)}

        n, c = moves.idle.shape[:2]
        return cls(
            matrix=entries(moves.matrix, states),
            flight=entries(moves.flight.expand(n, c, *moves.flight.shape[2:]), STEADY),
            contact=[entries(moves.rough, states), entries(moves.smooth, states)][: states - STEADY],
            touching=moves.touching,
            states=states,
        )

    def moved(
        self, i: int, x: list[Tensor], p: Entries, q_flight: Tensor, q_contact: list[Tensor]
    ) -> tuple[list[Tensor], Entries]:
        """Mean and covariance, each entry (b, r), after the transition from frame ``i``: F x and F P F^T + Q.

        Where all rows are in flight there are the first three states alone.
        """
        size = self.states if self.touching[i] else STEADY
        x, p = _resized(x, p, size)
        f = {pair: self.matrix[pair][i] for pair in _pairs(size)}
        mean = []
        for a in range(size):
            total = x[a] if a < STEADY else f[a, a] * x[a]
            for b in range(a + 1, size):
                total = torch.addcmul(total, f[a, b], x[b])
            mean.append(total)
        # F P, its upper triangle.
        half: Entries = {}
        for a, b in _pairs(size):
            total = p[a, b] if a < STEADY else f[a, a] * p[a, b]
            for c in range(a + 1, size):
                total = torch.addcmul(total, f[a, c], p[min(b, c), max(b, c)])
            half[a, b] = total
        spread: Entries = {}
        for a, b in _pairs(size):
            total = half[a, b] if b < STEADY else f[b, b] * half[a, b]
            for c in range(b + 1, size):
                total = torch.addcmul(total, f[b, c], half[a, c])
            if b < STEADY:
                total = torch.addcmul(total, q_flight, self.flight[a, b][i])
            if self.touching[i]:
                for q, added in zip(q_contact, self.contact, strict=True):
                    total = torch.addcmul(total, q, added[a, b][i])
            spread[a, b] = total
        return mean, spread


def _resized(x: list[Tensor], p: Entries, size: int) -> tuple[list[Tensor], Entries]:
    """Mean and covariance of ``size`` states: those of the contact are 0 before it and mean nothing after it."""
    if len(x) < size:
        none = torch.zeros_like(x[0])
        return x + [none] * (size - len(x)), {pair: p.get(pair, none) for pair in _pairs(size)}
    return x[:size], {pair: p[pair] for pair in _pairs(size)}
