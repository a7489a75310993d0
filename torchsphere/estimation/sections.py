"""Recordings of any length and with several impacts: windows around the forces, joined with the flights between.

A recording of common length with at most one force is smoothed as a whole. In any other one each force gets a window of
its own, which is smoothed with the full model of a contact. The flights between are smoothed without a contact.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.estimation import contact_search, rts
from torchsphere.estimation.contact_search import Contact
from torchsphere.estimation.measurements import FREEDOMS, Poses, poses
from torchsphere.estimation.rates import Motion, MotionContact, motion_of_states, smoothed_whole
from torchsphere.motion.track import Track
from torchsphere.runtime.arrays import Array

#: Longest recording that is smoothed as a whole, frames (docs/constants.toml).
MAX_UNDIVIDED_FRAMES = 512

#: Frames of flight on either side of a force in its window (docs/constants.toml).
WINDOW_MARGIN = 64

#: Frames next to a force at which its window alone counts (docs/constants.toml).
OWN_MARGIN = 12

#: Frames that give the intensity of a flight (docs/constants.toml).
FLIGHT_SAMPLE = 384

#: Fewest frames of a flight that is smoothed by itself: the windows of the forces around it cover a shorter one.
MIN_FLIGHT = 2 * OWN_MARGIN

#: Least share of a motion in the frames that it covers (docs/constants.toml).
MIN_SHARE = 1e-6

Span = tuple[int, int]

#: Steps on either side of a frame whose slopes are compared (docs/constants.toml).
SLOPE_STEPS = (4, 16)

#: Change of the slope that is a force, in standard deviations (docs/constants.toml).
MIN_SLOPE_CHANGE_SD = 8.0

#: Steps of flight that part two forces (docs/constants.toml).
PARTING_STEPS = 8


def smoothed(tracks: Sequence[Track], times: Sequence[Array]) -> list[Motion]:
    """Smoothed motion of each track at its ``times``, frames."""
    # A ball that stays in its place hits nothing.
    flies = [not track.settings.get("in_place") for track in tracks]
    motions: dict[int, Motion] = {}
    whole = []
    for number, (track, moments) in enumerate(zip(tracks, times, strict=True)):
        own = poses([track], [moments - moments[0]])
        spans = _spans(own) if flies[number] else []
        if len(moments) <= MAX_UNDIVIDED_FRAMES and len(spans) <= 1:
            whole.append(number)
        else:
            motions[number] = _in_sections(own, spans, float(moments[0]), is_flying=flies[number])
    if whole:
        begins = [float(times[number][0]) for number in whole]
        all_poses = poses([tracks[i] for i in whole], [times[i] - times[i][0] for i in whole])
        fly = torch.tensor([flies[i] for i in whole])
        for i, motion in zip(
            whole, smoothed_whole(all_poses, fly, begins, [len(times[i]) for i in whole]), strict=True
        ):
            motions[i] = replace(motion, about=motion.about | {"in_place": not flies[i]})
    return [motions[number] for number in range(len(tracks))]


def _spans(own: Poses) -> list[Span]:
    """Spans of force along x and y."""
    series = own.series()
    value, variance, seen = (v[0, :2].numpy() for v in (series.value, series.variance, series.seen))
    return force_spans(series.times[0].numpy(), value, variance, seen)


def _in_sections(own: Poses, spans: list[Span], begin: float, *, is_flying: bool) -> Motion:
    """Motion of one recording from windows around its ``spans`` of force and the flights between."""
    n = own.times.shape[1]
    middles = [(a[1] + b[0]) // 2 for a, b in itertools.pairwise(spans)]
    limits = [
        (max(low, span[0] - WINDOW_MARGIN), min(high, span[1] + WINDOW_MARGIN + 1))
        for span, low, high in zip(spans, [0, *middles], [*middles, n], strict=False)
    ]
    windows = [_window(own, begin, limit) for limit in limits]
    # The weak ends of a force stay out of the flights.
    half = OWN_MARGIN // 2
    edges = [0, *(edge for a, b in spans for edge in (max(a - half, 0), min(b + half, n - 1))), n - 1]
    flights = [(edges[i], edges[i + 1] + 1) for i in range(0, len(edges), 2)]
    parts = [_flight(own, begin, flight) for flight in flights]
    pieces = [(flight, part) for flight, part in zip(flights, parts, strict=True) if part is not None]
    shares = [_share(limit, span, n) for limit, span in zip(limits, spans, strict=True)]
    contacts = tuple(contact for window in windows for contact in window.contacts)
    joined = _joined(own, [*zip(limits, windows, strict=True)], shares, pieces)
    named = max((w for w in windows if w.contacts), key=_strength, default=None)
    about = (named or (windows[0] if windows else pieces[0][1])).about
    about = about | {"contacts_found": len(contacts), "in_place": not is_flying}
    return replace(joined, contacts=contacts, about=about)


def _strength(window: Motion) -> float:
    return float(np.nan_to_num(np.abs(window.acceleration[:, :2])).max())


def _cut(own: Poses, limit: Span) -> Poses:
    """Poses of the frames ``limit``, from the first up to the one before the last."""
    a, b = limit
    times = own.times[:, a:b] - own.times[:, a : a + 1]
    return Poses(times, own.step[:, a : b - 1], own.covariance[:, a:b], own.drift[:, a : b - 1], own.seen[:, a:b])


def _window(own: Poses, begin: float, limit: Span) -> Motion:
    """Motion of a window with its contact, in the frames' numbers and times of the recording."""
    first = limit[0]
    start = begin + float(own.times[0, first])
    [motion] = smoothed_whole(_cut(own, limit), torch.tensor([True]), [start], [limit[1] - first])
    return replace(motion, contacts=tuple(_shifted(contact, first) for contact in motion.contacts))


def _shifted(contact: MotionContact, first: int) -> MotionContact:
    span = contact.samples.span
    return replace(contact, samples=replace(contact.samples, span=slice(span.start + first, span.stop + first)))


def _flight(own: Poses, begin: float, limit: Span) -> Motion | None:
    """Motion of a flight, with the intensity that a part of it shows; None if it is too short."""
    a, b = limit
    if b - a < MIN_FLIGHT:
        return None
    part = _cut(own, limit)
    if int(part.seen.all(-1).sum()) < MIN_FLIGHT:
        return None
    series = part.series()
    middle = max(0, (b - a - FLIGHT_SAMPLE) // 2)
    sample = series.between(middle, min(b - a, middle + FLIGHT_SAMPLE))
    found = contact_search.find(sample, torch.tensor([False]))
    state = rts.smooth(part, _single(found), 1, slice(0, 0))
    return motion_of_states(part, series, _single(found), state, 0, begin + float(own.times[0, a]), b - a)


def _single(found: Contact) -> Contact:
    """The middle one of the equally likely intensities alone: many would take much memory in a long flight."""

    def middle(values: torch.Tensor) -> torch.Tensor:
        return values.log().median(1, keepdim=True).values.exp()

    return replace(
        found,
        windows=found.windows[:, :1],
        flight=middle(found.flight),
        contact=found.contact[:, :1],
        formed=found.formed[:, :1],
        forms=found.forms[:, :1],
        noise=middle(found.noise),
    )


def _share(limit: Span, span: Span, n: int) -> Array:
    """Share (n,) of a window: 1 at its force, falling to 0 at its ends."""
    frames = np.arange(n)
    rise = (frames - limit[0] + 1) / max(span[0] - OWN_MARGIN - limit[0], 1)
    fall = (limit[1] - frames) / max(limit[1] - span[1] - OWN_MARGIN - 1, 1)
    share = np.clip(np.minimum(rise, fall), 0, 1)
    # Without a kink at either end: the variances of the two may differ by a factor of 50.
    share = share**2 * (3 - 2 * share)
    return np.where((frames >= limit[0]) & (frames < limit[1]), share, 0.0)


def _joined(
    own: Poses, windows: list[tuple[Span, Motion]], shares: list[Array], flights: list[tuple[Span, Motion]]
) -> Motion:
    """Motion of the whole recording: windows and flights, whose values and bands pass into each other.

    Each counts by its share over its variance. The standard deviation is that of errors that are alike, since both rest
    on the same frames.
    """
    n = own.times.shape[1]
    weighed = [
        *((limit, motion, share) for (limit, motion), share in zip(windows, shares, strict=True)),
        *((limit, motion, 1 - np.sum([np.zeros(n), *shares], axis=0)) for limit, motion in flights),
    ]
    lasting = np.sqrt(np.concatenate((np.zeros((1, FREEDOMS)), own.drift_variance[0].numpy().cumsum(0))))[:, :2]
    names = {"offset": 2, "rate": FREEDOMS, "acceleration": FREEDOMS}
    total = {f"{kind}{name}": np.zeros((n, width)) for name, width in names.items() for kind in ("", "sd_")}
    weight = {name: np.zeros((n, width)) for name, width in names.items()}
    for limit, motion, share in weighed:
        part = slice(*limit)
        for name in names:
            value, sd = getattr(motion, name), getattr(motion, f"sd_{name}")
            sd = np.hypot(sd, lasting[limit[0]]) if name == "offset" else sd
            # A frame that only one of them covers is that one's alone.
            is_known = np.isfinite(value) & (sd > 0)
            w = np.where(is_known, np.maximum(share[part], MIN_SHARE)[:, None] / np.where(is_known, sd, 1.0) ** 2, 0.0)
            weight[name][part] += w
            total[name][part] += w * np.nan_to_num(value)
            total[f"sd_{name}"][part] += w * np.nan_to_num(sd)
    divided = {}
    for key, values in total.items():
        known = weight[key.removeprefix("sd_")]
        divided[key] = np.where(known > 0, values / np.where(known > 0, known, 1.0), np.nan)
    return Motion(**divided, contacts=(), about={})


def force_spans(times: Array, value: Array, variance: Array, seen: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last frame of each span in which a force acts.

    Parameters
    ----------
    times : ndarray
        (n,), rising, frames.
    value, variance : ndarray
        Independent values (k, n) and the variances of their errors.
    seen : ndarray
        (k, n), bool; a frame counts where all values were seen.
    """
    frames = np.flatnonzero(seen.all(0))
    time, value, variance = times[frames], value[:, frames], variance[:, frames]
    near, wide = (_is_forced(time, value, variance, steps) for steps in SLOPE_STEPS)
    # The short slopes say where a force is; the long slopes find weak forces, too, but blur them.
    spans = _runs(near)
    blur = SLOPE_STEPS[1]
    spans += [span for span in _runs(wide) if not any(a - blur <= span[1] and span[0] <= b + blur for a, b in spans)]
    return [(int(frames[a]), int(frames[b])) for a, b in sorted(spans)]


def _is_forced(time: Array, value: Array, variance: Array, steps: int) -> NDArray[np.bool_]:
    """(n,), True where the slopes before and after a frame differ by more than noise and a steady acceleration do."""
    forced = np.zeros(len(time), dtype=bool)
    if len(time) < 4 * steps:
        return forced
    windows = np.lib.stride_tricks.sliding_window_view
    moment = windows(time, steps + 1)
    moment = moment - moment.mean(-1, keepdims=True)
    gain = moment / (moment**2).sum(-1, keepdims=True)
    slope = (windows(value, steps + 1, axis=1) * gain).sum(-1)
    slope_variance = (windows(variance, steps + 1, axis=1) * gain**2).sum(-1)
    change = slope[:, steps:] - slope[:, :-steps]
    change -= np.median(change, axis=1, keepdims=True)
    stated = slope_variance[:, steps:] + slope_variance[:, :-steps]
    # Errors of neighbouring frames may be alike, and larger than stated.
    seen_variance = (1.4826 * np.median(np.abs(change), axis=1, keepdims=True)) ** 2
    score = change**2 / np.maximum(stated, seen_variance)
    forced[steps : len(time) - steps] = (score > MIN_SLOPE_CHANGE_SD**2).any(0)
    return forced


def _runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of the runs of True, joined across less than `PARTING_STEPS`."""
    indices = np.flatnonzero(mask)
    if not len(indices):
        return []
    parts = np.split(indices, np.flatnonzero(np.diff(indices) > PARTING_STEPS) + 1)
    return [(int(part[0]), int(part[-1])) for part in parts]
