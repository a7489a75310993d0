"""What the data leave open of a contact: its edges, how rough its force is, and how strong, as often as it is likely.

The contact's process is rough or smooth (`process_model`), of the same kind in all degrees of freedom but those
whose own data are against it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.estimation.contact_models import (
    AROUND_CONTACT,
    QUIETEST,
    Processes,
    fits,
    open_end,
    possible,
    possible_of_each,
    posterior,
)
from torchsphere.estimation.likelihood import Series
from torchsphere.estimation.process_model import SPRINGS

#: Intervals per edge that stand for its uncertainty, and their distance in standard deviations of the edge.
EDGE_PLACES, EDGE_SPACING = 5, 0.9

#: Possible intervals and intensities that stand for all: what the data leave open of them widens the bands.
CANDIDATES = 32

#: Share of the contact by which one of them starts earlier, and another ends later, than the data say, where most are
#: of the rough process. It begins and ends with a slope: a force that fades without one ends for it a tenth of its
#: contact too early. What was left of it, 450 N of 29 kN in its last frame, was stated as none to 1 N (errors of 19 and
#: 37 standard deviations, root mean square over the contact; then 6 and 3, and with twice as many 4 and 1).
SOFT_SHARE = 0.1

#: Powers of ten of the intensities that are weighed against each other, around the best, and the range that each of
#: those in flight stands for.
AROUND_FLIGHT, RANGE_FLIGHT = (-3.0, -1.5, -0.75, 0.0, 0.75), (1.5, 1.125, 0.75, 0.75, 0.75)

#: Lowest intensities that count, powers of ten, of both processes: weaker ones are as good as none.
LEAST = (-12.0, -16.0)

#: Differences of the likelihood's logarithm that are none, and that make an intensity as good as impossible.
FLAT, NEGLIGIBLE = 0.01, 5.0


class Chosen(NamedTuple):
    """Intervals (n, c, 2), springs (n, c) of the smooth process in each, and possible processes (n, k, c, 2)."""

    windows: Tensor
    springs: Tensor
    kinds: Tensor


def all_processes(series: Series, window: Tensor, flight: Tensor, contact: Tensor) -> Processes:
    """From the likeliest intensities of the rough process to those of all, at the same interval.

    ``contact`` (n, k) tells where there is one; its intensities are sought anew, for a degree of freedom that hardly
    moves has two maxima: a contact's, and none.
    """
    count = 1 + len(SPRINGS)
    flight = flight[..., None].expand(*flight.shape, count)
    least = torch.tensor([LEAST[0], *(LEAST[1] for _ in SPRINGS)]).to(flight)
    whole = (least[:, None] + torch.arange(9.0 - min(LEAST)).to(flight)).clamp_max(8.0)
    whole = torch.where(contact[..., None, None] > -math.inf, whole, -math.inf)
    windows = window[:, None].expand(-1, count, -1)
    fit = fits(series, windows[:, :, None], flight[..., None].expand_as(whole), whole)[..., 0, :]
    best = Processes(windows, flight, whole.gather(-1, _last_top(fit))[..., 0])
    for size in (0.5, 0.3):
        best = best.refined(series, size)
    return best


def _last_top(fit: Tensor) -> Tensor:
    """Number (n, k, p, 1) of the maximum at the strongest intensity, where that counts, and of the highest elsewhere.

    Weaker intensities, and none, are weighed beside it whichever it is; what lies above the highest would not be.
    """
    highest, number = fit.max(-1, keepdim=True)
    numbers = torch.arange(fit.shape[-1], device=fit.device)
    rises = torch.nn.functional.pad(fit.diff(dim=-1) > FLAT, (1, 0))
    last = torch.where(rises, numbers, 0).amax(-1, keepdim=True)
    return torch.where(fit.gather(-1, last) > highest - NEGLIGIBLE, last, number)


def without_contact(window: Tensor, flight: Tensor) -> tuple[Processes, Chosen]:
    """What `all_processes` and `candidates` give where no recording has a contact: there is nothing to weigh.

    One interval of no length stands for all of them.
    """
    flight = flight[..., None].expand(*flight.shape, 1 + len(SPRINGS))
    windows = window.new_zeros(len(window), 1, 2)
    kinds = torch.tensor([True, False], device=window.device).expand(*flight.shape[:2], CANDIDATES, -1)
    none = Processes(window[:, None], flight, torch.full_like(flight, -math.inf))
    return none, Chosen(windows, windows[..., 0], kinds)


def candidates(series: Series, best: Processes) -> tuple[Processes, Chosen]:
    """The likeliest intervals of all processes, and some around them, with springs, each as often as it is likely."""
    best = best.located(series)
    pitch = best.pitch(series)
    places = EDGE_SPACING * (torch.arange(EDGE_PLACES).to(series.times) - EDGE_PLACES // 2)
    steps = pitch[:, :, None] * torch.cartesian_prod(places, places)
    windows = possible_of_each(series, best.windows[:, :, None] + steps)
    evidence = best.evidence(series, windows)
    # Each interval stands for those around it: the fewer, the better the edges are known.
    fit = evidence.sum(1) + pitch.log().sum(-1, keepdim=True)
    rough, smooth = fit[:, 0], fit[:, 1:].flatten(1)
    process = torch.stack((rough.logsumexp(-1), smooth.logsumexp(-1) - math.log(len(SPRINGS))), -1).log_softmax(-1)
    rough, smooth = rough.log_softmax(-1), smooth.log_softmax(-1)
    # First all of the rough process, then all of the smooth one, spring by spring.
    chosen = _as_often(torch.cat((process[:, :1] + rough, process[:, 1:] + smooth), -1).softmax(-1))
    kind = chosen // windows.shape[2]
    is_smooth, springs = (kind > 0)[:, None], fit.new_tensor((0.0, *SPRINGS))[kind]
    own = (rough[:, None] + evidence[:, :, 0], smooth[:, None] + evidence[:, :, 1:].flatten(2))
    against = (own[1].logsumexp(-1) < own[0].logsumexp(-1))[..., None]
    kinds = torch.stack((~is_smooth | against, is_smooth.expand(*against.shape[:2], -1)), -1)
    # Spread over the cells of the grid, so that the edges' standard deviation has no steps.
    fill = torch.quasirandom.SobolEngine(2, scramble=True, seed=0).draw(CANDIDATES).to(pitch) - 0.5
    fill = EDGE_SPACING * pitch.gather(1, kind[..., None].expand(-1, -1, 2)) * fill
    moved = windows.flatten(1, 2).gather(1, chosen[..., None].expand(-1, -1, 2)) + fill
    return best, Chosen(possible(series, _softer(moved, kind == 0)), springs, kinds)


def _softer(windows: Tensor, rough: Tensor) -> Tensor:
    """The intervals (n, c, 2): where most are ``rough`` (n, c), one of these starts earlier, and another ends later."""
    count = rough.sum(-1, keepdim=True)
    number = torch.where(rough & (count > CANDIDATES // 2), rough.cumsum(-1) - 1, -1)
    # Apart from each other and from the first and last, as they come in the order of their edges.
    start, end = ((number == at).to(windows) for at in (count // 4, 3 * count // 4))
    size = SOFT_SHARE * (windows[..., 1] - windows[..., 0])
    return windows + size[..., None] * torch.stack((-start, end), -1)


def intensities(series: Series, chosen: Chosen, best: Processes) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Intensities, whether of the smooth process, and factors on the noise (n, c, k), as often as they are likely.

    The intervals chosen are (n, c, 2), or (n, 1, 2) where all are the same.
    """
    contacts = (-math.inf, *AROUND_CONTACT)
    pairs = torch.cartesian_prod(torch.tensor(AROUND_FLIGHT), torch.tensor(contacts)).to(series.times)
    place, flight, contact = best.of(chosen.springs)
    # That of the best intensity for all of a kind: none at all is to count as much as each of them.
    likelier = open_end(contact, chosen.windows[:, None, :, None], place[:, None]).repeat_interleave(len(pairs), -1)
    flight = (flight[..., None] + pairs[:, 0]).clamp(math.log10(QUIETEST), 8.0).flatten(3)
    contact = (contact[..., None] + pairs[:, 1]).flatten(3)
    smooth = torch.tensor([False, True], device=flight.device).repeat_interleave(len(pairs))
    fit, noise = posterior(series, chosen.windows, flight, contact, smooth, chosen.springs)
    # No force at all counts as much as each of the intensities.
    ranges = fit.new_tensor(RANGE_FLIGHT).log().repeat_interleave(len(contacts)).repeat(2)
    kinds = chosen.kinds.repeat_interleave(len(pairs), -1)
    fit = torch.where(kinds, fit + likelier + ranges, -math.inf)
    sums = fit.softmax(-1).cumsum(-1)
    generator = torch.Generator().manual_seed(0)
    # Each interval takes one, and all of them together take each as often as it is likely, in any combination; the
    # same in all recordings, so that each gets in a batch what it gets alone.
    mixed = torch.rand(fit.shape[1:3], generator=generator).to(fit.device).argsort(-1).expand(fit.shape[:3])
    places = (mixed.to(sums) + 0.5)[..., None] / CANDIDATES
    taken = torch.searchsorted(sums, places).clamp_max(sums.shape[-1] - 1)
    flight, contact, noise = (v.expand(fit.shape).gather(-1, taken)[..., 0].mT for v in (flight, contact, noise))
    smooth = smooth[taken[..., 0].mT]
    least = torch.where(smooth, LEAST[1], LEAST[0]).to(contact)
    return 10.0**flight, 10.0 ** torch.where(contact > -math.inf, contact, least), smooth, noise


def _as_often(weights: Tensor) -> Tensor:
    """Numbers (..., c) of choices that each occur as often as their ``weights`` (..., m) ask for, in rising order."""
    places = (torch.arange(CANDIDATES, device=weights.device) + 0.5) / CANDIDATES
    sums = weights.cumsum(-1).contiguous()
    places = places.to(sums).expand(*weights.shape[:-1], -1).contiguous()
    return torch.searchsorted(sums, places).clamp_max(weights.shape[-1] - 1)
