"""Process models of a contact weighed by their likelihood: candidates of its edges, its process and its intensities.

The rough process and the smooth process with each of its springs (`process_model`) have an interval of their own. The
process is the same in all degrees of freedom but in those whose own data contradict it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchsphere.estimation.likelihood import Series, log_likelihood
from torchsphere.estimation.process_model import ROUGH_STATES, SPRINGS, STATES, end_variance

#: Range of the intensity in flight, powers of ten of the noise variance per frame^5 (docs/constants.md).
FLIGHT_RANGE = (-12.0, 8.0)

#: Shortest contact, frames (docs/constants.md).
MIN_CONTACT_FRAMES = 0.5

#: Least and largest standard deviation of an edge, frames (docs/constants.md).
EDGE_SD_RANGE = (0.002, 3.0)

#: Steps of the edges, shares of the interval, before and after the intensities are refined (docs/constants.md).
COARSE_STEPS, FINE_STEPS = (0.04, 0.04, 0.02, 0.01), (0.01, 0.005, 0.0025, 0.00125)

#: Variance of the acceleration that a flight allows, noise variance per frame^4 (docs/constants.md).
FLIGHT_VARIANCE = 1e-4

#: Intensities in contact that are weighed, powers of ten relative to the best (docs/constants.md).
CONTACT_OFFSETS = tuple(0.75 * i for i in range(-3, 4))

#: Loss of log-likelihood per power of ten of the intensity in flight, as a prior (docs/constants.md).
FLIGHT_PENALTY = 1.0

#: Nodes per edge that represent its uncertainty, and their distance in standard deviations (docs/constants.md).
EDGE_NODES, EDGE_SPACING = 5, 0.9

#: Intervals and intensities that represent the posterior (docs/constants.md).
CANDIDATES = 32

#: Share of the contact by which a soft start or end is added to the candidates (docs/constants.md).
SOFT_SHARE = 0.1

#: Intensities in flight that are weighed, powers of ten relative to the best, and the range that each represents.
FLIGHT_OFFSETS, FLIGHT_WIDTHS = (-3.0, -1.5, -0.75, 0.0, 0.75), (1.5, 1.125, 0.75, 0.75, 0.75)

#: Lowest intensities in contact, powers of ten, of the rough and the smooth process (docs/constants.md).
MIN_CONTACT_POWERS = (-12.0, -16.0)

#: Rise of the log-likelihood that counts, and drop that makes an intensity negligible (docs/constants.md).
MIN_RISE, NEGLIGIBLE_DROP = 0.01, 5.0


def posterior(
    series: Series,
    windows: Tensor,
    flight: Tensor,
    contact: Tensor,
    smooth: Tensor | None = None,
    springs: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """The `log_likelihood` plus the logarithm of the prior, and the noise factor.

    Only gravity and drag act in flight: weak changes in contact are not to be taken for a restless flight.
    """
    fit, noise = log_likelihood(series, windows, flight, contact, smooth, springs)
    return fit - FLIGHT_PENALTY * (flight - FLIGHT_RANGE[0]), noise


def clamped(series: Series, windows: Tensor) -> Tensor:
    """Intervals (n, ..., 2) within the recording, no shorter than the shortest contact."""
    begin, stop = (series.times[:, at].reshape(-1, *[1] * (windows.ndim - 2)) for at in (0, -1))
    start = torch.minimum(torch.maximum(windows[..., 0], begin), stop - MIN_CONTACT_FRAMES)
    end = torch.minimum(torch.maximum(windows[..., 1], start + MIN_CONTACT_FRAMES), stop)
    return torch.stack((start, end), -1)


def grid_steps(series: Series) -> Tensor:
    """The nine pairs (9, 2) of steps 0, -1 and 1."""
    return torch.cartesian_prod(*2 * [series.times.new_tensor([0.0, -1.0, 1.0])])


class ProcessFits(NamedTuple):
    """The likeliest interval and intensities of each of p processes: the rough one, and the smooth one by springs."""

    windows: Tensor  # (n, p, 2), frames
    flight: Tensor  # powers of ten (n, k, p)
    contact: Tensor  # powers of ten (n, k, p)

    def evidence(self, series: Series, windows: Tensor) -> Tensor:
        """Log-evidence (n, k, p, c) of intervals (n, p, c, 2) under each process, over all intensities in contact."""
        offsets = series.times.new_tensor(CONTACT_OFFSETS)
        flight, contact = self.around(torch.zeros_like(offsets), offsets)
        process = torch.arange(1 + len(SPRINGS), device=contact.device)[:, None, None]
        fit = posterior_of_processes(series, windows, flight, contact)
        fit = (fit + log_end_sd(contact[..., None, :], windows[:, None, ..., None, :], process)).logsumexp(-1)
        return torch.where(series.seen.any(-1)[..., None, None], fit, 0.0)

    def around(self, flights: Tensor, contacts: Tensor) -> tuple[Tensor, Tensor]:
        """Powers of ten (n, k, p, m) of the intensities plus the offsets ``flights`` and ``contacts`` (m,)."""
        return (self.flight[..., None] + flights).clamp(*FLIGHT_RANGE), self.contact[..., None] + contacts

    def refined(self, series: Series, size: float) -> ProcessFits:
        """The best neighbours of the intensities, in steps of ``size`` powers of ten."""
        flight, contact = self.around(*(size * grid_steps(series)).T)
        fit = posterior_of_processes(series, self.windows[:, :, None], flight, contact)
        which = fit[..., 0, :].argmax(-1, keepdim=True)
        flight, contact = (v.gather(-1, which)[..., 0] for v in (flight, contact))
        return self._replace(flight=flight, contact=contact.clamp_max(12.0))

    def located(self, series: Series) -> ProcessFits:
        """The likeliest interval of each process near its present interval, with its intensities."""
        return self._moved(series, COARSE_STEPS).refined(series, 0.5)._moved(series, FINE_STEPS)

    def _moved(self, series: Series, steps: tuple[float, ...]) -> ProcessFits:
        """The best neighbours of the intervals, step by step; ``steps`` are shares of their length."""
        best = self
        for share in steps:
            step = share * (best.windows[..., 1] - best.windows[..., 0])[..., None, None]
            windows = clamped(series, best.windows[:, :, None] + step * grid_steps(series))
            fit = posterior_of_processes(series, windows, best.flight[..., None], best.contact[..., None])
            top = fit[..., 0].sum(1).argmax(-1)[..., None, None].expand(-1, -1, -1, 2)
            best = best._replace(windows=windows.gather(2, top)[:, :, 0])
        return best

    def edge_sd(self, series: Series) -> Tensor:
        """Standard deviations (n, p, 2) of the edges, frames, from the curvature of the log-likelihood."""
        sd = torch.full_like(self.windows, 0.5)
        for _ in range(3):
            each = torch.diag_embed(sd)
            cross = torch.cat((each, -each, torch.zeros_like(sd)[:, :, None]), 2)
            windows = clamped(series, self.windows[:, :, None] + cross)
            fit = posterior_of_processes(series, windows, self.flight[..., None], self.contact[..., None])
            fit = fit[..., 0].sum(1)
            drop = (2 * fit[..., 4:] - fit[..., :2] - fit[..., 2:4]).clamp_min(1e-6)
            # The log-likelihood falls by 1/2 within a standard deviation of an edge.
            sd = (sd / drop.sqrt()).clamp(*EDGE_SD_RANGE)
        return sd

    def selected(self, springs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Indices (n, c, 2) of the rough process and that of the ``springs`` (n, c), and powers of ten (n, k, c, 2)."""
        process = 1 + (springs[..., None] == springs.new_tensor(SPRINGS)).int().argmax(-1)
        process = torch.stack((torch.zeros_like(process), process), -1)
        each = process[:, None].expand(-1, self.flight.shape[1], -1, -1)
        flight, contact = (v[:, :, None].expand(*each.shape[:3], -1).gather(-1, each) for v in self[1:])
        return process, flight, contact


def posterior_of_processes(series: Series, windows: Tensor, flight: Tensor, contact: Tensor) -> Tensor:
    """The `posterior` (n, k, p, c, m) of intervals (n, p, c, 2) and intensities (n, k, p, m) of all p processes."""
    n, _, c, _ = windows.shape
    rough, _ = posterior(series, windows[:, 0], flight[:, :, :1], contact[:, :, :1])
    is_smooth = torch.ones(flight.shape[-1], dtype=torch.bool, device=flight.device)
    flight, contact = (v[:, :, 1:].repeat_interleave(c, 2) for v in (flight, contact))
    springs = windows.new_tensor(SPRINGS).repeat_interleave(c).expand(n, -1)
    smooth, _ = posterior(series, windows[:, 1:].flatten(1, 2), flight, contact, is_smooth, springs)
    return torch.cat((rough[:, :, None], smooth.unflatten(2, (-1, c))), 2)


def log_end_sd(contact: Tensor, windows: Tensor, process: Tensor) -> Tensor:
    """Logarithm of the prior standard deviation of the acceleration at the end of a contact, plus that of a flight.

    A force has to end at 0, which a process does not demand; some springs end near 0 by themselves and would seem
    likelier for any force. The likelihood given that the force ends at 0 is that of the data times this deviation.
    ``contact`` are powers of ten under the processes of index ``process`` in ``windows`` (..., 2), all broadcast.
    """
    variances = np.concatenate((end_variance(None), end_variance(np.array(SPRINGS))))
    unit = contact.new_tensor(variances)[process]
    power = torch.where(process > 0, 2 * STATES - 5, 2 * ROUGH_STATES - 5)
    length = windows[..., 1] - windows[..., 0]
    return 0.5 * (10.0**contact * unit * length**power + FLIGHT_VARIANCE).log()


class Candidates(NamedTuple):
    """Equally likely intervals of a contact; the axis c may be 1 where all intervals are the same."""

    windows: Tensor  # (n, c, 2), frames
    springs: Tensor  # springs (n, c) of the smooth process
    possible: Tensor  # (n, k, c, 2), whether the rough and the smooth process are possible


def fit_processes(series: Series, window: Tensor, flight: Tensor, contact: Tensor) -> ProcessFits:
    """Likeliest intensities of all processes at one interval (n, 2), from those (n, k) of the rough process.

    Of ``contact`` only its being above 0 is used: the intensity of a degree of freedom that hardly moves has two
    maxima, that of the contact and none, so that the whole range is searched.
    """
    count = 1 + len(SPRINGS)
    flight = flight[..., None].expand(*flight.shape, count)
    least = torch.tensor([MIN_CONTACT_POWERS[0], *(MIN_CONTACT_POWERS[1] for _ in SPRINGS)]).to(flight)
    powers = (least[:, None] + torch.arange(9.0 - min(MIN_CONTACT_POWERS)).to(flight)).clamp_max(8.0)
    powers = torch.where(contact[..., None, None] > -math.inf, powers, -math.inf)
    windows = window[:, None].expand(-1, count, -1)
    fit = posterior_of_processes(series, windows[:, :, None], flight[..., None].expand_as(powers), powers)[..., 0, :]
    best = ProcessFits(windows, flight, powers.gather(-1, _strongest_maximum(fit))[..., 0])
    for size in (0.5, 0.3):
        best = best.refined(series, size)
    return best


def _strongest_maximum(fit: Tensor) -> Tensor:
    """Index (n, k, p, 1) of the maximum at the strongest intensity, or of the highest if the former is negligible.

    Weaker intensities, and none, are weighed with either; stronger ones than the highest maximum would be missed.
    """
    highest, number = fit.max(-1, keepdim=True)
    numbers = torch.arange(fit.shape[-1], device=fit.device)
    rises = torch.nn.functional.pad(fit.diff(dim=-1) > MIN_RISE, (1, 0))
    last = torch.where(rises, numbers, 0).amax(-1, keepdim=True)
    return torch.where(fit.gather(-1, last) > highest - NEGLIGIBLE_DROP, last, number)


def without_contact(window: Tensor, flight: Tensor) -> tuple[ProcessFits, Candidates]:
    """`ProcessFits` and `Candidates` where no recording has a contact: one interval of length 0, nothing to weigh."""
    flight = flight[..., None].expand(*flight.shape, 1 + len(SPRINGS))
    windows = window.new_zeros(len(window), 1, 2)
    possible = torch.tensor([True, False], device=window.device).expand(*flight.shape[:2], CANDIDATES, -1)
    fits = ProcessFits(window[:, None], flight, torch.full_like(flight, -math.inf))
    return fits, Candidates(windows, windows[..., 0], possible)


def draw_candidates(series: Series, best: ProcessFits) -> tuple[ProcessFits, Candidates]:
    """The likeliest interval of each process, and intervals around them in proportion to their posterior."""
    best = best.located(series)
    sd = best.edge_sd(series)
    nodes = EDGE_SPACING * (torch.arange(EDGE_NODES).to(series.times) - EDGE_NODES // 2)
    steps = sd[:, :, None] * torch.cartesian_prod(nodes, nodes)
    windows = clamped(series, best.windows[:, :, None] + steps)
    evidence = best.evidence(series, windows)
    # A node represents a cell of the grid, whose area is in proportion to the standard deviations of the edges.
    fit = evidence.sum(1) + sd.log().sum(-1, keepdim=True)
    rough, smooth = fit[:, 0], fit[:, 1:].flatten(1)
    process = torch.stack((rough.logsumexp(-1), smooth.logsumexp(-1) - math.log(len(SPRINGS))), -1).log_softmax(-1)
    rough, smooth = rough.log_softmax(-1), smooth.log_softmax(-1)
    # First the nodes of the rough process, then those of the smooth process, spring by spring.
    chosen = _proportional_indices(torch.cat((process[:, :1] + rough, process[:, 1:] + smooth), -1).softmax(-1))
    kind = chosen // windows.shape[2]
    is_smooth, springs = (kind > 0)[:, None], fit.new_tensor((0.0, *SPRINGS))[kind]
    own = (rough[:, None] + evidence[:, :, 0], smooth[:, None] + evidence[:, :, 1:].flatten(2))
    contradicts = (own[1].logsumexp(-1) < own[0].logsumexp(-1))[..., None]
    possible = torch.stack((~is_smooth | contradicts, is_smooth.expand(*contradicts.shape[:2], -1)), -1)
    # Spread the intervals over the cells of the grid, so that the edges' standard deviation has no steps.
    spread = torch.quasirandom.SobolEngine(2, scramble=True, seed=0).draw(CANDIDATES).to(sd) - 0.5
    spread = EDGE_SPACING * sd.gather(1, kind[..., None].expand(-1, -1, 2)) * spread
    moved = windows.flatten(1, 2).gather(1, chosen[..., None].expand(-1, -1, 2)) + spread
    return best, Candidates(clamped(series, _with_soft_edges(moved, kind == 0)), springs, possible)


def _with_soft_edges(windows: Tensor, rough: Tensor) -> Tensor:
    """Intervals (n, c, 2): where most are ``rough`` (n, c), one of the rough starts earlier and another ends later."""
    count = rough.sum(-1, keepdim=True)
    number = torch.where(rough & (count > CANDIDATES // 2), rough.cumsum(-1) - 1, -1)
    # The intervals come in the order of their edges: neither the first and last nor two neighbours are taken.
    start, end = ((number == at).to(windows) for at in (count // 4, 3 * count // 4))
    size = SOFT_SHARE * (windows[..., 1] - windows[..., 0])
    return windows + size[..., None] * torch.stack((-start, end), -1)


def draw_intensities(series: Series, chosen: Candidates, best: ProcessFits) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Intensities in flight and contact, whether smooth, and noise factors (n, c, k), drawn from the posterior."""
    contacts = (-math.inf, *CONTACT_OFFSETS)
    pairs = torch.cartesian_prod(torch.tensor(FLIGHT_OFFSETS), torch.tensor(contacts)).to(series.times)
    process, flight, contact = best.selected(chosen.springs)
    # The factor of the best intensity holds for all: no force at all counts as much as each of the intensities.
    end = log_end_sd(contact, chosen.windows[:, None, :, None], process[:, None]).repeat_interleave(len(pairs), -1)
    flight = (flight[..., None] + pairs[:, 0]).clamp(*FLIGHT_RANGE).flatten(3)
    contact = (contact[..., None] + pairs[:, 1]).flatten(3)
    smooth = torch.tensor([False, True], device=flight.device).repeat_interleave(len(pairs))
    fit, noise = posterior(series, chosen.windows, flight, contact, smooth, chosen.springs)
    widths = fit.new_tensor(FLIGHT_WIDTHS).log().repeat_interleave(len(contacts)).repeat(2)
    possible = chosen.possible.repeat_interleave(len(pairs), -1)
    fit = torch.where(possible, fit + end + widths, -math.inf)
    sums = fit.softmax(-1).cumsum(-1)
    generator = torch.Generator().manual_seed(0)
    # Each interval takes one quantile, in an order that is random but the same in all recordings: alone or in a batch,
    # a recording gets the same values.
    order = torch.rand(fit.shape[1:3], generator=generator).to(fit.device).argsort(-1).expand(fit.shape[:3])
    quantiles = (order.to(sums) + 0.5)[..., None] / CANDIDATES
    taken = torch.searchsorted(sums, quantiles).clamp_max(sums.shape[-1] - 1)
    flight, contact, noise = (v.expand(fit.shape).gather(-1, taken)[..., 0].mT for v in (flight, contact, noise))
    smooth = smooth[taken[..., 0].mT]
    least = torch.where(smooth, MIN_CONTACT_POWERS[1], MIN_CONTACT_POWERS[0]).to(contact)
    return 10.0**flight, 10.0 ** torch.where(contact > -math.inf, contact, least), smooth, noise


def _proportional_indices(weights: Tensor) -> Tensor:
    """Indices (..., c), rising, that each occur in proportion to the ``weights`` (..., m)."""
    quantiles = (torch.arange(CANDIDATES, device=weights.device) + 0.5) / CANDIDATES
    sums = weights.cumsum(-1).contiguous()
    quantiles = quantiles.to(sums).expand(*weights.shape[:-1], -1).contiguous()
    return torch.searchsorted(sums, quantiles).clamp_max(weights.shape[-1] - 1)
