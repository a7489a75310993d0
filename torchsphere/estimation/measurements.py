"""From a track to poses with independent errors: what the smoother is fed with.

An increment is the difference of two images' poses, whose errors are independent: with ``C`` the covariance of an
increment, the error of one image's pose has ``C / 2`` and successive increments the covariance ``-C / 2``. Measured on
18 synthetic tracks of 40 to 60 frames: the correlation of successive errors is -0.5 with a map of the ball and -0.45
without, where some of each step's error stays.

Combinations of the degrees of freedom whose errors are independent: what the search for a contact is fed with.

The errors of a position and of the rotation that looks like its motion, x and wy, y and wx, are one to 95 % and more:
what moves the speckle may be either. The search takes each degree of freedom for independent of the others, so from
each the errors are taken that quieter ones show. Across the force, say, nothing moves but by its errors; they leave of
the errors of the rotation that looks like it a third. Without, chance that looks like a rough force did so twice.
Of half-sines of 14 frames the forces were right to 213 instead of 320 N at a noise of 7.5 um and to 67 instead of 136 N
at 1.5 um, with nothing else changed; by Hertz' law to 343 and 161 instead of 519 and 242 N, of triangles to 518 and 277
instead of 568 and 300 N, with bands that hold as many or more.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from kornia.geometry.liegroup import So3
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.estimation.likelihood import Series
from torchsphere.tracking.track import Track

#: What keeps the equations solvable where two values' errors are one, of their variances.
RIDGE = 1e-9


def separation(covariance: Tensor, value: Tensor, times: Tensor, seen: Tensor) -> Tensor:
    """Matrix (n, k, k), 1 on its diagonal, whose products with the values have errors that are independent.

    Parameters
    ----------
    covariance : Tensor
        Of the errors (n, t, k, k).
    value : Tensor
        What was measured (n, t, k), in units of the errors.
    times : Tensor
        Of the frames (n, t).
    seen : Tensor
        Where (n, t, k), bool.

    Notes
    -----
    Gram and Schmidt's method with the mean covariance, from the value that changes least beside a straight line: of its
    motion the others get a share. What was not seen in all of a value's frames is no part of it.
    """
    order = _spread(value, times, seen).argsort(-1).argsort(-1)
    quieter = order[:, None] < order[:, :, None]
    always = (seen[..., None, :] | ~seen[..., None]).all(1) & seen.any(1)[..., None]
    # Of the frames of each: the covariances of all others.
    mean = torch.einsum("nti,ntjl->nijl", seen.to(covariance), covariance)
    mean = mean / seen.sum(1).clamp_min(1)[..., None, None]
    own = mean.diagonal(dim1=-2, dim2=-1)
    usable = (quieter & always & (own > 0)).to(covariance)
    # The others' covariances, with 1 for those that are left out.
    others = mean * usable[..., None] * usable[..., None, :] + torch.diag_embed(1.0 - usable + RIDGE * own)
    across = torch.stack([mean[:, i, i] for i in range(mean.shape[1])], 1)
    weights = torch.linalg.solve(others, (across * usable)[..., None])[..., 0]
    return torch.eye(value.shape[-1]).to(value) - weights


def _spread(value: Tensor, times: Tensor, seen: Tensor) -> Tensor:
    """Variance (n, k) about a straight line of what was seen: the likelihood knows of no line, either."""
    weight = seen.to(value)
    count = weight.sum(1, keepdim=True).clamp_min(1.0)
    value, time = (weight * (v - (weight * v).sum(1, keepdim=True) / count) for v in (value, times[..., None]))
    slope = (time * value).sum(1, keepdim=True) / time.square().sum(1, keepdim=True).clamp_min(1e-12)
    return (value - slope * time).square().sum(1) / count[:, 0]


Array = NDArray[np.float64]

#: Degrees of freedom: x, y, wx, wy, wz.
FREEDOMS = 5

#: Share of an increment's variance that stays in all later poses, without a map of the ball: with it, what remains of
#: a chain of 40 to 60 frames beside a straight line was 1.0 to 1.3 times the expected. With a map 0.7 to 1.1 without.
DRIFT_SHARE = 0.08

#: Standard deviation, px, of a position found anew by the outline, against those before.
REFOUND_PX = 0.05

#: Variance of what is known no more, in units of the errors.
BROKEN = 1e8

#: Least share of its variance that the errors of a combination of degrees of freedom have of their own.
LEAST_OWN = 0.01


@dataclass(frozen=True)
class Poses:
    """Measured poses of n recordings of t frames; a shorter recording ends in frames that were not seen.

    Attributes
    ----------
    times : Tensor
        (n, t), frames, rising.
    step : Tensor
        Of the reference from each frame to the next (n, t - 1, 5): px and rad.
    covariance : Tensor
        Of the error of each frame's pose (n, t, 5, 5).
    drift : Tensor
        Variance (n, t - 1, 5) of the errors of the steps that stay in all later poses.
    seen : Tensor
        (n, t, 5), True where the pose was measured.
    """

    times: Tensor
    step: Tensor
    covariance: Tensor
    drift: Tensor
    seen: Tensor

    @property
    def unit(self) -> Tensor:
        """Size (n, 5) of the errors: px, the same for both, and rad, the same for all three."""
        variance = torch.where(self.seen, self.covariance.diagonal(dim1=-2, dim2=-1), torch.nan)
        shared = [variance[..., part].flatten(1).nanmedian(1).values for part in (slice(0, 2), slice(2, 5))]
        px, rad = (torch.where(v > 0, v, 1.0).sqrt() for v in shared)
        return torch.stack((px, px, rad, rad, rad), -1)

    @functools.cached_property
    def value(self) -> Tensor:
        """The poses (n, t, 5) in units of the errors and without their mean motion, 0 where they were not seen.

        Rotations add up like vectors here, which is right for a search of when they change.
        """
        step, duration = self.step / self.unit[:, None], self.times.diff(dim=-1)[..., None]
        known = self.seen[:, 1:] & self.seen[:, :-1]
        rate = torch.where(known, step / duration, torch.nan).nanmedian(1, keepdim=True).values.nan_to_num()
        moved = torch.nn.functional.pad((step - rate * duration).cumsum(1), (0, 0, 1, 0))
        return torch.where(self.seen, moved, 0.0)

    @functools.cached_property
    def separation(self) -> Tensor:
        """Combinations (n, 5, 5) of the poses, in units of the errors, whose errors are independent.

        Where a chain was broken and taken up again, it stays by itself: its jump would be one of the others, too.
        """
        own = self.covariance.diagonal(dim1=-2, dim2=-1)
        unbroken = (self.drift <= own[:, 1:] + own[:, :-1]).all(1, keepdim=True)
        return separation(self._covariance_in_units(), self.value, self.times, self.seen & unbroken)

    def _covariance_in_units(self) -> Tensor:
        return self.covariance / self.unit[:, None, :, None] / self.unit[:, None, None]

    def series(self) -> Series:
        """The same as independent degrees of freedom, each with the share of quieter ones that `separation` says."""
        matrix, covariance = self.separation[:, None], self._covariance_in_units()
        value = matrix @ self.value[..., None]
        # No correlation is known so well that nothing is left.
        least = LEAST_OWN * covariance.diagonal(dim1=-2, dim2=-1)
        variance = torch.maximum((matrix @ covariance @ matrix.mT).diagonal(dim1=-2, dim2=-1), least)
        # What stays of the steps' errors is taken for independent, as in the smoother.
        drift = matrix**2 @ (self.drift / self.unit[:, None] ** 2)[..., None]
        variance = torch.where(self.seen, variance, 1.0)
        return Series(self.times, *(v.mT for v in (value[..., 0], variance, drift[..., 0], self.seen)))


def poses(tracks: Sequence[Track], times: Sequence[Array]) -> Poses:
    """Poses of tracks at ``times``, in frames, padded to the longest with frames that were not seen."""
    longest = max(map(len, times))
    columns: list[list[Array]] = [[] for _ in range(5)]
    for track, moments in zip(tracks, times, strict=True):
        more = longest - len(moments)
        step, covariance, drift, seen = _one(track)
        later = moments[-1] + np.arange(1, more + 1)
        parts = (
            np.concatenate((moments, later)),
            np.concatenate((step, np.zeros((more, FREEDOMS)))),
            np.concatenate((covariance, np.zeros((more, FREEDOMS, FREEDOMS)))),
            np.concatenate((drift, np.zeros((more, FREEDOMS)))),
            np.concatenate((seen, np.zeros((more, FREEDOMS), dtype=bool))),
        )
        for column, part in zip(columns, parts, strict=True):
            column.append(part)
    return Poses(*(torch.from_numpy(np.stack(column)) for column in columns))


def joined(track: Track) -> NDArray[np.bool_]:
    """(n - 1, 2), True where the increment's translation, and its rotation, was measured."""
    translation = np.isfinite(track.increment[:, :2]).all(1)
    return np.stack((translation, translation & np.isfinite(track.increment[:, 2:]).all(1)), 1)


def on_map(track: Track) -> bool:
    """Whether the poses come from a map of the ball."""
    about = track.settings.get("sphere_map")
    return isinstance(about, dict) and bool(about.get("used"))


def _one(track: Track) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Steps (n - 1, 5), covariances (n, 5, 5), drifts (n - 1, 5) and what was seen (n, 5) of one track."""
    n = len(track.status)
    valid = np.repeat(joined(track), (2, 3), axis=1)
    increment = np.where(valid, track.increment, 0.0)
    both = valid[:, :, None] & valid[:, None, :]
    covariance = _of_poses(np.where(both, track.covariance, np.nan))
    position = np.isfinite(track.position[:, 0])
    turned = np.isfinite(track.orientation[:, 0, 0]) & position
    near = np.zeros((n, FREEDOMS), dtype=bool)
    near[1:] |= valid
    near[:-1] |= valid
    seen = near | np.repeat(np.stack((position, turned & valid[:, 2].any()), 1), (2, 3), axis=1)
    seen &= np.isfinite(np.diagonal(covariance, axis1=1, axis2=2))
    share = 0.0 if on_map(track) else DRIFT_SHARE
    own = np.diagonal(covariance, axis1=1, axis2=2)
    drift = share * np.nan_to_num(own[:-1] + own[1:])
    known = np.flatnonzero(seen[:, 0])
    for a, b in itertools.pairwise(known):
        if not valid[a:b, 0].all():
            increment[a:b, :2] = (track.position[b] - track.position[a]) / (b - a)
            if not (turned[a] and turned[b]):
                drift[b - 1, :2] += REFOUND_PX**2
    known = np.flatnonzero(seen[:, 2])
    for a, b in itertools.pairwise(known):
        if not valid[a:b, 2].all():
            if turned[a] and turned[b]:
                matrix = torch.from_numpy(track.orientation[b] @ track.orientation[a].T)
                increment[a:b, 2:] = So3.from_matrix(matrix[None]).log()[0].numpy() / (b - a)
            else:
                drift[b - 1, 2:] += BROKEN * np.nan_to_num(own[b, 2:])
    return increment, np.nan_to_num(covariance), drift, seen


def _of_poses(covariance: Array) -> Array:
    """Covariance (n, 5, 5) of each frame's pose from those of the increments to and from it, else the typical one."""
    half = np.full((2, len(covariance) + 1, FREEDOMS, FREEDOMS), np.nan)
    half[0, 1:], half[1, :-1] = covariance / 2, covariance / 2
    known = np.isfinite(half)
    count = known.sum(0)
    mean = np.where(known, half, 0.0).sum(0) / np.maximum(count, 1)
    finite = np.isfinite(covariance)
    typical = np.array(
        [
            [np.median(covariance[finite[:, i, j], i, j]) / 2 if finite[:, i, j].any() else np.nan for j in range(5)]
            for i in range(5)
        ]
    )
    return np.where(count > 0, _apart(mean, count), _apart(typical, finite.sum(0)))


def _apart(covariance: Array, count: NDArray[np.int64]) -> Array:
    """Covariances (..., 5, 5), translation and rotation independent where they rest on different steps.

    Where the outline gives the translation of one step and the texture both of the next, the covariance of the two
    may be more than the variances allow: such a matrix is none of any error.
    """
    mixed = (count != count[..., :1, :1]).any((-2, -1))[..., None, None]
    of_rotation = np.arange(FREEDOMS) >= 2
    across = of_rotation[:, None] != of_rotation
    return np.where(mixed & across, 0.0, covariance)
