"""Search for the contact and for the intensities of the process, by maximum likelihood.

A degree of freedom has an intensity in flight, a process and an intensity in contact, and a factor on its stated noise;
all share the contact interval. The interval is searched with the rough process, and then weighed under all processes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.estimation.likelihood import Series
from torchsphere.estimation.model_averaging import (
    CANDIDATES,
    draw_candidates,
    draw_intensities,
    fit_processes,
    without_contact,
)
from torchsphere.estimation.process_fits import clamped, grid_steps, posterior
from torchsphere.estimation.process_noise import CONTACT_GRID, CONTACT_RANGE, FLIGHT_GRID, FLIGHT_RANGE, MAX_CONTACT

#: Shortest step of an edge in the search with the rough process, frames (docs/constants.toml).
MIN_EDGE_STEP = 0.1

#: Steps of the intensities, powers of ten, in the rounds of the three stages of the search. The last stage repeats its
#: own until the steps of the edges, which are halved after each round, are the shortest (docs/constants.toml).
INTENSITY_STEPS = ((1.5, 0.9), (0.5, 0.3, 0.2), (0.2,))
COARSE, MEDIUM, FINE = INTENSITY_STEPS

#: Fewest rounds of a search, so that the intensities are refined, too, where the first steps of the edges are short.
MIN_ROUNDS = 4

#: Moves of the two edges, in steps; the far moves because the likelihood has several maxima.
EDGE_MOVES = (
    (0, 0),
    *((a * d, b * d) for d in (1, 3) for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1))),
)

#: Intensities of the first search, powers of ten, in flight and in contact (docs/constants.toml).
START_FLIGHT, START_CONTACT = (-11.0, -8.0, -5.0), (-9.0, -4.0, -1.5, 0.5, 2.5, 4.5)

#: Number of first intervals, and the longest as a power of two of their spacing (docs/constants.toml).
STARTS, LONGEST = 16, 3

#: Frames that are searched at once (docs/constants.toml).
MAX_FRAMES = 128

#: Margin of the next, finer search around the edges, and its shortest edge step, in frame spacings
#: (docs/constants.toml).
MARGIN, EDGE_STEP = 4, 0.25

#: Frames before and after the contact that are weighed for its edges (docs/constants.toml).
FLIGHT_FRAMES = 128


class IntervalFit(NamedTuple):
    """The likeliest interval of each recording."""

    window: Tensor  # (n, 2), frames
    flight: Tensor  # powers of ten of the intensities (n, k)
    contact: Tensor  # powers of ten of the intensities (n, k)
    top: Tensor  # log-posterior (n,)


@dataclass(frozen=True)
class Contact:
    """Contact intervals and intensities of n recordings: c equally likely sets of them, for k degrees of freedom."""

    found: Tensor  # (n,), whether a contact makes the data likelier by more than its parameters cost
    windows: Tensor  # intervals (n, c, 2), frames; of length 0 where no contact was found
    flight: Tensor  # intensities (n, c, k), noise variance per frame^5
    contact: Tensor  # intensities (n, c, k), noise variance per frame^7
    formed: Tensor  # (n, c, k), True where the force has a form, False where the process is the rough one
    forms: Tensor  # forms (n, c, 6)
    noise: Tensor  # factor (n, c, k) on the stated standard deviation of each separated value (`measurements`)
    gain: Tensor  # log-likelihood ratio (n,) with and without contact


def find(series: Series, sought: Tensor | None = None) -> Contact:
    """Contact and intensities of each recording; only where ``sought`` (n,) is True, if it is given, a contact."""
    no_window = series.times.new_zeros(len(series.times), 2)
    free = _best_intensities(series, no_window, *_intensity_grid(series, FLIGHT_GRID, (-math.inf,)))
    is_sought = sought is None or bool(sought.any())
    window, flight, contact, top = _best_interval(series) if is_sought else free
    gain = top - free.top
    counts = series.seen.sum((1, 2)).double().clamp_min(2.0)
    # Schwarz's criterion: two edges, and an intensity per degree of freedom that was seen.
    found = gain > 0.5 * (2 + series.seen.any(-1).sum(1)) * counts.log()
    found = found if sought is None else found & sought
    window = torch.where(found[:, None], window, no_window)
    flight = torch.where(found[:, None], flight, free.flight)
    contact = torch.where(found[:, None], contact, -math.inf)
    if found.any():
        part = _around_contacts(series, window[found])
        best, chosen = draw_candidates(part, fit_processes(part, window, flight, contact))
    else:
        best, chosen = without_contact(window, flight)
    # Without contact the two processes are the same.
    possible = torch.where(found[:, None, None, None], chosen.possible, chosen.possible.new_tensor([True, False]))
    windows = torch.where(found[:, None, None], chosen.windows, 0.0)
    chosen = chosen._replace(windows=windows, possible=possible)
    flight, contact, formed, noise = draw_intensities(series, chosen, best)
    windows, forms = (v.expand(-1, CANDIDATES, -1) for v in (chosen.windows, chosen.forms))
    return Contact(found, windows, flight, contact, formed, forms, noise, gain)


def _around_contacts(series: Series, windows: Tensor) -> Series:
    """The frames around all of the contacts ``windows`` (m, 2)."""
    first, last = windows[:, 0].min() - FLIGHT_FRAMES, windows[:, 1].max() + FLIGHT_FRAMES
    inside = ((series.times >= first) & (series.times <= last)).any(0).nonzero()[:, 0]
    return series.between(int(inside[0]), int(inside[-1]) + 1)


def _best_interval(series: Series) -> IntervalFit:
    """The likeliest interval of each recording."""
    if series.times.shape[1] <= MAX_FRAMES:
        return _global_maximum(series)
    each = [_best_of_long(series.rows(slice(number, number + 1))) for number in range(len(series.times))]
    return IntervalFit(*(torch.cat(values) for values in zip(*each, strict=True)))


def _best_of_long(series: Series) -> IntervalFit:
    """The likeliest interval of one long recording, searched among few of its frames, then among more but nearer.

    Frames far from the contact tell little of its edges: a search among all of 300 frames took ten seconds.
    """
    # A shorter recording is padded to the longest of the batch.
    seen = torch.nonzero(series.seen[0].any(0))
    t = int(seen[-1]) + 1 if len(seen) else series.times.shape[1]
    every = math.ceil(t / MAX_FRAMES)
    best = _global_maximum(series.between(0, t, every), EDGE_STEP * every)
    while every > 1:
        margin = max(MARGIN * every, MAX_FRAMES // 3)
        limits = best.window[0] + best.window.new_tensor([-margin, margin + 1])
        start, stop = torch.searchsorted(series.times[0, :t].contiguous(), limits).clamp(0, t).tolist()
        finer = every // 2
        if stop - start > 2 * MAX_FRAMES * finer:
            # The contact is too long for a finer search; its edges are known well enough.
            break
        part = series.between(start, stop, finer)
        shortest = MIN_EDGE_STEP if finer == 1 else EDGE_STEP * finer
        best = _local_maximum(part, best, best.window.new_tensor([float(every)]), shortest)
        every = finer
    best = _with_best_intensities(series, best._replace(window=clamped(series, best.window[:, None])[:, 0]))
    step = best.window.new_tensor([2 * MIN_EDGE_STEP])
    for size in MEDIUM[:2]:
        best = _refined(series, best, step, size)
    return best


def _global_maximum(series: Series, shortest_step: float = MIN_EDGE_STEP) -> IntervalFit:
    """The highest of the maxima reached from the starts of all lengths."""
    many = series.repeated(LONGEST + 1)
    each = _local_maximum(many, _starts(series), _start_spacing(many), shortest_step)
    top, number = each.top.unflatten(0, (-1, LONGEST + 1)).max(-1)
    rows = torch.arange(len(number), device=number.device) * (LONGEST + 1) + number
    return IntervalFit(each.window[rows], each.flight[rows], each.contact[rows], top)


def _start_spacing(series: Series) -> Tensor:
    """Distance (n,) of the starts of the first search, frames."""
    return ((series.times[:, -1] - series.times[:, 0]) / STARTS).clamp_min(1.0)


def _starts(series: Series) -> IntervalFit:
    """The likeliest first interval of each of s lengths, for each recording: n s of them."""
    spacing, begin = _start_spacing(series), series.times[:, 0]
    flight, contact = _intensity_grid(series, START_FLIGHT, START_CONTACT)
    places = [(start, start + 2**j) for j in range(LONGEST + 1) for start in range(STARTS - 2**j + 1)]
    windows = begin[:, None, None] + spacing[:, None, None] * torch.tensor(places).to(series.times)
    counts = [STARTS - 2**j + 1 for j in range(LONGEST + 1)]
    fits = posterior(series, windows, flight, contact)[0].split(counts, 2)
    each = [_best_of(fit, part, flight, contact) for fit, part in zip(fits, windows.split(counts, 1), strict=True)]
    return IntervalFit(*(torch.stack(values, 1).flatten(0, 1) for values in zip(*each, strict=True)))


def _local_maximum(series: Series, best: IntervalFit, step: Tensor, shortest_step: float) -> IntervalFit:
    """The maximum of the posterior reached from a start, with edge steps from ``step`` (n,) to the shortest."""
    rounds = max(MIN_ROUNDS, 2 + math.ceil(math.log2(float(step.max()) / shortest_step)))
    best, step = _after_stage(series, best, step, shortest_step, COARSE)
    left = rounds - len(COARSE)
    for sizes in (MEDIUM[:left], (left - len(MEDIUM)) * FINE):
        if sizes:
            # The intensities of a degree of freedom have several maxima, too.
            best = _with_best_intensities(series, best)
            best, step = _after_stage(series, best, step, shortest_step, sizes)
    return best


def _after_stage(
    series: Series, best: IntervalFit, step: Tensor, shortest_step: float, sizes: tuple[float, ...]
) -> tuple[IntervalFit, Tensor]:
    """The best interval after a round for each of the steps ``sizes`` of the intensities, and the next edge step."""
    moved = torch.ones_like(best.top, dtype=torch.bool)
    last = (step, sizes[0])
    for size in sizes:
        moved |= (step != last[0]) | (size != last[1])
        last = (step, size)
        for _ in range(2):
            best, moved = _refined_rows(series, best, step, size, moved)
        step = (0.5 * step).clamp_min(shortest_step)
    return best, step


def _refined_rows(
    series: Series, best: IntervalFit, step: Tensor, size: float, rows: Tensor
) -> tuple[IntervalFit, Tensor]:
    """Refine the marked ``rows`` (n,), and mark those that changed: unchanged rows are at their maximum."""
    numbers = rows.nonzero()[:, 0]
    if not len(numbers):
        return best, rows
    old = IntervalFit(*(values[numbers] for values in best))
    new = _refined(series.rows(numbers), old, step[numbers], size)
    differs = [(a != b).flatten(1).any(1) for a, b in zip(new[:3], old[:3], strict=True)]
    best = IntervalFit(*(values.index_copy(0, numbers, part) for values, part in zip(best, new, strict=True)))
    return best, rows.index_copy(0, numbers, torch.stack(differs).any(0))


def _refined(series: Series, best: IntervalFit, step: Tensor, size: float) -> IntervalFit:
    """The best neighbour of an interval and its intensities, by ``step`` (n,) frames and ``size`` powers of ten."""
    windows = clamped(series, best.window[:, None] + step[:, None, None] * series.times.new_tensor(EDGE_MOVES))
    flights, contacts = (size * grid_steps(series)).T
    flight = (best.flight[..., None, None] + flights).clamp(*FLIGHT_RANGE)
    contact = (best.contact[..., None, None] + contacts).clamp(CONTACT_RANGE[0], MAX_CONTACT)
    return _best_of(posterior(series, windows, flight, contact)[0], windows, flight, contact)


def _intensity_grid(series: Series, flights: tuple[float, ...], contacts: tuple[float, ...]) -> tuple[Tensor, Tensor]:
    """All pairs (n, k, 1, m) of powers of ten in flight and in contact."""
    pairs = torch.cartesian_prod(torch.tensor(flights), torch.tensor(contacts)).to(series.times)
    flight, contact = pairs.T[:, None, None, None].expand(-1, *series.value.shape[:2], 1, -1)
    return flight, contact


def _with_best_intensities(series: Series, best: IntervalFit) -> IntervalFit:
    """The same intervals with the best intensities of the whole grid."""
    found = _best_intensities(series, best.window, *_intensity_grid(series, FLIGHT_GRID, CONTACT_GRID))
    return best._replace(flight=found.flight, contact=found.contact)


def _best_intensities(series: Series, window: Tensor, flight: Tensor, contact: Tensor) -> IntervalFit:
    """The best of the intensities (n, k, 1, m) at one interval (n, 2) each."""
    return _best_of(posterior(series, window[:, None], flight, contact)[0], window[:, None], flight, contact)


def _best_of(fit: Tensor, windows: Tensor, flight: Tensor, contact: Tensor) -> IntervalFit:
    """The highest log-posterior (n, k, c, m) of all k degrees of freedom together."""
    n, k, c, m = fit.shape
    per_window, which = fit.max(-1)
    top, place = per_window.sum(1).max(-1)
    rows = torch.arange(n, device=fit.device)
    chosen = which.gather(-1, place[:, None, None].expand(n, k, 1))
    freedom = torch.arange(k, device=fit.device)

    def at_best(values: Tensor) -> Tensor:
        return values.expand(n, k, c, m)[rows[:, None], freedom, place[:, None]].gather(-1, chosen)[..., 0]

    return IntervalFit(windows[rows, place], at_best(flight), at_best(contact), top)
