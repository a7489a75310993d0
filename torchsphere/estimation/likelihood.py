"""Likelihood of poses under contact intervals and process intensities, from the innovations of small Kalman filters.

The search for the contact runs thousands of filters, and shares what they have in common. Before the first contact the
filters of one intensity in flight are the same and run once. After the last contact the frames depend on the state
there and on the intensity in flight alone: for each intensity they are reduced to three linear measurements of that
state, which all filters use. With 32 intervals and 80 intensities this makes 500 frames of flight ten times as fast.
The reduction is an orthogonal transformation (QR) of the innovations and of their derivatives by the state, because
differences of sums of squares would lose digits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.estimation.filter_bank import (
    Array,
    Numbers,
    filtered,
    in_flight,
    known_states,
    unknown_states,
    unpacked,
)
from torchsphere.estimation.force_forms import NAMES
from torchsphere.estimation.process_model import (
    FLIGHT_STATES,
    ROUGH_STATES,
    STATES,
    integrator,
    overlaps,
    transitions,
)
from torchsphere.estimation.process_noise import flight_noise
from torchsphere.kernels.filter_bank import Observations, Steps

#: Observations that the stated noise counts as (docs/constants.toml).
STATED_COUNTS = 20.0

#: Filters that run at once (docs/constants.toml).
FILTERS_AT_ONCE = 8192

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
    series: Series,
    windows: Tensor,
    flight: Tensor,
    contact: Tensor,
    formed: Tensor | None = None,
    forms: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """Log-likelihood up to a constant, and factor on the standard deviation of the noise, both (n, k, c, m).

    ``windows`` (n, c, 2) are contact intervals, ``flight`` and ``contact`` (n, k, c or 1, m) powers of ten of m pairs
    of intensities. The pairs marked in ``formed`` (m,) are of the processes with the ``forms`` (n, c, 6).

    The factor on the variance is integrated out, with an inverse gamma distribution of `STATED_COUNTS` as prior:
    innovations ``e`` of variances ``s`` then follow Student's distribution.
    """
    n, k, _ = series.value.shape
    c, m = windows.shape[1], max(flight.shape[-1], contact.shape[-1])
    # A contact without intensity is exactly no contact, so that rounding does not make two idle processes differ.
    windows = torch.where((contact > -math.inf).flatten(1).any(1)[:, None, None], windows, 0.0)
    powers = [v.expand(n, k, v.shape[2], m).cpu().numpy() for v in (flight, contact)]
    is_formed = np.zeros(m, dtype=bool) if formed is None else formed.cpu().numpy()
    all_forms = np.zeros((n, c, len(NAMES))) if forms is None else forms.cpu().numpy()
    logs, squares = np.empty((2, n, k, c, m))
    for rows in _groups(series, windows, max(1, FILTERS_AT_ONCE // (c * k * m))):
        batch = FilterBatch.of(series.rows(rows), windows[rows].cpu().numpy())
        own = [10.0 ** v[rows.numpy()] for v in powers]
        for kind in np.unique(is_formed):
            part = np.flatnonzero(is_formed == kind)
            sums = batch.sums(own[0][..., part], own[1][..., part], all_forms[rows.numpy()] if kind else None)
            place = np.ix_(rows.numpy(), np.arange(k), np.arange(c), part)
            logs[place], squares[place] = sums
    counts = STATED_COUNTS + series.seen.sum(-1).cpu().numpy()[:, :, None, None]
    scale = (STATED_COUNTS + squares) / counts
    fit = -0.5 * (logs + counts * np.log(scale))
    return torch.from_numpy(fit).to(flight), torch.from_numpy(np.sqrt(scale)).to(flight)


def _groups(series: Series, windows: Tensor, at_once: int) -> Iterator[Tensor]:
    """Numbers of up to so many recordings with the same times: first of those with a contact, then of the others."""
    if not (series.times == series.times[:1]).all():
        at_once = 1
    touching = (windows[..., 1] > windows[..., 0]).any(1)
    for which in (touching.cpu(), ~touching.cpu()):
        yield from (part for part in which.nonzero()[:, 0].split(at_once) if len(part))


@dataclass(frozen=True)
class FilterBatch:
    """n recordings with the same times, and c contact intervals for each."""

    times: Array  # (t,), frames
    windows: Array  # (n, c, 2), frames
    touching: NDArray[np.bool_]  # (t - 1,), True where any contact overlaps the step to the next frame
    value: Array  # (t, n, k)
    observations: Observations
    flight: Array  # matrices of flight (t - 1, 3, 3)
    white: Array  # covariances of flight (t - 1, 5, 5) per unit intensity

    @classmethod
    def of(cls, series: Series, windows: Array) -> FilterBatch:
        """Batch of the recordings of ``series`` under the intervals ``windows`` (n, c, 2)."""
        times, *arrays = (v.cpu().numpy() for v in series)
        value, variance, drift, seen = (np.moveaxis(v, -1, 0) for v in arrays)
        duration = np.diff(times[0])
        value = np.where(seen, value, 0.0)
        drift, change = (np.concatenate((np.zeros((1, *v.shape[1:])), v)) for v in (drift, np.diff(value, axis=0)))
        return cls(
            times=times[0],
            windows=windows,
            touching=np.asarray(overlaps(times, windows).any((0, 1))),
            value=value,
            observations=Observations(variance, drift, change, seen.astype(np.float64)),
            flight=integrator(duration)[:, :FLIGHT_STATES, :FLIGHT_STATES],
            white=flight_noise(duration),
        )

    def sums(self, flight: Array, contact: Array, forms: Array | None) -> tuple[Array, Array]:
        """Sums of the innovations' logarithms and squares (n, k, c, m), for m pairs of intensities (n, k, c or 1, m).

        ``forms`` (n, c, 6) are those of the force, None for the rough process.
        """
        n, k, _, m = flight.shape
        c, t = self.windows.shape[1], len(self.times)
        unique, which = np.unique(flight.reshape(n * k, -1), axis=1, return_inverse=True)
        which = np.broadcast_to(which.reshape(-1, m), (c, m))

        def arranged(values: Array, rows: Array) -> Array:
            return _arranged(values.reshape(*values.shape[:-1], k, -1), rows // c, which[rows % c])

        touched = np.flatnonzero(self.touching)
        first, last = (int(touched[0]), int(touched[-1]) + 1) if len(touched) else (t - 1, t - 1)
        flights = unique.reshape(n, -1)
        start, logs_before, squares_before = self._flight_before(flights, first)
        settled = self._settled_frame(last)
        is_shared = t - 1 - settled >= MIN_SHARED_FRAMES and 4 * unique.shape[1] <= c * m
        after = self._flight_after(flights, settled) if is_shared else None
        end = settled if is_shared else t - 1
        observations = _frames(self.observations, first + 1, end + 1)
        logs, squares = np.empty((2, n * c, k * m))
        contact = np.broadcast_to(contact, (n, k, c, m)).swapaxes(1, 2).reshape(n * c, k * m)
        for rows in np.array_split(np.arange(n * c), math.ceil(n * c * k * m / FILTERS_AT_ONCE)):
            own_forms = None if forms is None else forms.reshape(1, n * c, -1)[:, rows]
            state, *sums = filtered(
                arranged(start, rows),
                FLIGHT_STATES,
                self._steps(first, last, end, rows, own_forms),
                observations,
                (arranged(flights, rows), contact[rows]),
                rows // c if n > 1 else 0 * rows,
            )
            sums[0] += arranged(logs_before, rows)
            sums[1] += arranged(squares_before, rows)
            if after is not None:
                reference, information, logs_after = (arranged(v, rows) for v in after)
                _add_flight_after(state, reference, information, *sums)
                sums[0] += logs_after
            logs[rows], squares[rows] = sums
        return logs.reshape(n, c, k, m).swapaxes(1, 2), squares.reshape(n, c, k, m).swapaxes(1, 2)

    def _flight_before(self, flights: Array, first: int) -> tuple[Array, Array, Array]:
        """States and sums up to frame ``first`` of a filter for each intensity in ``flights`` (n, k u)."""
        n, k = self.value.shape[1:]
        start = unknown_states(FLIGHT_STATES, np.repeat(self.value[0], flights.shape[1] // k, -1))
        steps = in_flight(self.flight[:first], self.white[:first], begins=True)
        seen = _frames(self.observations, 0, first + 1)
        return filtered(start, FLIGHT_STATES, steps, seen, (flights, flights), np.arange(n))

    def _settled_frame(self, last: int) -> int:
        """Frame by which the state left unknown at frame ``last`` is known from frames seen since."""
        seen = self.observations.seen[last + 1 :].cumsum(0)
        if not len(seen):
            return last
        return last + 1 + int((seen >= np.minimum(seen[-1], SETTLING_FRAMES)).all((1, 2)).argmax())

    def _flight_after(self, flights: Array, last: int) -> tuple[Array, Array, Array]:
        """Reference state (3, n, k u), information (4, 4, n, k u) on the state at frame ``last``, and log variances.

        The first three numbers of a row of the information times the state's difference from the reference, plus the
        last number, are an error of variance 1; the last row holds the rest of the squares.
        """
        n, k = self.value.shape[1:]
        observations = _frames(self.observations, last + 1, len(self.times))
        # Relative to a rate near the true one, the differences are small and keep their digits.
        elapsed = (self.times[last + 1 :] - self.times[last])[:, None, None]
        rate = ((self.value[last + 1 :] - self.value[last]) * elapsed * observations.seen).sum(0)
        rate /= np.maximum((elapsed**2 * observations.seen).sum(0), 1e-300)
        reference = np.stack((0 * rate, -rate, 0 * rate)).repeat(flights.shape[1] // k, -1)
        start, steps = known_states(FLIGHT_STATES, reference), in_flight(self.flight[last:], self.white[last:])
        whitened = np.zeros((len(steps.states), 1 + FLIGHT_STATES, *flights.shape))
        _, logs, _ = filtered(start, FLIGHT_STATES, steps, observations, (flights, flights), np.arange(n), whitened)
        rows = np.moveaxis(whitened[:, [1, 2, 3, 0]], (0, 1), (-2, -1))
        information = np.asarray(np.linalg.qr(rows, mode="r"))
        return reference, np.moveaxis(information, (-2, -1), (0, 1)), logs

    def _steps(self, first: int, last: int, end: int, rows: Numbers, forms: Array | None) -> Steps:
        """Steps from frame ``first`` to ``end`` for some ``rows`` of the n c intervals, all of which end by ``last``.

        ``forms`` (1, rows, 6) are those of the force.
        """
        flight = in_flight(self.flight[first:end], self.white[first:end])
        if first == last:
            return flight
        windows = self.windows.reshape(1, -1, 2)[:, rows]
        steps = transitions(self.times[None, first : last + 1], windows, forms)
        touching = self.touching[first:last]
        sizes = np.where(touching, ROUGH_STATES if forms is None else STATES, FLIGHT_STATES)
        flight.states[: last - first] = np.minimum(sizes, np.append(sizes[1:], FLIGHT_STATES))
        flight.own[: last - first][touching] = np.flatnonzero(touching)
        return flight._replace(matrix=steps.matrix[0], contact=steps.contact[0])


def _frames(observations: Observations, start: int, stop: int) -> Observations:
    """The observations of the frames ``start`` to ``stop - 1``."""
    return Observations(*(values[start:stop] for values in observations))


def _arranged(values: Array, recordings: Array, which: Array) -> Array:
    """Of columns (..., n, k, u) those of b rows (..., b, k m): their recordings (b,), and which m of the u (b, m)."""
    k = values.shape[-2]
    each = values[..., recordings[:, None, None], np.arange(k)[:, None], which[:, None]]
    return each.reshape(*each.shape[:-2], -1)


def _add_flight_after(state: Array, reference: Array, information: Array, logs: Array, squares: Array) -> None:
    """Add to the sums the innovations of the frames after the last contact (`FilterBatch._flight_after`)."""
    covariance, mean = unpacked(state, FLIGHT_STATES)
    mean = mean - reference
    for i in reversed(range(FLIGHT_STATES)):
        row = information[i, :FLIGHT_STATES]
        innovation = information[i, FLIGHT_STATES] + (row * mean).sum(0)
        ahead = (covariance * row).sum(1)
        variance = 1.0 + (row * ahead).sum(0)
        logs += np.log(variance)
        squares += innovation**2 / variance
        gain = ahead / variance
        mean -= gain * innovation
        # Joseph's form, because a difference of covariances would be all rounding.
        covariance -= gain[:, None] * ahead
        covariance -= (covariance * row).sum(1)[:, None] * gain
        covariance += gain[:, None] * gain
    squares += information[FLIGHT_STATES, FLIGHT_STATES] ** 2
