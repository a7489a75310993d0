"""When the ball is in contact, and how strongly its motion may change then and in flight: maximum likelihood.

Every degree of freedom has an intensity in flight, a process and an intensity in contact, and a factor on its stated
noise; all share the contact interval. The likelihood is that of the innovations of a Kalman filter per degree of
freedom. The interval is sought with the rough process, and then weighed with each in its own place.

From an interval and intensities to where their likelihood is highest, step by step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.estimation.contact_models import FINEST_STEP, QUIETEST, possible, posterior
from torchsphere.estimation.likelihood import Series
from torchsphere.estimation.model_averaging import (
    CANDIDATES,
    Chosen,
    all_processes,
    candidates,
    intensities,
    without_contact,
)

#: All intensities that are possible, powers of ten, in flight and in contact, coarsely.
WHOLE_FLIGHT = tuple(float(power) for power in range(-12, 5))
WHOLE_CONTACT = tuple(float(power) for power in range(-12, 9))

#: Steps of the intensities (powers of ten) in the refinement, coarse to fine, while the interval's steps are halved.
INTENSITY_STEPS = (1.5, 0.9, 0.5, 0.3, 0.2)

#: Moves of the edges, in steps: the far ones, because the likelihood has more than one maximum.
EDGE_MOVES = (
    (0, 0),
    *((a * d, b * d) for d in (1, 3) for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1))),
)


class Best(NamedTuple):
    """The likeliest of several: interval (n, 2), powers of ten of its intensities (n, k), likelihood (n,)."""

    window: Tensor
    flight: Tensor
    contact: Tensor
    top: Tensor


def climb(series: Series, best: Best, step: Tensor, finest: float) -> Best:
    """The maximum of the likelihood that a start leads to, with steps of the edges from ``step`` (n,) to ``finest``."""
    moved = torch.ones_like(best.top, dtype=torch.bool)
    last = (torch.zeros_like(step), 0.0)
    for number in range(max(4, 2 + math.ceil(math.log2(float(step.max()) / finest)))):
        if number in (2, 5):
            # The intensities of one degree of freedom have several maxima, too.
            flight, contact, _ = best_at(series, best.window, *all_intensities(series))
            best = best._replace(flight=flight, contact=contact)
            moved[:] = True
        size = INTENSITY_STEPS[min(number, len(INTENSITY_STEPS) - 1)]
        moved |= (step != last[0]) | (size != last[1])
        last = (step, size)
        for _ in range(2):
            best, moved = _refined_again(series, best, step, size, moved)
        step = (0.5 * step).clamp_min(finest)
    return best


def _refined_again(series: Series, best: Best, step: Tensor, size: float, moved: Tensor) -> tuple[Best, Tensor]:
    """As `refined`, and which have moved (n,): those that have not ``moved`` before are at their maximum already."""
    rows = moved.nonzero()[:, 0]
    if not len(rows):
        return best, moved
    old = Best(*(values[rows] for values in best))
    new = refined(series.rows(rows), old, step[rows], size)
    differs = [(a != b).flatten(1).any(1) for a, b in zip(new[:3], old[:3], strict=True)]
    found = Best(*(values.index_copy(0, rows, part) for values, part in zip(best, new, strict=True)))
    return found, moved.index_copy(0, rows, torch.stack(differs).any(0))


def all_intensities(series: Series, without_contact: bool = False) -> tuple[Tensor, Tensor]:
    """Powers of ten (n, k, 1, m) over the whole range."""
    contacts = [-math.inf] if without_contact else list(WHOLE_CONTACT)
    pairs = torch.cartesian_prod(torch.tensor(WHOLE_FLIGHT), torch.tensor(contacts)).to(series.times)
    flight, contact = pairs.T[:, None, None, None].expand(-1, *series.value.shape[:2], 1, -1)
    return flight, contact


def best_at(series: Series, window: Tensor, flight: Tensor, contact: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Best of the intensities (n, k) at one interval (n, 2) each, and the likelihood (n,)."""
    fit = posterior(series, window[:, None], flight, contact)[0]
    return best_of(fit, window[:, None], flight, contact)[1:]


def refined(series: Series, best: Best, step: Tensor, size: float) -> Best:
    """The best neighbour of an interval and its intensities, by ``step`` (n,) frames and ``size`` powers of ten."""
    moves = torch.cartesian_prod(*2 * [series.times.new_tensor([0.0, -1.0, 1.0])])
    shifts = series.times.new_tensor(EDGE_MOVES)
    windows = possible(series, best.window[:, None] + step[:, None, None] * shifts)
    scaled = best.flight[..., None, None] + size * moves[:, 0], best.contact[..., None, None] + size * moves[:, 1]
    around = scaled[0].clamp(math.log10(QUIETEST), 8.0), scaled[1].clamp(-12.0, 12.0)
    fit, _ = posterior(series, windows, *around)
    return best_of(fit, windows, *around)


def best_of(fit: Tensor, windows: Tensor, flight: Tensor, contact: Tensor) -> Best:
    """Where the likelihood (n, k, c, m) is highest in all k together."""
    n, k, c, m = fit.shape
    per_window, which = fit.max(-1)
    top, place = per_window.sum(1).max(-1)
    rows = torch.arange(n, device=fit.device)
    chosen = which.gather(-1, place[:, None, None].expand(n, k, 1))
    freedom = torch.arange(k, device=fit.device)

    def at_best(values: Tensor) -> Tensor:
        return values.expand(n, k, c, m)[rows[:, None], freedom, place[:, None]].gather(-1, chosen)[..., 0]

    return Best(windows[rows, place], at_best(flight), at_best(contact), top)


#: Intensities of the first search, powers of ten, in flight and in contact.
FIRST_FLIGHT, FIRST_CONTACT = (-11.0, -8.0, -5.0), (-9.0, -4.0, -1.5, 0.5, 2.5, 4.5)

#: First intervals: that many starts, and the longest as a power of two of the starts' distance. The best of each length
#: is followed to its maximum: from the best of all alone, one shot in 16 had its end 6 frames off.
STARTS, LONGEST = 16, 3

#: Frames that are searched at once, how far beyond the edges found so far the next look reaches, in the distance of the
#: frames that they were found among, and down to which part of that distance edges are sought among them.
SEARCHED, REACH, WITHIN = 128, 4, 0.25

#: Frames before and after the contact that tell its edges; those in flight keep in mind a hundred at most.
TELLING = 128


@dataclass(frozen=True)
class Contact:
    """Contact intervals and intensities of n recordings: c equally likely sets of them, for k degrees of freedom.

    Attributes
    ----------
    found : Tensor
        (n,), whether a contact makes the data likelier by more than its parameters cost.
    windows : Tensor
        Intervals (n, c, 2), frames; of length 0 where none was found.
    flight, contact : Tensor
        Intensities (n, c, k): variance of the noise per frame^5, and per frame^7 or, of the smooth process, frame^9.
    smooth : Tensor
        (n, c, k), True where the contact's process is the smooth one.
    springs : Tensor
        The smooth process' own (n, c), half turns within the contact.
    noise : Tensor
        Factor (n, c, k) on the stated standard deviation of the noise, of the combination that a degree of freedom is
        searched as (`torchsphere.estimation.measurements`).
    gain : Tensor
        Logarithm (n,) of the likelihood with a contact over that without.
    """

    found: Tensor
    windows: Tensor
    flight: Tensor
    contact: Tensor
    smooth: Tensor
    springs: Tensor
    noise: Tensor
    gain: Tensor


def find(series: Series) -> Contact:
    """Contact and intensities from the likelihood; the recordings' own, searched for all at once."""
    none = series.times.new_zeros(len(series.times), 2)
    quiet = best_at(series, none, *all_intensities(series, without_contact=True))
    window, flight, contact, top = _best_interval(series)
    gain = top - quiet[2]
    counts = series.seen.sum((1, 2)).double().clamp_min(2.0)
    # Schwarz's criterion: two edges, and an intensity per degree of freedom that was seen.
    found = gain > 0.5 * (2 + series.seen.any(-1).sum(1)) * counts.log()
    window = torch.where(found[:, None], window, none)
    flight = torch.where(found[:, None], flight, quiet[0])
    contact = torch.where(found[:, None], contact, -math.inf)
    if found.any():
        near = _near(series, window, found)
        best = all_processes(near, window, flight, contact)
        best, chosen = candidates(near, best)
    else:
        best, chosen = without_contact(window, flight)
    # Where nothing touches both processes are one.
    kinds = torch.where(found[:, None, None, None], chosen.kinds, chosen.kinds.new_tensor([True, False]))
    chosen = Chosen(torch.where(found[:, None, None], chosen.windows, 0.0), found[:, None] * chosen.springs, kinds)
    flight, contact, smooth, noise = intensities(series, chosen, best)
    windows, springs = chosen.windows.expand(-1, CANDIDATES, -1), chosen.springs.expand(-1, CANDIDATES)
    return Contact(found, windows, flight, contact, smooth, springs, noise, gain)


def _near(series: Series, window: Tensor, found: Tensor) -> Series:
    """The frames around all contacts that were found, where that spares any."""
    first, last = window[found, 0].min() - TELLING, window[found, 1].max() + TELLING
    inside = ((series.times >= first) & (series.times <= last)).any(0).nonzero()[:, 0]
    return series.between(int(inside[0]), int(inside[-1]) + 1)


def _best_interval(series: Series) -> Best:
    """The likeliest interval of each recording, with its intensities and its likelihood."""
    if series.times.shape[1] <= SEARCHED:
        return _highest(series)
    each = [_in_long(series.rows(slice(number, number + 1))) for number in range(len(series.times))]
    return Best(*(torch.cat(values) for values in zip(*each, strict=True)))


def _in_long(series: Series) -> Best:
    """The likeliest interval of one long recording: sought among few of its frames, then among more, but nearer.

    What is far from the contact says little about its edges, yet costs as much: at 300 frames the search among all
    took ten seconds.
    """
    # Beside longer ones a recording ends before its row does.
    seen = torch.nonzero(series.seen[0].any(0))
    t = int(seen[-1]) + 1 if len(seen) else series.times.shape[1]
    every = math.ceil(t / SEARCHED)
    best = _highest(series.between(0, t, every), finest=WITHIN * every)
    while every > 1:
        margin = max(REACH * every, SEARCHED // 3)
        limits = best.window[0] + best.window.new_tensor([-margin, margin + 1])
        start, stop = torch.searchsorted(series.times[0, :t].contiguous(), limits).clamp(0, t).tolist()
        finer = every // 2 if stop - start <= 2 * SEARCHED * (every // 2) else every
        if finer == every:
            # A contact too long for a look at each of its frames: its edges are known well enough.
            break
        part = series.between(start, stop, finer)
        finest = FINEST_STEP if finer == 1 else WITHIN * finer
        best = climb(part, best, best.window.new_tensor([float(every)]), finest)
        every = finer
    best = best._replace(window=possible(series, best.window[:, None])[:, 0])
    flight, contact, _ = best_at(series, best.window, *all_intensities(series))
    best = best._replace(flight=flight, contact=contact)
    step = best.window.new_tensor([2 * FINEST_STEP])
    for size in INTENSITY_STEPS[2:4]:
        best = refined(series, best, step, size)
    return best


def _highest(series: Series, finest: float = FINEST_STEP) -> Best:
    """The highest of the maxima that the starts lead to."""
    many = series.repeated(LONGEST + 1)
    each = climb(many, _first(series), _pitch(many), finest)
    top, number = each.top.unflatten(0, (-1, LONGEST + 1)).max(-1)
    rows = torch.arange(len(number), device=number.device) * (LONGEST + 1) + number
    return Best(each.window[rows], each.flight[rows], each.contact[rows], top)


def _pitch(series: Series) -> Tensor:
    """Distance (n,) of the starts of the first search, frames."""
    return ((series.times[:, -1] - series.times[:, 0]) / STARTS).clamp_min(1.0)


def _first(series: Series) -> Best:
    """The likeliest interval of each of s lengths, for each recording: n s of them."""
    pitch, begin = _pitch(series), series.times[:, 0]
    pairs = torch.cartesian_prod(torch.tensor(FIRST_FLIGHT), torch.tensor(FIRST_CONTACT)).to(series.times)
    flight, contact = pairs.T[:, None, None, None].expand(-1, *series.value.shape[:2], 1, -1)
    places = [(start, start + 2**j) for j in range(LONGEST + 1) for start in range(STARTS - 2**j + 1)]
    windows = begin[:, None, None] + pitch[:, None, None] * torch.tensor(places).to(series.times)
    counts = [STARTS - 2**j + 1 for j in range(LONGEST + 1)]
    fits = posterior(series, windows, flight, contact)[0].split(counts, 2)
    each = [best_of(fit, part, flight, contact) for fit, part in zip(fits, windows.split(counts, 1), strict=True)]
    return Best(*(torch.stack(values, 1).flatten(0, 1) for values in zip(*each, strict=True)))
