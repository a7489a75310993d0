"""When the ball is in contact, and how strongly its motion may change then and in flight: maximum likelihood.

Every degree of freedom has an intensity in flight, a process and an intensity in contact, and a factor on its stated
noise; all share the contact interval. The likelihood is that of the innovations of a Kalman filter per degree of
freedom. The interval is sought with the rough process, and then weighed with each in its own place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchsphere.estimation.climb import INTENSITY_STEPS, Best, all_intensities, best_at, best_of, climb, refined
from torchsphere.estimation.contact_models import FINEST_STEP, possible, posterior
from torchsphere.estimation.likelihood import Series
from torchsphere.estimation.model_averaging import (
    CANDIDATES,
    Chosen,
    all_processes,
    candidates,
    intensities,
    without_contact,
)

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
        searched as (`torchsphere.estimation.separate`).
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
