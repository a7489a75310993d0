"""The likeliest edges, kinks and intensities of each process of a contact, and how well edges and kinks are known.

It begins at the edges that `contact_search` has found with the rough process.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.estimation.force_forms import FALLING, FORMS, MIN_PART, RISEN
from torchsphere.estimation.likelihood import Series, log_likelihood
from torchsphere.estimation.process_model import ROUGH_STATES, end_variance
from torchsphere.estimation.process_noise import CONTACT_RANGE, FLIGHT_RANGE, MAX_CONTACT, log_prior

#: Shortest contact, frames (docs/constants.toml).
MIN_CONTACT_FRAMES = 0.5

#: Least and largest standard deviation of an edge or a kink, frames (docs/constants.toml).
EDGE_SD_RANGE = (2e-4, 3.0)

#: Steps of edges and kinks, shares of the interval, before and after the intensities are refined, and last steps in
#: their standard deviations (docs/constants.toml).
COARSE_STEPS, FINE_STEPS, LAST_STEPS = (0.1, 0.05, 0.03, 0.015), (0.01, 0.004, 0.0015), (1.0, 0.5)

#: First guess of the standard deviation of an edge or a kink, frames (docs/constants.toml).
FIRST_SD = 0.1

#: Newton steps of edges and kinks together, and the longest in standard deviations (docs/constants.toml).
NEWTON_STEPS, MAX_NEWTON_SD = 3, 2.0

#: Intensities in contact that are tried with each step of the edges, powers of ten relative to the present one: the
#: better the edges, the less a force departs from its form (docs/constants.toml).
MOVED_OFFSETS = (0.0, -1.0, -3.0)

#: Variance of the acceleration that a flight allows, noise variance per frame^4 (docs/constants.toml).
FLIGHT_VARIANCE = 1e-4

#: Intensities in contact over which the evidence is summed, powers of ten relative to the best (docs/constants.toml).
CONTACT_OFFSETS = tuple(0.75 * i for i in range(-3, 4))

#: Largest correlation of the errors of two edges or kinks, and least eigenvalue of them all (docs/constants.toml).
MAX_CORRELATION, MIN_EIGENVALUE = 0.99, 0.02

#: Edges and kinks of a contact: start, end, first and last kink.
EDGES, PLACES = 2, 4


def posterior(
    series: Series, windows: Tensor, flight: Tensor, contact: Tensor, forms: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """The `log_likelihood` plus the logarithm of the prior, and the noise factor."""
    fit, noise = log_likelihood(series, windows, flight, contact, forms)
    return fit + log_prior(flight), noise


def clamped(series: Series, windows: Tensor) -> Tensor:
    """Intervals (n, ..., 2) within the recording, no shorter than the shortest contact."""
    begin, stop = (series.times[:, at].reshape(-1, *[1] * (windows.ndim - 2)) for at in (0, -1))
    start = torch.minimum(torch.maximum(windows[..., 0], begin), stop - MIN_CONTACT_FRAMES)
    end = torch.minimum(torch.maximum(windows[..., 1], start + MIN_CONTACT_FRAMES), stop)
    return torch.stack((start, end), -1)


def grid_steps(series: Series) -> Tensor:
    """The nine pairs (9, 2) of steps 0, -1 and 1."""
    return torch.cartesian_prod(*2 * [series.times.new_tensor([0.0, -1.0, 1.0])])


@functools.cache
def free_places() -> Tensor:
    """Which of the edges and kinks of each process are unknown (p, 4): a single kink is both the first and the last."""
    kinks = [(form[RISEN] > 0, form[RISEN] > 0 and form[FALLING] > form[RISEN]) for form in FORMS]
    return torch.tensor([[True, True, first, last] for first, last in [(False, False), *kinks]])


class ProcessFits(NamedTuple):
    """The likeliest edges and intensities of each of p processes: the rough one, and those with a form."""

    places: Tensor  # start, end, first and last kink (n, p, 4), frames
    flight: Tensor  # powers of ten (n, k, p)
    contact: Tensor  # powers of ten (n, k, p)

    @classmethod
    def at(cls, window: Tensor, flight: Tensor) -> ProcessFits:
        """All processes at one interval (n, 2), with the intensities ``flight`` (n, k, p) in flight and contact."""
        kinks = window.new_tensor([[0.0, 1.0], *([form[RISEN], form[FALLING]] for form in FORMS)])
        length = window[:, 1:, None] - window[:, :1, None]
        places = torch.cat((window[:, None].expand(-1, len(kinks), -1), window[:, :1, None] + length * kinks), -1)
        return cls(places, flight, flight)

    def evidence(self, series: Series, places: Tensor) -> Tensor:
        """Log-evidence (n, k, p, c) of places (n, p, c, 4) under each process, over all intensities in contact."""
        offsets = series.times.new_tensor(CONTACT_OFFSETS)
        flight, contact = self.around(torch.zeros_like(offsets), offsets)
        rough = (torch.arange(contact.shape[2]) == 0)[:, None, None]
        fit = fit_of(series, places, flight, contact)
        windows = places[:, None, :, :, None, :EDGES]
        fit = (fit + log_end_sd(contact[..., None, :], windows, rough)).logsumexp(-1)
        return torch.where(series.seen.any(-1)[..., None, None], fit, 0.0)

    def around(self, flights: Tensor, contacts: Tensor) -> tuple[Tensor, Tensor]:
        """Powers of ten (n, k, p, m) of the intensities plus the offsets ``flights`` and ``contacts`` (m,)."""
        return (self.flight[..., None] + flights).clamp(*FLIGHT_RANGE), self.contact[..., None] + contacts

    def refined(self, series: Series, size: float) -> ProcessFits:
        """The best neighbours of the intensities, in steps of ``size`` powers of ten."""
        flight, contact = self.around(*(size * grid_steps(series)).T)
        fit = fit_of(series, self.places[:, :, None], flight, contact)
        which = fit[..., 0, :].argmax(-1, keepdim=True)
        flight, contact = (v.gather(-1, which)[..., 0] for v in (flight, contact))
        return self._replace(flight=flight, contact=contact.clamp_max(MAX_CONTACT))

    def located(self, series: Series) -> tuple[ProcessFits, Tensor]:
        """The likeliest edges and kinks of each process near the present ones, and the root of their covariance."""
        best = self
        for share in COARSE_STEPS:
            best = best._moved(series, share * best._lengths())._bent(series, share * best._lengths())
        best = best.refined(series, 0.5)
        for share in FINE_STEPS:
            best = best._moved(series, share * best._lengths())._bent(series, share * best._lengths())
        sd = best._sd(series, torch.full_like(best.places, FIRST_SD))
        for size in LAST_STEPS:
            best = best._moved(series, size * sd[..., :EDGES])._bent(series, size * sd[..., EDGES:])
        for _ in range(NEWTON_STEPS):
            best, root = best._newton_step(series, sd)
        return best, root

    def _lengths(self) -> Tensor:
        """Lengths (n, p, 1) of the intervals."""
        return self.places[..., 1:2] - self.places[..., :1]

    def _moved(self, series: Series, step: Tensor) -> ProcessFits:
        """The best neighbours of the edges, which move by ``step`` (n, p, 1 or 2), frames; the kinks stay."""
        windows = clamped(series, self.places[:, :, None, :EDGES] + step[:, :, None] * grid_steps(series))
        places = torch.cat((windows, self.places[:, :, None, EDGES:].expand_as(windows)), -1)
        offsets = series.times.new_tensor(MOVED_OFFSETS)
        flight, contact = self.around(torch.zeros_like(offsets), offsets)
        contact = torch.where(contact > -math.inf, contact.clamp_min(CONTACT_RANGE[0]), contact)
        fit, which = fit_of(series, places, flight, contact).max(-1)
        top = fit.sum(1).argmax(-1)[..., None]
        which = which.gather(-1, top[:, None].expand(-1, which.shape[1], -1, -1))
        best = places.gather(2, top[..., None].expand(-1, -1, -1, PLACES))[:, :, 0]
        return self._replace(places=best, contact=contact.gather(-1, which)[..., 0])

    def _bent(self, series: Series, step: Tensor) -> ProcessFits:
        """The best neighbours of the kinks, which move by ``step`` (n, p, 1 or 2), frames; the edges stay."""
        number = free_places()[:, EDGES].nonzero()[:, 0]
        own = self.places[:, number, None].expand(-1, -1, len(grid_steps(series)), -1)
        kinks = own[..., EDGES:] + step[:, number, None] * grid_steps(series)
        places = torch.cat((own[..., :EDGES], kinks), -1)
        flight, contact = (v[:, :, number, None] for v in (self.flight, self.contact))
        fit = fit_of(series, places, flight, contact, number - 1)[..., 0].sum(1)
        top = fit.argmax(-1)[..., None, None].expand(-1, -1, -1, PLACES)
        best = self.places.clone()
        best[:, number] = _ordered(places.gather(2, top)[:, :, 0], number - 1)
        return self._replace(places=best)

    def _fit_at(self, series: Series, places: Tensor) -> Tensor:
        """The `posterior` (n, p, c) of all degrees of freedom at places (n, p, c, 4)."""
        return fit_of(series, places, self.flight[..., None], self.contact[..., None])[..., 0].sum(1)

    def _sd(self, series: Series, sd: Tensor) -> Tensor:
        """Standard deviations (n, p, 4) of each edge and kink by itself, from the curvature of the log-likelihood.

        ``sd`` is a first guess.
        """
        for _ in range(3):
            each = torch.diag_embed(sd)
            cross = torch.cat((each, -each, torch.zeros_like(sd)[:, :, None]), 2)
            fit = self._fit_at(series, _clamped_places(series, self.places[:, :, None] + cross))
            drop = (2 * fit[..., -1:] - fit[..., :PLACES] - fit[..., PLACES:-1]).clamp_min(1e-6)
            # The log-likelihood falls by 1/2 within a standard deviation.
            sd = (sd / drop.sqrt()).clamp(*EDGE_SD_RANGE)
        return sd

    def _newton_step(self, series: Series, sd: Tensor) -> tuple[ProcessFits, Tensor]:
        """A step of edges and kinks to their likeliest, and the root (n, p, 4, 4) of their covariance.

        ``sd`` is a first guess of their standard deviations. Rows of what is not unknown are 0.
        """
        sd, free = self._sd(series, sd), free_places().to(sd)
        each = torch.diag_embed(sd)
        pairs = torch.triu_indices(PLACES, PLACES, 1)
        steps = torch.cat(
            (torch.zeros_like(sd)[:, :, None], each, -each, each[:, :, pairs[0]] + each[:, :, pairs[1]]), 2
        )
        fit = self._fit_at(series, _clamped_places(series, self.places[:, :, None] + steps))
        top, after, before, both = fit.split((1, PLACES, PLACES, pairs.shape[1]), -1)
        mixed = -(both - after[..., pairs[0]] - after[..., pairs[1]] + top)
        mixed = mixed.clamp(-MAX_CORRELATION, MAX_CORRELATION) * free[:, pairs[0]] * free[:, pairs[1]]
        information = torch.eye(PLACES).to(sd).repeat(*sd.shape[:2], 1, 1)
        information[..., pairs[0], pairs[1]] = information[..., pairs[1], pairs[0]] = mixed
        values, vectors = torch.linalg.eigh(information)
        root = vectors * values.clamp_min(MIN_EIGENVALUE).rsqrt()[..., None, :] @ vectors.mT
        root = (sd * free)[..., None] * root
        slope = 0.5 * (after - before) / sd * free
        change = root @ (root.mT @ slope[..., None]).clamp(-MAX_NEWTON_SD, MAX_NEWTON_SD)
        moved = _clamped_places(series, self.places + change[..., 0])
        best = self._replace(places=torch.cat((moved[:, :1], _ordered(moved[:, 1:], torch.arange(len(FORMS)))), 1))
        is_better = best._fit_at(series, best.places[:, :, None]) > top
        return self._replace(places=torch.where(is_better, best.places, self.places)), root

    def selected(self, process: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Indices (n, c, 2) of the rough process and the ``process`` (n, c), and powers of ten (n, k, c, 2)."""
        both = torch.stack((torch.zeros_like(process), process), -1)
        each = both[:, None].expand(-1, self.flight.shape[1], -1, -1)
        flight, contact = (v[:, :, None].expand(*each.shape[:3], -1).gather(-1, each) for v in self[1:])
        return both, flight, contact


def _clamped_places(series: Series, places: Tensor) -> Tensor:
    return torch.cat((clamped(series, places[..., :EDGES]), places[..., EDGES:]), -1)


def fit_of(series: Series, places: Tensor, flight: Tensor, contact: Tensor, which: Tensor | None = None) -> Tensor:
    """The `posterior` (n, k, p, c, m) at places (n, p, c, 4), with intensities (n, k, p, m).

    The processes are the rough one and all forms, or the forms of index ``which`` (p,).
    """
    c = places.shape[2]
    flight, contact = (v.repeat_interleave(c, 2) for v in (flight, contact))
    forms = forms_at(places[:, 1:], torch.arange(len(FORMS))) if which is None else forms_at(places, which)
    if which is None:
        forms = torch.cat((torch.zeros_like(forms[:, :1]), forms), 1)
    fit, _ = posterior(series, places[..., :EDGES].flatten(1, 2), flight, contact, forms.flatten(1, 2))
    return fit.unflatten(2, (-1, c))


def forms_at(places: Tensor, which: Tensor) -> Tensor:
    """The forms (n, p, c, 6) of index ``which`` (p,) or (n, p, c) with edges and kinks (n, p, c, 4)."""
    forms = places.new_tensor(FORMS)[which]
    if which.ndim == 1:
        forms = forms[:, None].expand(*places.shape[:3], -1)
    start, length = places[..., :1], (places[..., 1:EDGES] - places[..., :1]).clamp_min(1e-9)
    kinks = ((places[..., EDGES:] - start) / length).clamp(MIN_PART, 1 - MIN_PART)
    single = forms[..., RISEN] == forms[..., FALLING]
    last = torch.where(single, kinks[..., 0], torch.maximum(kinks[..., 0], kinks[..., 1]))
    kinks = torch.stack((kinks[..., 0], last), -1)
    kinked = forms[..., RISEN : RISEN + 1] > 0
    part = slice(RISEN, FALLING + 1)
    return torch.cat((forms[..., :RISEN], torch.where(kinked, kinks, forms[..., part]), forms[..., FALLING + 1 :]), -1)


def _ordered(places: Tensor, which: Tensor) -> Tensor:
    """Places (n, p, 4) with the kinks as the forms of index ``which`` (p,) use them."""
    forms = forms_at(places[:, :, None], which)[:, :, 0]
    length = places[..., 1:EDGES] - places[..., :1]
    return torch.cat((places[..., :EDGES], places[..., :1] + length * forms[..., RISEN : FALLING + 1]), -1)


def log_end_sd(contact: Tensor, windows: Tensor, rough: Tensor) -> Tensor:
    """Logarithm of the prior standard deviation of the acceleration at the end of a contact, plus that of a flight.

    A force has to end at 0, which the rough process does not demand. Its likelihood given that the force ends at 0 is
    that of the data times this deviation. ``contact`` are powers of ten of the processes, ``rough`` says which are
    rough, in ``windows`` (..., 2), all broadcast.
    """
    length = windows[..., 1] - windows[..., 0]
    variance = torch.where(rough, 10.0**contact * end_variance() * length ** (2 * ROUGH_STATES - 5), 0.0)
    return 0.5 * (variance + FLIGHT_VARIANCE).log()
