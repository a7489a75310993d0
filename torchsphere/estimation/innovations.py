"""Innovations of the many filters that contact intervals and intensities need, with each done but once.

Before any contact begins the filters of one intensity in flight are the same, and are run as one. Behind the last
contact, what the frames say of the state there depends on the intensity in flight alone: it is found once for each, as
three measurements of combinations of the state, and taken in by all filters. With 32 intervals and 80 intensities the
flights of 500 frames so cost a tenth. The three come from the innovations of a filter that starts with a known state,
and what they change with that state, by orthogonal transformations: differences of sums of squares would lose digits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchsphere.estimation.filter_bank import (
    Array,
    Bank,
    Step,
    Sums,
    Values,
    exact,
    matrices,
    operators,
    part,
    unknown,
)
from torchsphere.estimation.process_model import (
    ROUGH,
    STATES,
    STEADY,
    Passages,
    integrator,
    steady,
    touches,
    white_noise,
)

#: Frames behind the last contact after which the state is known to some errors of measurement, whatever it was before.
#: Where more is open, what all later frames say of it cannot be taken in at once without loss of digits.
SETTLED = 8

#: Frames behind those from which on it pays to sum them up once for all filters.
WORTH_SUMMING = 8


@dataclass(frozen=True)
class Recordings:
    """n recordings with the same times, and c contact intervals for each.

    Attributes
    ----------
    times : ndarray
        (t,), frames.
    windows : ndarray
        (n, c, 2), frames.
    touching : ndarray
        (t - 1,), whether there is any contact between a frame and the next.
    value : ndarray
        (t, n, k).
    values : Values
        Of columns (n, k).
    free : dict
        Operators of flight (t - 1, rows, rows + 1) for one value, and for one and those of exactly known states.
    """

    times: Array
    windows: Array
    touching: NDArray[np.bool_]
    value: Array
    values: Values
    free: dict[int, Array]

    @classmethod
    def of(cls, series: tuple[Array, ...], windows: Array) -> Recordings:
        """From the arrays of `torchsphere.estimation.likelihood.Series`."""
        times, value, variance, drift, seen = series
        duration = np.diff(times[0])
        matrix, noise = (v[:, :STEADY, :STEADY] for v in (integrator(duration), white_noise(duration, STEADY)))
        value, variance, seen, drift = (np.moveaxis(v, -1, 0) for v in (value, variance, seen, drift))
        value = np.where(seen, value, 0.0)
        step = np.zeros((len(value), 2, *value.shape[1:]))
        step[1:, 0], step[1:, 1] = drift, np.diff(value, axis=0)
        return cls(
            times=times[0],
            windows=windows,
            touching=np.asarray(touches(times, windows).any((0, 1))),
            value=value,
            values=Values(variance, step, seen.astype(np.float64)),
            free={e: operators(matrix, [noise], e) for e in (1, 1 + STEADY)},
        )

    def sums(self, flight: Array, contact: Array, springs: Array | None, at_once: int) -> tuple[Array, Array]:
        """Sums of the innovations' logarithms and squares (n, k, c, m), for m intensities (n, k, c or 1, m) each.

        ``springs`` (n, c) are those of the smooth process, None of the rough one; ``at_once`` filters are run at once.
        """
        n, k, _, m = flight.shape
        c, t = self.windows.shape[1], len(self.times)
        quiet, which = np.unique(flight.reshape(n * k, -1), axis=1, return_inverse=True)
        which = np.broadcast_to(which.reshape(-1, m), (c, m))

        def arranged(found: Array, rows: Array) -> Array:
            return _arranged(found.reshape(*found.shape[:-1], k, -1), rows // c, which[rows % c])

        touched = np.flatnonzero(self.touching)
        first, last = (int(touched[0]), int(touched[-1]) + 1) if len(touched) else (t - 1, t - 1)
        flights = quiet.reshape(n, -1)
        start, before = self._before(flights, first)
        settled = self._settled(last)
        is_worth = t - 1 - settled >= WORTH_SUMMING and 4 * quiet.shape[1] <= c * m
        behind = self._behind(flights, settled) if is_worth else None
        logs, squares = np.empty((2, n * c, k * m))
        contact = np.broadcast_to(contact, (n, k, c, m)).swapaxes(1, 2).reshape(n * c, k * m)
        for rows in np.array_split(np.arange(n * c), math.ceil(n * c * k * m / at_once)):
            sums = Sums(arranged(before.logs, rows), arranged(before.squares, rows))
            own = np.stack((arranged(flights, rows), contact[rows]))
            bank = Bank(own)
            bank.start(STEADY, arranged(start, rows))
            values = self.values.frames(first + 1, t).spread(m, rows // c if n > 1 else [0])
            steps = self._touched(first, last, rows, None if springs is None else springs.reshape(1, -1)[:, rows])
            steps += [(STEADY, operator) for operator in self.free[1][last : settled if is_worth else t]]
            bank.run(steps, values, sums)
            if behind is not None:
                near, said, logs_behind = (arranged(v, rows) for v in behind)
                _take_in(bank.state, near, said, sums)
                sums.logs += logs_behind
            logs[rows], squares[rows] = sums.logs, sums.squares
        return logs.reshape(n, c, k, m).swapaxes(1, 2), squares.reshape(n, c, k, m).swapaxes(1, 2)

    def _before(self, flights: Array, first: int) -> tuple[Array, Sums]:
        """Filters of each intensity of ``flights`` (n, k u) up to frame ``first``: their states and sums."""
        values = self.values.frames(0, first + 1).spread(flights.shape[1] // self.value.shape[-1])
        value = np.repeat(self.value[0], flights.shape[1] // self.value.shape[-1], -1)
        bank, sums = Bank(flights[None]), Sums.none(flights.shape)
        bank.start(STEADY, unknown(STEADY, value))
        bank.run([(STEADY, None), *((STEADY, operator) for operator in self.free[1][:first])], values, sums)
        return bank.state[:-1], sums

    def _settled(self, last: int) -> int:
        """Frame from which on what frame ``last`` has left open of a state is known from others that were seen."""
        seen = self.values.weight[last + 1 :].cumsum(0)
        if not len(seen):
            return last
        return last + 1 + int((seen >= np.minimum(seen[-1], SETTLED)).all((1, 2)).argmax())

    def _behind(self, flights: Array, last: int) -> tuple[Array, Array, Array]:
        """What the frames after ``last`` say of the state there: a mean near it, measurements, and their logarithms.

        Of the measurements (4, 4, n, k u) each row says that its first three numbers times what the mean differs from
        the one that is near (3, n, k u), plus its last number, is an error of variance 1; the last row, what is left.
        """
        u = flights.shape[1] // self.value.shape[-1]
        values = self.values.frames(last + 1, len(self.times))
        # From a rate near the true one differences stay small, and keep their digits.
        after = (self.times[last + 1 :] - self.times[last])[:, None, None]
        rate = ((self.value[last + 1 :] - self.value[last]) * after * values.weight).sum(0)
        rate /= np.maximum((after**2 * values.weight).sum(0), 1e-300)
        bank = Bank(flights[None], 1 + STEADY)
        kept: list[Array] = []
        sums = Sums.none(flights.shape, kept)
        near = np.stack((0 * rate, -rate, 0 * rate)).repeat(u, -1)
        bank.start(STEADY, exact(STEADY, near))
        bank.run([(STEADY, operator) for operator in self.free[1 + STEADY][last:]], values.spread(u), sums)
        whitened = np.concatenate(kept)[:, [1, 2, 3, 0]]
        said = np.linalg.qr(np.moveaxis(whitened, (0, 1), (-2, -1)), mode="r")
        return near, np.moveaxis(np.asarray(said), (-2, -1), (0, 1)), sums.logs

    def _touched(self, first: int, last: int, rows: Array, springs: Array | None) -> list[Step]:
        """States after each transition from ``first`` to ``last - 1``, and operators, for some rows' intervals."""
        if first == last:
            return []
        times = self.times[first : last + 1]
        passages = Passages.of(times[None], self.windows.reshape(1, -1, 2)[:, rows], springs)
        duration = np.diff(times)
        most = ROUGH if springs is None else STATES
        flight = white_noise(duration, STEADY)
        intervals, frames = passages.edges[0].nonzero()

        def made(matrix: Array, added: list[Array]) -> Array:
            return operators(matrix[..., :most, :most], [v[..., :most, :most] for v in added])

        # Most places are in flight, or within the contact throughout: one operator per frame each, for all rows, or
        # one per row for all frames. Only frames in which some contact begins or ends need one for each of both.
        free = made(steady(duration), [flight, np.zeros_like(flight)])
        inside, within = (v[0].swapaxes(0, 1) for v in (passages.inside, passages.within))
        both = np.broadcast_arrays(inside, within, flight[: len(inside), None])
        inside = made(both[0], [both[2], both[1]])
        at_edges = made(passages.matrix, [flight[frames], passages.contact])
        own = self.touching[first:last]
        sizes = np.where(own, most, STEADY)
        before = np.minimum(sizes, np.append(STEADY, sizes[:-1]))
        after = np.minimum(sizes, np.append(sizes[1:], STEADY))
        found: list[Step] = [(STEADY, operator) for operator in self.free[1][first:last]]
        for i in np.flatnonzero(own):
            whole, here = passages.whole[0, :, i], frames == i
            operator = inside[i if len(inside) > 1 else 0]
            if not whole.all():
                operator = np.where(whole[:, None, None], operator, free[i])
                operator[intervals[here]] = at_edges[here]
            found[i] = (int(after[i]), part(operator, most, int(after[i]), int(before[i])))
        return found


def _arranged(found: Array, recordings: Array, which: Array) -> Array:
    """Of columns (..., n, k, u) those of b rows (..., b, k m): their recordings (b,), and which m of the u (b, m)."""
    k = found.shape[-2]
    each = found[..., recordings[:, None, None], np.arange(k)[:, None], which[:, None]]
    return each.reshape(*each.shape[:-2], -1)


def _take_in(state: Array, near: Array, said: Array, sums: Sums) -> None:
    """Add to ``sums`` what the frames behind the last contact (see `Recordings`) bring."""
    spread, mean = matrices(state, STEADY)
    mean = mean - near
    for i in reversed(range(STEADY)):
        given = said[i, :STEADY]
        off = said[i, STEADY] + (given * mean).sum(0)
        ahead = (spread * given).sum(1)
        total = 1.0 + (given * ahead).sum(0)
        sums.logs += np.log(total)
        sums.squares += off**2 / total
        gain = ahead / total
        mean -= gain * off
        # A sum of squares, for the difference would be all rounding.
        spread -= gain[:, None] * ahead
        spread -= (spread * given).sum(1)[:, None] * gain
        spread += gain[:, None] * gain
    sums.squares += said[STEADY, STEADY] ** 2
