"""When the ball is in contact, and how strongly its motion may change then and in flight: maximum likelihood.

Every degree of freedom has an intensity in flight, one in contact and a factor on its stated noise; all share the
contact interval. The likelihood is that of the innovations of a Kalman filter per degree of freedom.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.likelihood import Series, log_likelihood

#: Lowest intensity, noise variance per frame^5: the memory of white jerk is then a hundred frames.
QUIETEST = 1e-12

#: Intensities of the first search, powers of ten, in flight and in contact; and all that are possible, coarsely.
FIRST_FLIGHT, FIRST_CONTACT = (-11.0, -8.0, -5.0), (-9.0, -4.0, -1.5, 0.5, 2.5, 4.5)
WHOLE_FLIGHT = tuple(float(power) for power in range(-12, 5))
WHOLE_CONTACT = tuple(float(power) for power in range(-12, 9))

#: First intervals: that many starts, and the longest as a power of two of the starts' distance. The best of each length
#: is followed to its maximum: from the best of all alone, one shot in 16 had its end 6 frames off.
STARTS, LONGEST = 16, 3

#: Frames that are searched at once, and how far beyond the edges found so far the next look reaches, in the distance
#: of the frames that they were found among.
SEARCHED, REACH = 128, 4

#: Steps of the intensities (powers of ten) in the refinement, coarse to fine, while the interval's steps are halved.
INTENSITY_STEPS, FINEST_STEP = (1.5, 0.9, 0.5, 0.3, 0.2), 0.1

#: Moves of the edges, in steps: the far ones, because the likelihood has more than one maximum.
EDGE_MOVES = (
    (0, 0),
    *((a * d, b * d) for d in (1, 3) for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1))),
)

#: Shortest contact, frames.
SHORTEST = 0.5

#: Intervals per edge that stand for its uncertainty, and their distance in standard deviations of the edge.
EDGE_PLACES, EDGE_SPACING = 5, 0.9

#: Possible intervals and intensities that stand for all: what the data leave open of them widens the bands.
CANDIDATES = 32

#: Powers of ten of the intensities that are weighed against each other, around the best.
AROUND_FLIGHT, AROUND_CONTACT = (-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0), tuple(0.5 * i for i in range(-5, 6))

#: Logarithm of how much less likely ten times the intensity in flight is before the data. Only gravity and drag act
#: there, so where weak changes in contact could be taken for a restless flight, they are not.
QUIET_PREFERRED = 1.0


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
        Intensities (n, c, k): variance of the noise per frame^5 and frame^7.
    noise : Tensor
        Factor (n, c, k) on the stated standard deviation of the noise.
    gain : Tensor
        Logarithm (n,) of the likelihood with a contact over that without.
    """

    found: Tensor
    windows: Tensor
    flight: Tensor
    contact: Tensor
    noise: Tensor
    gain: Tensor


class Best(NamedTuple):
    """The likeliest of several: interval (n, 2), powers of ten of its intensities (n, k), likelihood (n,)."""

    window: Tensor
    flight: Tensor
    contact: Tensor
    top: Tensor


def find(series: Series) -> Contact:
    """Contact and intensities from the likelihood; the recordings' own, searched for all at once."""
    none = series.times.new_zeros(len(series.times), 2)
    quiet = _at(series, none, *_all_intensities(series, without_contact=True))
    window, flight, contact, top = _best_interval(series)
    gain = top - quiet[2]
    counts = series.seen.sum((1, 2)).double().clamp_min(2.0)
    # Schwarz's criterion: two edges, and an intensity per degree of freedom that was seen.
    found = gain > 0.5 * (2 + series.seen.any(-1).sum(1)) * counts.log()
    window = torch.where(found[:, None], window, none)
    flight = torch.where(found[:, None], flight, quiet[0])
    contact = torch.where(found[:, None], contact, -math.inf)
    windows = torch.where(found[:, None, None], _windows(series, window, flight, contact), 0.0)
    flight, contact, noise = _intensities(series, window, flight, contact)
    return Contact(found, windows, 10.0**flight, 10.0**contact, noise, gain)


def _best_interval(series: Series) -> Best:
    """The likeliest interval of each recording, with its intensities and its likelihood."""
    if series.times.shape[1] <= SEARCHED:
        return _highest(series)
    each = [_in_long(series.row(number)) for number in range(len(series.times))]
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
    best = _highest(series.between(0, t, every))
    while every > 1:
        margin = max(REACH * every, SEARCHED // 3)
        limits = best.window[0] + best.window.new_tensor([-margin, margin + 1])
        start, stop = torch.searchsorted(series.times[0, :t].contiguous(), limits).clamp(0, t).tolist()
        finer = every // 2 if stop - start <= 2 * SEARCHED * (every // 2) else every
        if finer == every:
            # A contact too long for a look at each of its frames: its edges are known well enough.
            break
        part = series.between(start, stop, finer)
        best = _climb(part, best, best.window.new_tensor([float(every)]))
        every = finer
    best = best._replace(window=_possible(series, best.window[:, None])[:, 0])
    flight, contact, _ = _at(series, best.window, *_all_intensities(series))
    best = best._replace(flight=flight, contact=contact)
    step = best.window.new_tensor([2 * FINEST_STEP])
    for size in INTENSITY_STEPS[2:4]:
        best = _refined(series, best, step, size)
    return best


def _highest(series: Series) -> Best:
    """The highest of the maxima that the starts lead to."""
    many = series.repeated(LONGEST + 1)
    each = _climb(many, _first(series), _pitch(many))
    top, number = each.top.unflatten(0, (-1, LONGEST + 1)).max(-1)
    rows = torch.arange(len(number), device=number.device) * (LONGEST + 1) + number
    return Best(each.window[rows], each.flight[rows], each.contact[rows], top)


def _climb(series: Series, best: Best, step: Tensor) -> Best:
    """The maximum of the likelihood that a start leads to, with steps of the edges from ``step`` (n,) down."""
    for number in range(max(4, 2 + math.ceil(math.log2(float(step.max()) / FINEST_STEP)))):
        if number in (2, 5):
            # The intensities of one degree of freedom have several maxima, too.
            flight, contact, _ = _at(series, best.window, *_all_intensities(series))
            best = best._replace(flight=flight, contact=contact)
        size = INTENSITY_STEPS[min(number, len(INTENSITY_STEPS) - 1)]
        for _ in range(2):
            best = _refined(series, best, step, size)
        step = (0.5 * step).clamp_min(FINEST_STEP)
    return best


def _all_intensities(series: Series, without_contact: bool = False) -> tuple[Tensor, Tensor]:
    """Powers of ten (n, k, 1, m) over the whole range."""
    contacts = [-math.inf] if without_contact else list(WHOLE_CONTACT)
    pairs = torch.cartesian_prod(torch.tensor(WHOLE_FLIGHT), torch.tensor(contacts)).to(series.times)
    flight, contact = pairs.T[:, None, None, None].expand(-1, *series.value.shape[:2], 1, -1)
    return flight, contact


def _at(series: Series, window: Tensor, flight: Tensor, contact: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Best of the intensities (n, k) at one interval (n, 2) each, and the likelihood (n,)."""
    fit = _posterior(series, window[:, None], flight, contact)[0]
    return _best(fit, window[:, None], flight, contact)[1:]


def _posterior(series: Series, windows: Tensor, flight: Tensor, contact: Tensor) -> tuple[Tensor, Tensor]:
    """As `log_likelihood`, with what is likely before the data."""
    fit, noise = log_likelihood(series, windows, flight, contact)
    return fit - QUIET_PREFERRED * (flight - math.log10(QUIETEST)), noise


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
    fits = _posterior(series, windows, flight, contact)[0].split(counts, 2)
    each = [_best(fit, part, flight, contact) for fit, part in zip(fits, windows.split(counts, 1), strict=True)]
    return Best(*(torch.stack(values, 1).flatten(0, 1) for values in zip(*each, strict=True)))


def _refined(series: Series, best: Best, step: Tensor, size: float) -> Best:
    """The best neighbour of an interval and its intensities, by ``step`` (n,) frames and ``size`` powers of ten."""
    moves = torch.cartesian_prod(*2 * [series.times.new_tensor([0.0, -1.0, 1.0])])
    shifts = series.times.new_tensor(EDGE_MOVES)
    windows = _possible(series, best.window[:, None] + step[:, None, None] * shifts)
    scaled = best.flight[..., None, None] + size * moves[:, 0], best.contact[..., None, None] + size * moves[:, 1]
    around = scaled[0].clamp(math.log10(QUIETEST), 8.0), scaled[1].clamp(-12.0, 12.0)
    fit, _ = _posterior(series, windows, *around)
    return _best(fit, windows, *around)


def _possible(series: Series, windows: Tensor) -> Tensor:
    """Intervals within the recording, no shorter than the shortest."""
    begin, stop = series.times[:, :1], series.times[:, -1:]
    start = torch.minimum(torch.maximum(windows[..., 0], begin), stop - SHORTEST)
    end = torch.minimum(torch.maximum(windows[..., 1], start + SHORTEST), stop)
    return torch.stack((start, end), -1)


def _best(fit: Tensor, windows: Tensor, flight: Tensor, contact: Tensor) -> Best:
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


def _windows(series: Series, window: Tensor, flight: Tensor, contact: Tensor) -> Tensor:
    """Intervals (n, c, 2) around the best, each as often as it is likely."""

    def fits(windows: Tensor) -> Tensor:
        return log_likelihood(series, windows, flight[..., None, None], contact[..., None, None])[0].sum((1, 3))

    pitch = torch.full_like(window, 0.5)
    for _ in range(3):
        cross = torch.cat((torch.diag_embed(pitch), -torch.diag_embed(pitch), torch.zeros_like(pitch)[:, None]), 1)
        around = fits(window[:, None] + cross)
        drop = 2 * around[:, 4:] - around[:, :2] - around[:, 2:4]
        # An edge whose likelihood falls by 1/2 within a standard deviation; a flat one is known to a few frames only.
        pitch = (pitch / (drop.clamp_min(1e-6)).sqrt()).clamp(0.5 * FINEST_STEP, 3.0)
    places = EDGE_SPACING * (torch.arange(EDGE_PLACES).to(series.times) - EDGE_PLACES // 2)
    windows = _possible(series, window[:, None] + pitch[:, None] * torch.cartesian_prod(places, places))
    chosen = _as_often(fits(windows).softmax(-1))
    # Spread over the cells of the grid, so that the edges' standard deviation has no steps.
    fill = torch.quasirandom.SobolEngine(2, scramble=True, seed=0).draw(CANDIDATES).to(pitch) - 0.5
    moved = windows.gather(1, chosen[..., None].expand(-1, -1, 2)) + EDGE_SPACING * pitch[:, None] * fill
    return _possible(series, moved)


def _intensities(series: Series, window: Tensor, flight: Tensor, contact: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Powers of ten of the intensities, and factors on the noise (n, c, k), each as often as it is likely."""
    pairs = torch.cartesian_prod(torch.tensor(AROUND_FLIGHT), torch.tensor(AROUND_CONTACT)).to(series.times)
    flight = (flight[..., None, None] + pairs[:, 0]).clamp_min(math.log10(QUIETEST))
    contact = contact[..., None, None] + pairs[:, 1]
    fit, noise = _posterior(series, window[:, None], flight, contact)
    chosen = _as_often(fit[:, :, 0].softmax(-1))
    generator = torch.Generator().manual_seed(0)
    # The degrees of freedom's own, in any combination.
    mixed = torch.rand(chosen.shape, generator=generator).to(chosen.device).argsort(-1)
    chosen = chosen.gather(-1, mixed)
    flight, contact, noise = (v[:, :, 0].gather(-1, chosen).mT for v in (flight, contact, noise))
    return flight, contact, noise


def _as_often(weights: Tensor) -> Tensor:
    """Numbers (..., c) of choices that each occur as often as their ``weights`` (..., m) ask for, in rising order."""
    places = (torch.arange(CANDIDATES, device=weights.device) + 0.5) / CANDIDATES
    sums = weights.cumsum(-1).contiguous()
    places = places.to(sums).expand(*weights.shape[:-1], -1).contiguous()
    return torch.searchsorted(sums, places).clamp_max(weights.shape[-1] - 1)
