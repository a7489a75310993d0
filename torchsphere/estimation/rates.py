"""Rates of the pose in px, rad and frames, by the smoother or by local polynomials, and what describes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.estimation import bandwidth, contact_search, savitzky_golay
from torchsphere.estimation import rts as smooth
from torchsphere.estimation.contact_search import Contact
from torchsphere.estimation.filter_bank import UNKNOWN
from torchsphere.estimation.likelihood import Series
from torchsphere.estimation.measurements import FREEDOMS, Poses, joined, poses
from torchsphere.estimation.process_model import STATES
from torchsphere.estimation.rts import Smoothed
from torchsphere.tracking.track import Track

#: Motions drawn from what the data leave possible, for quantities that depend on many frames at once.
DRAWS = 400

#: They are made of all frames of a recording of up to so many, and of a longer one of so many before and after the
#: contact: what depends on many frames at once is the impact.
DRAWN_WHOLE, DRAWN_AROUND = 256, 100

#: Largest standard deviation of a smoothed value, in those of a pose's error, that says anything about it.
MEANINGLESS = 0.3 * UNKNOWN**0.5

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Drawn:
    """Motions (s of them) around a contact, as likely as the data leave them, in px, rad and frames.

    Attributes
    ----------
    rate, acceleration : ndarray
        (s, m, 5).
    interval : ndarray
        Start and end of the contact (s, 2).
    span : slice
        Which m of the recording's frames they are of.
    """

    rate: Array
    acceleration: Array
    interval: Array
    span: slice


@dataclass(frozen=True)
class Motion:
    """Rates of n frames in px, rad and frames, with the standard deviations of what each frame has of its own.

    Attributes
    ----------
    offset, sd_offset : ndarray
        Of the position from the measured one (n, 2).
    rate, acceleration, sd_rate, sd_acceleration : ndarray
        (n, 5); NaN where not known.
    drawn : Drawn or None
        None where no contact was found or sought.
    interval : tuple of ndarray or None
        Start and end (2,) of the contact and their standard deviations.
    about : dict
        Method, parameters, bandwidth per frame.
    """

    offset: Array
    rate: Array
    acceleration: Array
    sd_offset: Array
    sd_rate: Array
    sd_acceleration: Array
    drawn: Drawn | None
    interval: tuple[Array, Array] | None
    about: dict[str, Any]


def smoothed(tracks: Sequence[Track], times: Sequence[Array]) -> list[Motion]:
    """Smoothed motion of each track."""
    begins = [moments[0] for moments in times]
    all_poses = poses(tracks, [moments - begin for moments, begin in zip(times, begins, strict=True)])
    series = all_poses.series()
    found = contact_search.find(series)
    states = smooth.smooth(all_poses, found, DRAWS, _span(all_poses, found))
    mean = states.mean.numpy()
    sd = states.covariance.diagonal(dim1=-2, dim2=-1).sqrt().numpy().reshape(*mean.shape)
    motions = []
    for row, (moments, begin) in enumerate(zip(times, begins, strict=True)):
        part = slice(0, len(moments))
        unknown = _unknown(all_poses, states, sd, row)[part]
        hidden = np.where(unknown, np.nan, 1.0)
        lasting = np.sqrt(all_poses.drift[row, : len(moments) - 1].numpy().cumsum(0))
        lasting = np.concatenate((np.zeros((1, FREEDOMS)), lasting))[:, :2]
        is_there = bool(found.found[row])
        motions.append(
            Motion(
                offset=mean[row, part, 0, :2] * hidden[:, :2],
                rate=mean[row, part, 1] * hidden,
                acceleration=mean[row, part, 2] * hidden,
                sd_offset=np.hypot(sd[row, part, 0, :2], lasting) * hidden[:, :2],
                sd_rate=sd[row, part, 1] * hidden,
                sd_acceleration=sd[row, part, 2] * hidden,
                drawn=_drawn(states, row, begin, hidden) if is_there else None,
                interval=_edges(states, row, begin) if is_there else None,
                about=_about(series, found, states, row, len(moments)),
            )
        )
    return motions


def _span(all_poses: Poses, found: Contact) -> slice:
    """Frames whose states are drawn: around the contacts of all recordings."""
    t = all_poses.times.shape[1]
    if not found.found.any():
        return slice(0, 0)
    if t <= DRAWN_WHOLE:
        return slice(0, t)
    times, windows = all_poses.times[found.found], found.windows[found.found]
    limits = torch.stack((windows[..., 0].amin(1) - DRAWN_AROUND, windows[..., 1].amax(1) + DRAWN_AROUND), 1)
    places = torch.searchsorted(times, limits)
    return slice(int(places[:, 0].min()), int(places[:, 1].max()))


def _drawn(states: Smoothed, row: int, begin: float, hidden: Array) -> Drawn:
    """What was drawn of one recording; ``hidden`` (n, 5) is NaN where nothing is known, and 1 elsewhere."""
    first, stop, _ = states.span.indices(len(hidden))
    rate, acceleration = (states.drawn[:, row, : stop - first, k].numpy() * hidden[first:stop] for k in (1, 2))
    return Drawn(rate, acceleration, states.drawn_windows[:, row].numpy() + begin, slice(first, stop))


def _unknown(all_poses: Poses, states: Smoothed, sd: Array, row: int) -> NDArray[np.bool_]:
    """(t, 5), True before the first and after the last frame that was seen, and where nothing is known."""
    seen = all_poses.seen[row].numpy()
    outside = ~(np.maximum.accumulate(seen) & np.maximum.accumulate(seen[::-1])[::-1])
    return outside | (sd[row, :, :3] > MEANINGLESS * states.unit[row].numpy()).any(1)


def _edges(states: Smoothed, row: int, begin: float) -> tuple[Array, Array]:
    """Start and end (2,) of the contact and their standard deviations, by quantiles: softer contacts are but a few."""
    windows = states.windows[row].numpy()
    low, middle, high = np.quantile(windows, (0.159, 0.5, 0.841), axis=0)
    return middle + begin, 0.5 * (high - low)


def _about(series: Series, found: Contact, states: Smoothed, row: int, n: int) -> dict[str, Any]:
    """Method, parameters and bandwidth, per frame."""
    flight, factor = (v[row].median(0).values for v in (found.flight, found.noise))
    share = found.smooth[row].double().mean(0)
    kinds = [torch.where(found.smooth[row] == kind, found.contact[row], torch.nan) for kind in (False, True)]
    rough, smooth = (kind.nanmedian(0).values.nan_to_num() for kind in kinds)
    touching = torch.where(share > 0.5, smooth, rough)
    used = found.springs[row][found.smooth[row].any(-1)]
    spring = float(used.median()) if len(used) else 0.0
    about: dict[str, Any] = {
        "method": "smoother",
        "process": "white jerk in flight; in contact rough (white snap) or smooth (white crackle and a spring that "
        "turns so many half turns), as the data say",
        "share_smooth": share.tolist(),
        "spring_half_turns": spring,
        "intensity_flight": flight.tolist(),
        "intensity_contact_rough": rough.tolist(),
        "intensity_contact_smooth": smooth.tolist(),
        "intensity_unit": "variance of a pose's error per frame^5 (flight), frame^7 (rough) and frame^9 (smooth); "
        "x, y, wx, wy, wz, each without the errors that quieter ones show, as is the noise",
        "noise_over_stated": factor.tolist(),
        "contact_found": bool(found.found[row]),
        "log_likelihood_gain_of_contact": float(found.gain[row]),
    }
    times = series.times[row, :n].numpy()
    window = tuple(states.windows[row].mean(0).tolist())
    places = {"flight": _flight_frame(times, window)}
    if about["contact_found"]:
        places["contact"] = int(np.abs(times - np.mean(window)).argmin())
    for name, group in (("translation", slice(0, 2)), ("rotation", slice(2, FREEDOMS))):
        # The degree of freedom that moves most; over a contact's length both processes give a force the same units.
        strength = torch.where(share > 0.5, smooth * (window[1] - window[0]) ** 2, rough) + flight
        freedom = group.start + int(strength[group].argmax())
        seen = series.seen[row, freedom, :n].numpy()
        if seen.sum() < STATES:
            continue
        noise = np.where(seen, series.variance[row, freedom, :n].numpy(), np.inf)
        for regime, at in places.items():
            own = float(flight[freedom]), (float(touching[freedom]), spring if share[freedom] > 0.5 else None)
            weights, part = bandwidth.smoother_weights(times, noise, window, *own, at)
            offsets = times[part] - times[at]
            passed = [bandwidth.cutoff(weights[k], offsets, k + 1) for k in (0, 1)]
            about[f"bandwidth_{regime}_{name}_per_frame"] = dict(zip(("rate", "acceleration"), passed, strict=True))
    return about


def _flight_frame(times: Array, window: tuple[float, ...]) -> int:
    """The middle frame of the longer flight."""
    before, after = times[times <= window[0]], times[times >= window[1]]
    longer = before if len(before) >= len(after) else after
    return int(np.searchsorted(times, longer[len(longer) // 2]))


def polynomials(track: Track, times: Array, method: str, window: int, order: int) -> Motion:
    """Motion by local polynomials."""
    plain = method == "differences"
    window, order = (3, 2) if plain else (window, order)
    measured = poses([track], [times])
    variance = np.diagonal(measured.covariance[0].numpy(), axis1=1, axis2=2)
    increment = measured.step[0].numpy()
    found = savitzky_golay.rates(
        times, increment, joined(track), variance, window=window, order=order, shifted=not plain
    )
    seen = np.isfinite(track.position)
    lasting = np.concatenate((np.zeros((1, 2)), measured.drift[0, :, :2].numpy().cumsum(0)))
    passed = [bandwidth.cutoff(found.weights[k], found.offsets, k + 1) for k in (0, 1)]
    return Motion(
        offset=np.where(seen, 0.0, np.nan),
        rate=found.first,
        acceleration=found.second,
        sd_offset=np.where(seen, np.sqrt(variance[:, :2] + lasting), np.nan),
        sd_rate=np.sqrt(found.variance_first),
        sd_acceleration=np.sqrt(found.variance_second),
        drawn=None,
        interval=None,
        about={
            "method": method,
            "window_frames": window,
            "order": order,
            "bandwidth_per_frame": dict(zip(("rate", "acceleration"), passed, strict=True)),
        },
    )
