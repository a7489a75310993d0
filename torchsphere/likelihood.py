"""How likely poses are under a contact interval and intensities of the process: a Kalman filter per degree of freedom.

The search for the contact runs thousands of these small filters at once. Each is written out in the ten different
entries of its covariance, one array of all filters per entry: measured 4 times faster than products of small matrices.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from torchsphere.process import STATES, STEADY, Transitions, transitions

#: Variance of what is not known beforehand, in units of the noise's: less would matter, more would cost digits.
UNKNOWN = 1e8

#: Observations that the stated noise counts as: it is believed to some 15 %, and corrected where the data insist.
STATED_COUNTS = 20.0

#: Rows and columns of the different entries of a symmetric 4 x 4 matrix, row by row.
ROWS, COLUMNS = (0, 0, 0, 0, 1, 1, 1, 2, 2, 3), (0, 1, 2, 3, 1, 2, 3, 2, 3, 3)


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


def log_likelihood(series: Series, windows: Tensor, flight: Tensor, contact: Tensor) -> tuple[Tensor, Tensor]:
    """Logarithm of the likelihood, up to a constant, and factor on the noise's standard deviation, (n, k, c, m) both.

    Parameters
    ----------
    series : Series
    windows : Tensor
        Contact intervals (n, c, 2), frames.
    flight, contact : Tensor
        Powers of ten of m intensities each, (n, k, c, m) or (n, k, 1, m).

    Notes
    -----
    The factor on the variance is integrated out, with an inverse gamma distribution of `STATED_COUNTS` before the data:
    what remains of innovations ``e`` with variances ``s`` is Student's distribution of them all.
    """
    n, k, t = series.value.shape
    c, m = windows.shape[1], max(flight.shape[-1], contact.shape[-1])
    steps = _Steps.of(transitions(series.times, windows))

    def arranged(values: Tensor) -> Tensor:
        return values.expand(n, k, c, m).permute(0, 2, 1, 3).reshape(n * c, k * m)

    q_flight, q_contact = 10.0 ** arranged(flight), 10.0 ** arranged(contact)
    # (t, n c, k, 1): the same for all m, which the sums below spread out.
    seen, variance, value, drift = (
        v.permute(2, 0, 1).to(q_flight).repeat_interleave(c, 1).repeat_interleave(m, 2)
        for v in (series.seen, series.variance, series.value, series.drift)
    )
    mean = [torch.zeros_like(q_flight) for _ in range(STATES)]
    # What is not seen has no weight; the jerk in flight means nothing and may have any variance.
    start = torch.diag(torch.tensor([UNKNOWN] * STEADY + [1.0] * (STATES - STEADY)))
    spread = [torch.full_like(q_flight, float(start[i, j])) for i, j in zip(ROWS, COLUMNS, strict=True)]
    squares, logs = torch.zeros_like(q_flight), torch.zeros_like(q_flight)
    for i in range(t):
        if i:
            mean, spread = steps.moved(i - 1, mean, spread, q_flight, q_contact)
            spread[0] += drift[i - 1]
        total = spread[0] + variance[i]
        off = value[i] - mean[0]
        share = seen[i] / total
        squares.addcmul_(share * off, off)
        logs.addcmul_(seen[i], total.log_())
        gain = [entry * share for entry in spread[:STATES]]
        mean = [torch.addcmul(state, part, off) for state, part in zip(mean, gain, strict=True)]
        first = spread[:STATES]
        spread = [
            torch.addcmul(entry, gain[a], first[b], value=-1) for entry, a, b in zip(spread, ROWS, COLUMNS, strict=True)
        ]
    counts = seen.sum(0)
    scale = (STATED_COUNTS + squares) / (STATED_COUNTS + counts)
    fit = -0.5 * (logs + (STATED_COUNTS + counts) * scale.log())

    def back(values: Tensor) -> Tensor:
        return values.reshape(n, c, k, m).permute(0, 2, 1, 3)

    return back(fit), back(scale.sqrt())


@dataclass(frozen=True)
class _Steps:
    """Transitions of b = n c rows, entry by entry: each (t - 1, b, 1).

    Attributes
    ----------
    matrix : list of Tensor
        Entries of the upper triangle of the state's matrix, in the order of `ROWS`; the first three on its diagonal
        are 1.
    contact, flight : list of Tensor
        Entries of the added covariances; those of flight are 0 beyond the first three states.
    idle : Tensor
        Variance that the jerk gets where it means nothing.
    touching : list of bool
        Whether any row is in contact between frame i and the next.
    """

    matrix: list[Tensor]
    contact: list[Tensor]
    flight: list[Tensor]
    idle: Tensor
    touching: list[bool]

    @classmethod
    def of(cls, moves: Transitions) -> _Steps:
        """The same, entry by entry."""

        def entries(matrices: Tensor) -> list[Tensor]:
            return [
                matrices[..., i, j].flatten(0, 1).T[..., None].contiguous() for i, j in zip(ROWS, COLUMNS, strict=True)
            ]

        n, c = moves.idle.shape[:2]
        flight = moves.flight.expand(n, c, *moves.flight.shape[2:])
        touching = (moves.contact != 0).flatten(3).any(-1).any(1).any(0)
        idle = moves.idle.flatten(0, 1).T[..., None].to(moves.matrix)
        return cls(entries(moves.matrix), entries(moves.contact), entries(flight), idle, touching.tolist())

    def moved(
        self, i: int, x: list[Tensor], p: list[Tensor], q_flight: Tensor, q_contact: Tensor
    ) -> tuple[list[Tensor], list[Tensor]]:
        """Mean (4 of (b, r)) and covariance (10 of them) after the transition from frame ``i``: F x, F P F^T + Q."""
        if not self.touching[i]:
            return self._flown(i, x, p, q_flight)
        _, a, b, d, _, e, f, _, g, h = (entry[i] for entry in self.matrix)
        plus = torch.addcmul
        mean = [
            plus(plus(plus(x[0], a, x[1]), b, x[2]), d, x[3]),
            plus(plus(x[1], e, x[2]), f, x[3]),
            plus(x[2], g, x[3]),
            h * x[3],
        ]
        p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = p
        # F P, its upper triangle.
        s00 = plus(plus(plus(p00, a, p01), b, p02), d, p03)
        s01 = plus(plus(plus(p01, a, p11), b, p12), d, p13)
        s02 = plus(plus(plus(p02, a, p12), b, p22), d, p23)
        s03 = plus(plus(plus(p03, a, p13), b, p23), d, p33)
        s11 = plus(plus(p11, e, p12), f, p13)
        s12 = plus(plus(p12, e, p22), f, p23)
        s13 = plus(plus(p13, e, p23), f, p33)
        s22, s23 = plus(p22, g, p23), plus(p23, g, p33)
        spread = [
            plus(plus(plus(s00, a, s01), b, s02), d, s03),
            plus(plus(s01, e, s02), f, s03),
            plus(s02, g, s03),
            h * s03,
            plus(plus(s11, e, s12), f, s13),
            plus(s12, g, s13),
            h * s13,
            plus(s22, g, s23),
            h * s23,
            h * h * p33 + self.idle[i],
        ]
        for number, entry in enumerate(spread):
            if ROWS[number] < STEADY and COLUMNS[number] < STEADY:
                entry.addcmul_(q_flight, self.flight[number][i])
            entry.addcmul_(q_contact, self.contact[number][i])
        return mean, spread

    def _flown(self, i: int, x: list[Tensor], p: list[Tensor], q_flight: Tensor) -> tuple[list[Tensor], list[Tensor]]:
        """`moved` where all rows are in flight, without the jerk: half of the work."""
        a, b, e = (self.matrix[number][i] for number in (1, 2, 5))
        plus = torch.addcmul
        p00, p01, p02, _, p11, p12, _, p22, _, _ = p
        s01, s02 = plus(plus(p01, a, p11), b, p12), plus(plus(p02, a, p12), b, p22)
        s00, s11, s12 = plus(plus(p00, a, p01), b, p02), plus(p11, e, p12), plus(p12, e, p22)
        steady = [plus(plus(s00, a, s01), b, s02), plus(s01, e, s02), s02, plus(s11, e, s12), s12, p22]
        added = (self.flight[number][i] for number in (0, 1, 2, 4, 5, 7))
        r00, r01, r02, r11, r12, r22 = (plus(entry, q_flight, q) for entry, q in zip(steady, added, strict=True))
        none, idle = torch.zeros_like(x[0]), self.idle[i].expand_as(x[0])
        mean = [plus(plus(x[0], a, x[1]), b, x[2]), plus(x[1], e, x[2]), x[2], none]
        return mean, [r00, r01, r02, none, r11, r12, none, r22, none, idle]
