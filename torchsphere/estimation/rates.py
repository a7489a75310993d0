"""Rates of the pose in px, rad and frames, by the smoother or by local polynomials, and their bandwidth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.estimation import bandwidth, contact_search, force_forms, rts, savitzky_golay
from torchsphere.estimation.contact_search import Contact
from torchsphere.estimation.likelihood import Series
from torchsphere.estimation.measurements import FREEDOMS, Poses, measured_increments, poses
from torchsphere.estimation.process_model import PRIOR_VARIANCE, STATES
from torchsphere.estimation.rts import Smoothed
from torchsphere.estimation.spread import sd_of_errors
from torchsphere.motion.track import Track
from torchsphere.runtime.arrays import Array

#: Motions drawn from the posterior, for quantities that depend on many frames at once (docs/constants.toml).
SAMPLES = 400

#: Longest recording whose samples hold all frames, else frames before and after the contact (docs/constants.toml).
MAX_WHOLE_FRAMES, MARGIN_FRAMES = 256, 100

#: Largest standard deviation of a value that means anything, in those of a pose's error (docs/constants.toml).
MAX_SD = 0.5 * PRIOR_VARIANCE**0.5


@dataclass(frozen=True)
class MotionSamples:
    """Motions (s of them) around a contact, drawn from the posterior, in px, rad and frames."""

    rate: Array  # (s, m, 5)
    acceleration: Array  # (s, m, 5)
    interval: Array  # start and end of the contact (s, 2)
    span: slice  # the m frames of the recording
    # Accelerations x and y (s, m, j, 2) after each frame, less the straight line to the next one, at the shares (j,).
    between: Array
    fractions: Array


@dataclass(frozen=True)
class MotionContact:
    """A contact: motions drawn around it, its start and end (2,) in frames, and their standard deviations."""

    samples: MotionSamples
    interval: Array  # (2,)
    sd_interval: Array  # (2,)


@dataclass(frozen=True)
class Motion:
    """Rates of n frames in px, rad and frames, with their standard deviations; NaN where not known."""

    offset: Array  # of the position from the measured position (n, 2)
    rate: Array  # (n, 5)
    acceleration: Array  # (n, 5)
    sd_offset: Array  # (n, 2)
    sd_rate: Array  # (n, 5)
    sd_acceleration: Array  # (n, 5)
    contacts: tuple[MotionContact, ...]  # of all impacts, in their order
    about: dict[str, Any]  # method, parameters, bandwidth per frame

    @property
    def strongest(self) -> MotionContact | None:
        """The contact with the largest acceleration in the image plane."""
        return max(self.contacts, key=self._largest_acceleration, default=None)

    def _largest_acceleration(self, contact: MotionContact) -> float:
        drawn = np.linalg.norm(contact.samples.acceleration[..., :2].mean(0), axis=-1)
        return float(np.nan_to_num(drawn).max(initial=0.0))


def smoothed_whole(all_poses: Poses, flies: Tensor, begins: Sequence[float], counts: Sequence[int]) -> list[Motion]:
    """Smoothed motion of recordings with at most one contact each.

    ``flies`` (n,) is False where no contact is sought, ``begins`` are the times of the first frames and ``counts`` the
    numbers of frames.
    """
    series = all_poses.series()
    found = contact_search.find(series, flies)
    states = rts.smooth(all_poses, found, SAMPLES, _sample_span(all_poses, found))
    return [
        motion_of_states(all_poses, series, found, states, row, begin, count)
        for row, (count, begin) in enumerate(zip(counts, begins, strict=True))
    ]


def motion_of_states(
    all_poses: Poses, series: Series, found: Contact, states: Smoothed, row: int, begin: float, count: int
) -> Motion:
    """Motion of one recording from its states."""
    mean = states.mean[row].numpy()
    sd = states.covariance[row].diagonal(dim1=-2, dim2=-1).sqrt().numpy().reshape(*mean.shape)
    part = slice(0, count)
    mask = np.where(_is_unknown(all_poses, states, sd, row)[part], np.nan, 1.0)
    drift = np.sqrt(all_poses.drift_variance[row, : count - 1].numpy().cumsum(0))
    drift = np.concatenate((np.zeros((1, FREEDOMS)), drift))[:, :2]
    return Motion(
        offset=mean[part, 0, :2] * mask[:, :2],
        rate=mean[part, 1] * mask,
        acceleration=mean[part, 2] * mask,
        sd_offset=np.hypot(sd[part, 0, :2], drift) * mask[:, :2],
        sd_rate=sd[part, 1] * mask,
        sd_acceleration=sd[part, 2] * mask,
        contacts=(_contact(states, row, begin, mask),) if bool(found.found[row]) else (),
        about=_about(series, found, states, row, count),
    )


def _sample_span(all_poses: Poses, found: Contact) -> slice:
    """Frames whose states are drawn: around the contacts of all recordings."""
    t = all_poses.times.shape[1]
    if not found.found.any():
        return slice(0, 0)
    if t <= MAX_WHOLE_FRAMES:
        return slice(0, t)
    times, windows = all_poses.times[found.found], found.windows[found.found]
    limits = torch.stack((windows[..., 0].amin(1) - MARGIN_FRAMES, windows[..., 1].amax(1) + MARGIN_FRAMES), 1)
    frames = torch.searchsorted(times, limits)
    return slice(int(frames[:, 0].min()), int(frames[:, 1].max()))


def _contact(states: Smoothed, row: int, begin: float, mask: Array) -> MotionContact:
    return MotionContact(_samples(states, row, begin, mask), *_interval(states, row, begin))


def _samples(states: Smoothed, row: int, begin: float, mask: Array) -> MotionSamples:
    """Samples of one recording; ``mask`` (n, 5) is NaN where nothing is known, and 1 elsewhere."""
    first, stop, _ = states.span.indices(len(mask))
    rate, acceleration = (states.samples[:, row, : stop - first, k].numpy() * mask[first:stop] for k in (1, 2))
    interval = states.sample_windows[:, row].numpy() + begin
    between = states.between[:, row, : stop - first].numpy()
    return MotionSamples(rate, acceleration, interval, slice(first, stop), between, states.fractions)


def _is_unknown(all_poses: Poses, states: Smoothed, sd: Array, row: int) -> NDArray[np.bool_]:
    """(t, 5), True before the first and after the last frame that was seen, and where nothing is known."""
    seen = all_poses.seen[row].numpy()
    outside = ~(np.maximum.accumulate(seen) & np.maximum.accumulate(seen[::-1])[::-1])
    return outside | (sd[:, :3] > MAX_SD * states.unit[row].numpy()).any(1)


def _interval(states: Smoothed, row: int, begin: float) -> tuple[Array, Array]:
    """Start and end (2,) of the contact and their standard deviations, by quantiles, which ignore the soft edges."""
    windows = states.windows[row].numpy()
    middle = np.median(windows, axis=0)
    return middle + begin, sd_of_errors(windows - middle)


def _about(series: Series, found: Contact, states: Smoothed, row: int, n: int) -> dict[str, Any]:
    """Method, parameters and bandwidth, per frame."""
    flight, factor = (v[row].median(0).values for v in (found.flight, found.noise))
    share = found.formed[row].double().mean(0)
    touching = found.contact[row].median(0).values
    form = found.forms[row][_commonest(found.forms[row], found.formed[row].any(-1))]
    about: dict[str, Any] = {
        "method": "smoother",
        "process": "white jerk in flight; in contact an envelope times a height whose rate is white noise, or white "
        "snap, as the data say",
        "share_with_form": share.tolist(),
        "form": dict(zip(force_forms.NAMES, form.tolist(), strict=True)),
        "intensity_flight": flight.tolist(),
        "intensity_contact": touching.tolist(),
        "intensity_unit": "variance of a pose's error per frame^5 (flight) and frame^7 (contact); x, y, wx, wy, wz, "
        "each without the errors that quieter ones show, as is the noise",
        "noise_over_stated": factor.tolist(),
        "contact_found": bool(found.found[row]),
        "log_likelihood_gain_of_contact": float(found.gain[row]),
    }
    times = series.times[row, :n].numpy()
    window = tuple(states.windows[row].mean(0).tolist())
    frames = {"flight": _flight_frame(times, window)}
    if about["contact_found"]:
        frames["contact"] = int(np.abs(times - np.mean(window)).argmin())
    for name, group in (("translation", slice(0, 2)), ("rotation", slice(2, FREEDOMS))):
        # The degree of freedom that moves most.
        freedom = group.start + int((touching + flight)[group].argmax())
        seen = series.seen[row, freedom, :n].numpy()
        if seen.sum() < STATES:
            continue
        noise = np.where(seen, series.variance[row, freedom, :n].numpy(), np.inf)
        for regime, at in frames.items():
            process = float(flight[freedom]), float(touching[freedom]), form.numpy() if share[freedom] > 0.5 else None
            weights, part = bandwidth.smoother_weights(times, noise, window, process, at)
            about[f"bandwidth_{regime}_{name}_per_frame"] = bandwidth.cutoffs(weights, times[part] - times[at])
    return about


def _commonest(forms: Tensor, used: Tensor) -> int:
    """Index of one of the forms (c, 6) that most of the ``used`` (c,) intervals have, but for the kinks."""
    kinds = forms[:, [force_forms.ONSET, force_forms.DECAY, force_forms.ROUGHNESS]]
    alike = (kinds[:, None] == kinds).all(-1) & used
    return int(torch.where(used, alike.sum(1), -1).argmax())


def _flight_frame(times: Array, window: tuple[float, ...]) -> int:
    """The middle frame of the longer flight."""
    before, after = times[times <= window[0]], times[times >= window[1]]
    longer = before if len(before) >= len(after) else after
    return int(np.searchsorted(times, longer[len(longer) // 2]))


def polynomials(track: Track, times: Array, method: str, window: int, order: int) -> Motion:
    """Motion by local polynomials."""
    is_plain = method == "differences"
    window, order = (3, 2) if is_plain else (window, order)
    measured = poses([track], [times])
    variance = np.diagonal(measured.covariance[0].numpy(), axis1=1, axis2=2)
    increment, is_measured = measured.step[0].numpy(), measured_increments(track)
    found = savitzky_golay.rates(
        times, increment, is_measured, variance, window=window, order=order, shifted=not is_plain
    )
    seen = np.isfinite(track.position)
    drift = np.concatenate((np.zeros((1, 2)), measured.drift_variance[0, :, :2].numpy().cumsum(0)))
    return Motion(
        offset=np.where(seen, 0.0, np.nan),
        rate=found.first,
        acceleration=found.second,
        sd_offset=np.where(seen, np.sqrt(variance[:, :2] + drift), np.nan),
        sd_rate=np.sqrt(found.variance_first),
        sd_acceleration=np.sqrt(found.variance_second),
        contacts=(),
        about={
            "method": method,
            "window_frames": window,
            "order": order,
            "bandwidth_per_frame": bandwidth.cutoffs(found.weights, found.offsets),
        },
    )
