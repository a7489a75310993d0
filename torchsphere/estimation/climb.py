"""From an interval and intensities to where their likelihood is highest, step by step."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.estimation.contact_models import QUIETEST, possible, posterior
from torchsphere.estimation.likelihood import Series

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
