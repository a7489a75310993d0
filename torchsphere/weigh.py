"""What the data leave open of a contact: its edges, how rough its force is, and how strong, as often as it is likely.

The contact's process is rough or smooth (`torchsphere.process`), of the same kind in all degrees of freedom but those
whose own data are against it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.likelihood import Series, log_likelihood

#: Lowest intensity, noise variance per frame^5: the memory of white jerk is then a hundred frames.
QUIETEST = 1e-12

#: Shortest contact, frames.
SHORTEST = 0.5

#: Intervals per edge that stand for its uncertainty, and their distance in standard deviations of the edge.
EDGE_PLACES, EDGE_SPACING = 5, 0.9

#: Shortest step of an edge in any search, frames.
FINEST_STEP = 0.1

#: How much less the edges are known by the smooth process than its likelihood says. A parabola costs that no crackle,
#: so of all forces it takes this for the likeliest; a half-sine is like one of a contact that is shorter by 0.1 and 0.3
#: frames of 14 (noise of 1.5 and 7.5 um), with edges known to 0.06 and 0.14. Without, they were off by 1.1 to 1.6 of
#: their standard deviations (root mean square of 32 shots), with it by 0.9 to 1.3, with 2 by 0.7 to 1.0.
SHARED_SHAPE = 1.4

#: Possible intervals and intensities that stand for all: what the data leave open of them widens the bands.
CANDIDATES = 32

#: How many of them start earlier, and how many end later, than the data say, by up to which share of the contact. Both
#: processes begin and end with a slope: a force that fades without one, as cos^2, ends for them a tenth of its contact
#: too early. What was left of it, 450 N of 29 kN in its last frame, was stated as none to 1 N (errors of 19 and 37
#: standard deviations, root mean square over the contact; now 6 and 3, with twice as many 4 and 1).
SOFT, SOFT_SHARE = 1, 0.1

#: Powers of ten of the intensities that are weighed against each other, around the best, and the range that each of
#: those in flight stands for.
AROUND_FLIGHT, RANGE_FLIGHT = (-3.0, -1.5, -0.75, 0.0, 0.75), (1.5, 1.125, 0.75, 0.75, 0.75)
AROUND_CONTACT = tuple(0.75 * i for i in range(-3, 4))

#: Lowest intensities that count, powers of ten, of both processes: weaker ones are as good as none.
LEAST = (-12.0, -16.0)

#: Differences of the likelihood's logarithm that are none, and that make an intensity as good as impossible.
FLAT, NEGLIGIBLE = 0.01, 5.0

#: Whether the contact's process is the smooth one: both are possible, and equally likely before the data.
BOTH = (False, True)

#: Logarithm of how much less likely ten times the intensity in flight is before the data. Only gravity and drag act
#: there, so where weak changes in contact could be taken for a restless flight, they are not.
QUIET_PREFERRED = 1.0


class Both(NamedTuple):
    """The likeliest interval (n, 2), and powers of ten of the likeliest intensities (n, k, 2) of `BOTH` processes."""

    window: Tensor
    flight: Tensor
    contact: Tensor

    def evidence(self, series: Series, windows: Tensor) -> Tensor:
        """Likelihood (n, k, c, 2) of intervals (n, c, 2) under either process, whatever its intensity."""
        contacts = series.times.new_tensor(AROUND_CONTACT)
        fit, _ = posterior(series, windows, *self.grid(torch.zeros_like(contacts), contacts))
        return fit.unflatten(-1, (2, -1)).logsumexp(-1)

    def grid(self, flights: Tensor, contacts: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Powers of ten (n, k, 1, 2 m) around those of both processes, by ``flights`` and ``contacts`` (m,)."""
        flight = (self.flight[..., None] + flights).clamp(math.log10(QUIETEST), 8.0)
        contact = self.contact[..., None] + contacts
        smooth = torch.tensor(BOTH, device=flight.device).repeat_interleave(len(flights))
        return flight.flatten(2)[:, :, None], contact.flatten(2)[:, :, None], smooth

    def refined(self, series: Series, size: float) -> Both:
        """The best neighbours of the intensities, by ``size`` powers of ten."""
        moves = torch.cartesian_prod(*2 * [size * series.times.new_tensor([0.0, -1.0, 1.0])])
        flight, contact, smooth = self.grid(*moves.T)
        fit, _ = posterior(series, self.window[:, None], flight, contact, smooth)
        which = fit[:, :, 0].unflatten(-1, (2, -1)).argmax(-1, keepdim=True)
        flight, contact = (v[:, :, 0].unflatten(-1, (2, -1)).gather(-1, which)[..., 0] for v in (flight, contact))
        return self._replace(flight=flight, contact=contact.clamp_max(12.0))


def both_processes(series: Series, window: Tensor, flight: Tensor, contact: Tensor) -> Both:
    """From the likeliest intensities of the rough process to those of both, at the same interval.

    ``contact`` (n, k) tells where there is one; its intensities are sought anew, for a degree of freedom that hardly
    moves has two maxima: a contact's, and none.
    """
    there = contact[..., None, None] > -math.inf
    tops = []
    for kind, least in zip(BOTH, LEAST, strict=True):
        whole = torch.arange(least, 9.0).to(flight).expand(*flight.shape, 1, -1)
        whole = torch.where(there, whole, -math.inf)
        smooth = torch.full((whole.shape[-1],), kind, device=whole.device)
        fit, _ = posterior(series, window[:, None], flight[..., None, None], whole, smooth)
        tops.append(whole[:, :, 0].gather(-1, _last_top(fit[:, :, 0])))
    best = Both(window, flight[..., None].expand(*flight.shape, 2), torch.cat(tops, -1))
    for size in (0.5, 0.3):
        best = best.refined(series, size)
    return best


def _last_top(fit: Tensor) -> Tensor:
    """Number (n, k, 1) of the maximum at the strongest intensity, where that counts, and of the highest elsewhere.

    Weaker intensities, and none, are weighed beside it whichever it is; what lies above the highest would not be.
    """
    highest, number = fit.max(-1, keepdim=True)
    numbers = torch.arange(fit.shape[-1], device=fit.device)
    rises = torch.nn.functional.pad(fit.diff(dim=-1) > FLAT, (1, 0))
    last = torch.where(rises, numbers, 0).amax(-1, keepdim=True)
    return torch.where(fit.gather(-1, last) > highest - NEGLIGIBLE, last, number)


def without_contact(window: Tensor, flight: Tensor) -> tuple[Both, Tensor, Tensor]:
    """What `both_processes` and `candidates` give where no recording has a contact: there is nothing to weigh.

    One interval of no length stands for all of them.
    """
    flight = flight[..., None].expand(*flight.shape, 2)
    windows = window.new_zeros(len(window), 1, 2)
    kinds = torch.tensor([True, False], device=window.device).expand(*flight.shape[:2], CANDIDATES, -1)
    return Both(window, flight, torch.full_like(flight, -math.inf)), windows, kinds


def candidates(series: Series, best: Both) -> tuple[Tensor, Tensor]:
    """Intervals (n, c, 2) around the best, each as often as it is likely, and the processes (n, k, c, 2) of each."""
    pitch = _pitch(series, best)
    places = EDGE_SPACING * (torch.arange(EDGE_PLACES).to(series.times) - EDGE_PLACES // 2)
    windows = possible(series, best.window[:, None] + pitch[:, None] * torch.cartesian_prod(places, places))
    evidence = best.evidence(series, windows)
    both = evidence.sum(1)
    process = both.logsumexp(1, keepdim=True).log_softmax(-1)
    edges = (both / both.new_tensor([1.0, SHARED_SHAPE])).log_softmax(1)
    # First all of the rough process, then all of the smooth one.
    chosen = _as_often((process + edges).mT.flatten(1).softmax(-1))
    is_smooth, chosen = (chosen >= windows.shape[1])[:, None], chosen % windows.shape[1]
    against = (edges[:, None, :, 1] + evidence[..., 1] - evidence[..., 0]).logsumexp(-1, keepdim=True) < 0
    kinds = torch.stack((~is_smooth | against, is_smooth.expand(*against.shape[:2], -1)), -1)
    # Spread over the cells of the grid, so that the edges' standard deviation has no steps.
    fill = torch.quasirandom.SobolEngine(2, scramble=True, seed=0).draw(CANDIDATES).to(pitch) - 0.5
    moved = windows.gather(1, chosen[..., None].expand(-1, -1, 2)) + EDGE_SPACING * pitch[:, None] * fill
    return possible(series, moved + _softer(moved)), kinds


def _softer(windows: Tensor) -> Tensor:
    """What makes the intervals (n, c, 2) start earlier and end later that stand for a softer start and end."""
    shares = torch.zeros(CANDIDATES, 2).to(windows)
    # Spread over all, as they come in the order of their processes and edges.
    places = torch.arange(2 * SOFT) * CANDIDATES // (2 * SOFT) + CANDIDATES // (4 * SOFT)
    size = SOFT_SHARE * torch.arange(1, SOFT + 1).to(windows) / SOFT
    shares[places[:SOFT], 0], shares[places[SOFT:], 1] = -size, size
    return shares * (windows[..., 1:] - windows[..., :1])


def _pitch(series: Series, best: Both) -> Tensor:
    """Standard deviation (n, 2) of either edge, by how the likelihood of the rough process falls."""
    pitch = torch.full_like(best.window, 0.5)
    flight, contact = best.flight[..., :1, None], best.contact[..., :1, None]
    for _ in range(3):
        cross = torch.cat((torch.diag_embed(pitch), -torch.diag_embed(pitch), torch.zeros_like(pitch)[:, None]), 1)
        around = log_likelihood(series, best.window[:, None] + cross, flight, contact)[0].sum((1, 3))
        drop = 2 * around[:, 4:] - around[:, :2] - around[:, 2:4]
        # An edge whose likelihood falls by 1/2 within a standard deviation; a flat one is known to a few frames only.
        pitch = (pitch / (drop.clamp_min(1e-6)).sqrt()).clamp(0.5 * FINEST_STEP, 3.0)
    return pitch


def intensities(series: Series, windows: Tensor, best: Both, kinds: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Intensities, whether of the smooth process, and factors on the noise (n, c, k), as often as they are likely.

    ``windows`` are (n, c, 2), or (n, 1, 2) where all are the same; ``kinds`` (n, k, c, 2) says which processes each
    goes with.
    """
    contacts = (-math.inf, *AROUND_CONTACT)
    pairs = torch.cartesian_prod(torch.tensor(AROUND_FLIGHT), torch.tensor(contacts)).to(series.times)
    flight, contact, smooth = best.grid(*pairs.T)
    fit, noise = posterior(series, windows, flight, contact, smooth)
    # No force at all counts as much as each of the intensities.
    ranges = fit.new_tensor(RANGE_FLIGHT).log().repeat_interleave(len(contacts)).repeat(len(BOTH))
    fit = torch.where(kinds.repeat_interleave(len(pairs), -1), fit + ranges, -math.inf)
    sums = fit.softmax(-1).cumsum(-1)
    generator = torch.Generator().manual_seed(0)
    # Each interval takes one, and all of them together take each as often as it is likely, in any combination; the
    # same in all recordings, so that each gets in a batch what it gets alone.
    mixed = torch.rand(fit.shape[1:3], generator=generator).to(fit.device).argsort(-1).expand(fit.shape[:3])
    places = (mixed.to(sums) + 0.5)[..., None] / CANDIDATES
    chosen = torch.searchsorted(sums, places).clamp_max(sums.shape[-1] - 1)
    flight, contact, noise = (v.expand(fit.shape).gather(-1, chosen)[..., 0].mT for v in (flight, contact, noise))
    smooth = smooth[chosen[..., 0].mT]
    least = torch.where(smooth, LEAST[1], LEAST[0]).to(contact)
    return 10.0**flight, 10.0 ** torch.where(contact > -math.inf, contact, least), smooth, noise


def posterior(
    series: Series, windows: Tensor, flight: Tensor, contact: Tensor, smooth: Tensor | None = None
) -> tuple[Tensor, Tensor]:
    """As `log_likelihood`, with what is likely before the data."""
    fit, noise = log_likelihood(series, windows, flight, contact, smooth)
    return fit - QUIET_PREFERRED * (flight - math.log10(QUIETEST)), noise


def possible(series: Series, windows: Tensor) -> Tensor:
    """Intervals within the recording, no shorter than the shortest."""
    begin, stop = series.times[:, :1], series.times[:, -1:]
    start = torch.minimum(torch.maximum(windows[..., 0], begin), stop - SHORTEST)
    end = torch.minimum(torch.maximum(windows[..., 1], start + SHORTEST), stop)
    return torch.stack((start, end), -1)


def _as_often(weights: Tensor) -> Tensor:
    """Numbers (..., c) of choices that each occur as often as their ``weights`` (..., m) ask for, in rising order."""
    places = (torch.arange(CANDIDATES, device=weights.device) + 0.5) / CANDIDATES
    sums = weights.cumsum(-1).contiguous()
    places = places.to(sums).expand(*weights.shape[:-1], -1).contiguous()
    return torch.searchsorted(sums, places).clamp_max(weights.shape[-1] - 1)
