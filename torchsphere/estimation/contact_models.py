"""The rough process and the smooth one with each of its springs side by side: how likely, and with which edges.

The forces drawn from a process need not end at 0, but after the contact they have to. Those of some springs do so
nearly by themselves, and were taken for the likelier, by 2 in the logarithm for each degree of freedom, whatever its
force was like: of triangles and of two peaks, too. So what counts is the likelihood given that the force is 0 at the
end: that of the data times the standard deviation which the process had there beforehand (`open_end`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchsphere.estimation.likelihood import Series, log_likelihood
from torchsphere.estimation.process_model import ROUGH, SPRINGS, STATES, ending

#: Lowest intensity, noise variance per frame^5: the memory of white jerk is then a hundred frames.
QUIETEST = 1e-12

#: Shortest contact, frames.
SHORTEST = 0.5

#: Shortest step of an edge in the search with the rough process, frames.
FINEST_STEP = 0.1

#: Least and largest standard deviation of an edge that is weighed, frames.
PITCH = (0.002, 3.0)

#: Steps of the edges by which each process' own interval is sought, shares of its length: before its intensities are,
#: and after.
FIRST_STEPS, LAST_STEPS = (0.04, 0.04, 0.02, 0.01), (0.01, 0.005, 0.0025, 0.00125)

#: Variance of the acceleration in flight, noise variance per frame^4: the frames before and after a contact tell it.
FLIGHT_KNOWN = 1e-4

#: Powers of ten of the intensities in contact that are weighed against each other, around the best.
AROUND_CONTACT = tuple(0.75 * i for i in range(-3, 4))

#: Logarithm of how much less likely ten times the intensity in flight is before the data. Only gravity and drag act
#: there, so where weak changes in contact could be taken for a restless flight, they are not.
QUIET_PREFERRED = 1.0


class Processes(NamedTuple):
    """The likeliest intervals (n, p, 2) and powers of ten of the likeliest intensities (n, k, p) of all p processes.

    The first is the rough one, the others are the smooth one with each of its springs.
    """

    windows: Tensor
    flight: Tensor
    contact: Tensor

    def evidence(self, series: Series, windows: Tensor) -> Tensor:
        """Likelihood (n, k, p, c) of intervals (n, p, c, 2) under each process, whatever its intensity."""
        contacts = series.times.new_tensor(AROUND_CONTACT)
        flight, contact = self.around(torch.zeros_like(contacts), contacts)
        place = torch.arange(1 + len(SPRINGS), device=contact.device)[:, None, None]
        found = fits(series, windows, flight, contact)
        found = (found + open_end(contact[..., None, :], windows[:, None, ..., None, :], place)).logsumexp(-1)
        return torch.where(series.seen.any(-1)[..., None, None], found, 0.0)

    def around(self, flights: Tensor, contacts: Tensor) -> tuple[Tensor, Tensor]:
        """Powers of ten (n, k, p, m) around those of the processes, by ``flights`` and ``contacts`` (m,)."""
        flight = (self.flight[..., None] + flights).clamp(math.log10(QUIETEST), 8.0)
        return flight, self.contact[..., None] + contacts

    def refined(self, series: Series, size: float) -> Processes:
        """The best neighbours of the intensities, by ``size`` powers of ten."""
        moves = torch.cartesian_prod(*2 * [size * series.times.new_tensor([0.0, -1.0, 1.0])])
        flight, contact = self.around(*moves.T)
        which = fits(series, self.windows[:, :, None], flight, contact)[..., 0, :].argmax(-1, keepdim=True)
        flight, contact = (v.gather(-1, which)[..., 0] for v in (flight, contact))
        return self._replace(flight=flight, contact=contact.clamp_max(12.0))

    def located(self, series: Series) -> Processes:
        """The likeliest interval of each process near that which it has, with its intensities."""
        return self._nearby(series, FIRST_STEPS).refined(series, 0.5)._nearby(series, LAST_STEPS)

    def _nearby(self, series: Series, steps: tuple[float, ...]) -> Processes:
        moves = torch.cartesian_prod(*2 * [series.times.new_tensor([0.0, -1.0, 1.0])])
        best = self
        for share in steps:
            step = share * (best.windows[..., 1] - best.windows[..., 0])[..., None, None]
            tried = possible_of_each(series, best.windows[:, :, None] + step * moves)
            top = fits(series, tried, best.flight[..., None], best.contact[..., None])[..., 0].sum(1).argmax(-1)
            best = best._replace(windows=tried.gather(2, top[..., None, None].expand(-1, -1, -1, 2))[:, :, 0])
        return best

    def pitch(self, series: Series) -> Tensor:
        """Standard deviations (n, p, 2) of the edges of each process, by how its likelihood falls."""
        pitch = torch.full_like(self.windows, 0.5)
        for _ in range(3):
            each = torch.diag_embed(pitch)
            cross = torch.cat((each, -each, torch.zeros_like(pitch)[:, :, None]), 2)
            tried = possible_of_each(series, self.windows[:, :, None] + cross)
            around = fits(series, tried, self.flight[..., None], self.contact[..., None])[..., 0].sum(1)
            drop = (2 * around[..., 4:] - around[..., :2] - around[..., 2:4]).clamp_min(1e-6)
            # An edge whose likelihood falls by 1/2 within a standard deviation; a flat one is known to a few frames.
            pitch = (pitch / drop.sqrt()).clamp(*PITCH)
        return pitch

    def of(self, springs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Numbers (n, c, 2) of the rough process and of that of the ``springs`` (n, c), and their powers of ten.

        The latter, (n, k, c, 2), are those of the intensities in flight and in contact.
        """
        place = 1 + (springs[..., None] == springs.new_tensor(SPRINGS)).int().argmax(-1)
        place = torch.stack((torch.zeros_like(place), place), -1)
        each = place[:, None].expand(-1, self.flight.shape[1], -1, -1)
        flight, contact = (v[:, :, None].expand(*each.shape[:3], -1).gather(-1, each) for v in self[1:])
        return place, flight, contact


def fits(series: Series, windows: Tensor, flight: Tensor, contact: Tensor) -> Tensor:
    """What `posterior` gives (n, k, p, c, m), of intervals (n, p, c, 2) and intensities (n, k, p, m) of p processes."""
    n, _, c, _ = windows.shape
    rough, _ = posterior(series, windows[:, 0], flight[:, :, :1], contact[:, :, :1])
    smooth = torch.ones(flight.shape[-1], dtype=torch.bool, device=flight.device)
    flight, contact = (v[:, :, 1:].repeat_interleave(c, 2) for v in (flight, contact))
    springs = windows.new_tensor(SPRINGS).repeat_interleave(c).expand(n, -1)
    swinging, _ = posterior(series, windows[:, 1:].flatten(1, 2), flight, contact, smooth, springs)
    return torch.cat((rough[:, :, None], swinging.unflatten(2, (-1, c))), 2)


def open_end(contact: Tensor, windows: Tensor, place: Tensor) -> Tensor:
    """Logarithm of the standard deviation of the end's acceleration before the data, that flight's beside it.

    Of powers of ten ``contact`` of the intensities of the processes number ``place``, in ``windows`` (..., 2); all of
    them are broadcast.
    """
    springs = np.array(SPRINGS)
    each = contact.new_tensor(np.concatenate((ending(None), ending(springs))))[place]
    power = torch.where(place > 0, 2 * STATES - 5, 2 * ROUGH - 5)
    length = windows[..., 1] - windows[..., 0]
    return 0.5 * (10.0**contact * each * length**power + FLIGHT_KNOWN).log()


def posterior(
    series: Series,
    windows: Tensor,
    flight: Tensor,
    contact: Tensor,
    smooth: Tensor | None = None,
    springs: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """As `log_likelihood`, with what is likely before the data."""
    fit, noise = log_likelihood(series, windows, flight, contact, smooth, springs)
    return fit - QUIET_PREFERRED * (flight - math.log10(QUIETEST)), noise


def possible(series: Series, windows: Tensor) -> Tensor:
    """Intervals within the recording, no shorter than the shortest."""
    begin, stop = series.times[:, :1], series.times[:, -1:]
    start = torch.minimum(torch.maximum(windows[..., 0], begin), stop - SHORTEST)
    end = torch.minimum(torch.maximum(windows[..., 1], start + SHORTEST), stop)
    return torch.stack((start, end), -1)


def possible_of_each(series: Series, windows: Tensor) -> Tensor:
    """As `possible`, of intervals (n, p, c, 2) or (n, p, 2)."""
    return possible(series, windows.flatten(1, -2)).view_as(windows)
