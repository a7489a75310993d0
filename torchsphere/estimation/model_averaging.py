"""Process models of a contact weighed by their likelihood: candidates of its edges, its process and its intensities.

The rough process and the processes with a form of the force (`process_model`) have an interval of their own. The
process is the same in all degrees of freedom but in those whose own data contradict it, which have the rough one.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.estimation.force_forms import FORMS
from torchsphere.estimation.likelihood import Series
from torchsphere.estimation.process_fits import (
    EDGES,
    PLACES,
    ProcessFits,
    clamped,
    fit_of,
    forms_at,
    free_places,
    log_end_sd,
    posterior,
)
from torchsphere.estimation.process_noise import CONTACT_GRID, CONTACT_RANGE, FLIGHT_RANGE

#: Nodes that represent the uncertainty of edges and kinks of a process, and their spread in standard deviations
#: (docs/constants.toml).
NODES, NODE_SPREAD = 32, 1.2

#: Fall of the log-evidence beyond that of a normal distribution, from which a node of a process with kinks counts less
#: (docs/constants.toml).
MAX_EXCESS_FALL = 3.0

#: Power of a process's evidence among the others (docs/constants.toml): no force has just one of the forms.
EVIDENCE_POWER = 0.5

#: Intervals and intensities that represent the posterior (docs/constants.toml).
CANDIDATES = 32

#: Share of the contact by which a soft start or end is added to the candidates (docs/constants.toml).
SOFT_SHARE = 0.1

#: Intensities in flight that are weighed, powers of ten relative to the best (docs/constants.toml).
FLIGHT_OFFSETS = (-3.0, -1.5, -0.75, 0.0, 0.75)

#: Intensities in contact that are weighed, powers of ten relative to the best (docs/constants.toml).
DRAWN_OFFSETS = (-2.25, -1.5, -1.0, *(0.25 * i for i in range(-3, 4)), 1.0, 1.5, 2.25)

#: Range of intensities, powers of ten, that no force at all counts as (docs/constants.toml).
NO_FORCE_WIDTH = 0.75

#: Rise of the log-likelihood that counts, and drop that makes an intensity negligible (docs/constants.toml).
MIN_RISE, NEGLIGIBLE_DROP = 0.01, 5.0


class Candidates(NamedTuple):
    """Equally likely intervals of a contact; the axis c may be 1 where all intervals are the same."""

    windows: Tensor  # (n, c, 2), frames
    process: Tensor  # process (n, c), 0 the rough one
    forms: Tensor  # forms (n, c, 6)
    possible: Tensor  # (n, k, c, 2), whether the rough process and that with the form are possible


def fit_processes(series: Series, window: Tensor, flight: Tensor, contact: Tensor) -> ProcessFits:
    """Likeliest intensities of all processes at one interval (n, 2), from those (n, k) of the rough process.

    Of ``contact`` only its being above 0 is used: the intensity of a degree of freedom that hardly moves has two
    maxima, that of the contact and none, so that the whole range is searched.
    """
    count = 1 + len(FORMS)
    flight = flight[..., None].expand(*flight.shape, count)
    powers = flight.new_tensor(CONTACT_GRID)
    powers = torch.where(contact[..., None, None] > -math.inf, powers, -math.inf).expand(*flight.shape, -1)
    best = ProcessFits.at(window, flight)
    fit = fit_of(series, best.places[:, :, None], flight[..., None].expand_as(powers), powers)[..., 0, :]
    best = best._replace(contact=powers.gather(-1, _strongest_maximum(fit))[..., 0])
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
    flight = flight[..., None].expand(*flight.shape, 1 + len(FORMS))
    fits = ProcessFits.at(window, flight)
    fits = fits._replace(contact=torch.full_like(flight, -math.inf))
    windows, forms = window.new_zeros(len(window), 1, 2), window.new_tensor(FORMS[:1]).expand(len(window), -1, -1)
    possible = torch.tensor([True, False], device=window.device).expand(*flight.shape[:2], CANDIDATES, -1)
    return fits, Candidates(windows, torch.zeros_like(windows[..., 0], dtype=torch.long), forms, possible)


def draw_candidates(series: Series, best: ProcessFits) -> tuple[ProcessFits, Candidates]:
    """The likeliest interval of each process, and intervals around them in proportion to their posterior."""
    best, root = best.located(series)
    places, log_volume = _nodes(series, best, root)
    evidence = best.evidence(series, places)
    # Too few nodes fall into a narrow maximum in four dimensions, so that it is taken as normal where it nearly is.
    kinked = free_places()[:, EDGES, None]
    fall = evidence.sum(1) - evidence[..., :1].sum(1)
    excess = (fall + 0.5 * (_node_normals() ** 2).sum(-1).to(fall) + MAX_EXCESS_FALL).clamp_max(0.0)
    evidence = torch.where(kinked, evidence[..., :1], evidence)
    fit = evidence.sum(1) + torch.where(kinked, excess, 0.0) + log_volume
    fit = fit + (EVIDENCE_POWER - 1) * fit.logsumexp(-1, keepdim=True)
    rough, formed = fit[:, 0].log_softmax(-1), fit[:, 1:].flatten(1).log_softmax(-1)
    # The nodes process by process, the rough one first.
    process = torch.stack((fit[:, 0].logsumexp(-1), fit[:, 1:].flatten(1).logsumexp(-1) - math.log(len(FORMS))), -1)
    process = process.log_softmax(-1)
    chosen = _proportional_indices(torch.cat((process[:, :1] + rough, process[:, 1:] + formed), -1).softmax(-1))
    kind = chosen // places.shape[2]
    is_formed = (kind > 0)[:, None]
    own = (rough[:, None] + evidence[:, :, 0], formed[:, None] + evidence[:, :, 1:].flatten(2))
    contradicts = (own[1].logsumexp(-1) < own[0].logsumexp(-1))[..., None]
    possible = torch.stack((~is_formed | contradicts, is_formed.expand(*contradicts.shape[:2], -1)), -1)
    taken = places.flatten(1, 2).gather(1, chosen[..., None].expand(-1, -1, PLACES))
    windows = clamped(series, _with_soft_edges(taken[..., :EDGES], kind == 0))
    taken = torch.cat((windows, taken[..., EDGES:]), -1)
    forms = forms_at(taken[:, None], (kind - 1).clamp_min(0)[:, None])[:, 0]
    return best, Candidates(windows, kind, forms, possible)


def _nodes(series: Series, best: ProcessFits, root: Tensor) -> tuple[Tensor, Tensor]:
    """Places (n, p, c, 4), the ``best`` first, and the logarithm (n, p, c) of the volume that each other represents.

    The volume is that of the priors: flat for the edges, and flat within the contact for the kinks. The nodes of a
    process with kinks are drawn from its normal distribution, and represent the same volume each.
    """
    free = free_places().to(root)
    kinks = free[:, EDGES:].sum(-1)
    normal = _node_normals().to(root)
    spread = torch.where(kinks > 0, 1.0, NODE_SPREAD)[:, None, None]
    places = best.places[:, :, None] + spread * (root[:, :, None] @ normal[..., None])[..., 0]
    places = torch.cat((clamped(series, places[..., :EDGES]), places[..., EDGES:]), -1)
    log_volume = torch.linalg.det(root + torch.diag_embed(1 - free)).clamp_min(1e-30).log()
    length = best.places[..., 1] - best.places[..., 0]
    log_volume = log_volume + kinks * (0.5 * math.log(2 * math.pi) - length.log())
    drawn_from = EDGES * math.log(NODE_SPREAD) + 0.5 * (normal**2 @ free.T).T
    log_volume = log_volume[..., None] + torch.where(kinks[:, None] > 0, 0.0, drawn_from)
    log_volume[..., 0] = -math.inf
    return places, log_volume


@functools.cache
def _node_normals() -> Tensor:
    """Numbers (1 + c, 4) spread like independent normal ones, by their quantiles in each column; the first is 0."""
    generator = torch.Generator().manual_seed(0)
    order = torch.stack([torch.randperm(NODES, generator=generator) for _ in range(PLACES)], -1)
    drawn = 2**0.5 * torch.erfinv(2 * (order.double() + 0.5) / NODES - 1)
    # No column must look like another one.
    drawn = drawn @ torch.linalg.inv(torch.linalg.cholesky(drawn.T @ drawn / NODES)).T
    return torch.cat((torch.zeros_like(drawn[:1]), drawn))


def _with_soft_edges(windows: Tensor, rough: Tensor) -> Tensor:
    """Intervals (n, c, 2): where most are ``rough`` (n, c), one of the rough starts earlier and another ends later."""
    count = rough.sum(-1, keepdim=True)
    number = torch.where(rough & (count > CANDIDATES // 2), rough.cumsum(-1) - 1, -1)
    # The intervals come in the order of their edges: neither the first and last nor two neighbours are taken.
    start, end = ((number == at).to(windows) for at in (count // 4, 3 * count // 4))
    size = SOFT_SHARE * (windows[..., 1] - windows[..., 0])
    return windows + size[..., None] * torch.stack((-start, end), -1)


def draw_intensities(series: Series, chosen: Candidates, best: ProcessFits) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Intensities in flight and contact, whether with the form, and noise factors (n, c, k), all drawn."""
    contacts = (-math.inf, *DRAWN_OFFSETS)
    pairs = torch.cartesian_prod(torch.tensor(FLIGHT_OFFSETS), torch.tensor(contacts)).to(series.times)
    process, flight, contact = best.selected(chosen.process)
    # The factor of the best intensity holds for all, also for no force at all.
    end = log_end_sd(contact, chosen.windows[:, None, :, None], process[:, None] == 0).repeat_interleave(len(pairs), -1)
    flight = (flight[..., None] + pairs[:, 0]).clamp(*FLIGHT_RANGE).flatten(3)
    contact = (contact[..., None] + pairs[:, 1]).flatten(3)
    # The pairs of the rough process come before those of the process with the form.
    powers = zip(*(v.split(len(pairs), -1) for v in (flight, contact)), (None, chosen.forms), strict=True)
    both = [posterior(series, chosen.windows, own, touching, forms) for own, touching, forms in powers]
    fit, noise = (torch.cat(values, -1) for values in zip(*both, strict=True))
    # Each intensity stands for the range halfway to its neighbours.
    of_flight, of_contact = (torch.gradient(fit.new_tensor(offsets))[0] for offsets in (FLIGHT_OFFSETS, DRAWN_OFFSETS))
    widths = (of_flight[:, None] * torch.cat((fit.new_tensor([NO_FORCE_WIDTH]), of_contact))).log()
    possible = chosen.possible.repeat_interleave(len(pairs), -1)
    fit = torch.where(possible, fit + end + widths.flatten().repeat(2), -math.inf)
    sums = fit.softmax(-1).cumsum(-1)
    generator = torch.Generator().manual_seed(0)
    # Each interval takes one quantile, in an order that is random but the same in all recordings: alone or in a batch,
    # a recording gets the same values.
    order = torch.rand(fit.shape[1:3], generator=generator).to(fit.device).argsort(-1).expand(fit.shape[:3])
    quantiles = (order.to(sums) + 0.5)[..., None] / CANDIDATES
    taken = torch.searchsorted(sums, quantiles).clamp_max(sums.shape[-1] - 1)
    flight, contact, noise = (v.expand(fit.shape).gather(-1, taken)[..., 0].mT for v in (flight, contact, noise))
    contact = torch.where(contact > -math.inf, contact, CONTACT_RANGE[0])
    return 10.0**flight, 10.0**contact, (taken[..., 0] >= len(pairs)).mT, noise


def _proportional_indices(weights: Tensor) -> Tensor:
    """Indices (..., c), rising, that each occur in proportion to the ``weights`` (..., m)."""
    quantiles = (torch.arange(CANDIDATES, device=weights.device) + 0.5) / CANDIDATES
    sums = weights.cumsum(-1).contiguous()
    quantiles = quantiles.to(sums).expand(*weights.shape[:-1], -1).contiguous()
    return torch.searchsorted(sums, quantiles).clamp_max(weights.shape[-1] - 1)
