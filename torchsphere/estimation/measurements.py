"""Poses with independent errors, from a track: the measurements of the smoother and of the contact search.

An increment is the difference of two images' poses, whose errors are independent: with ``C`` the covariance of an
increment, the error of a pose has the covariance ``C / 2``, and successive increments have the covariance ``-C / 2``.

The errors of a position and of the rotation that looks like its motion (x and wy, y and wx) are correlated by 95 % and
more, since either moves the speckle. The contact search takes the degrees of freedom for independent; `separation`
therefore subtracts from each the errors that the quieter ones show.
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
from torchsphere.estimation.process_model import PRIOR_VARIANCE
from torchsphere.motion.track import Track
from torchsphere.runtime.arrays import Array

#: Degrees of freedom: x, y, wx, wy, wz.
FREEDOMS = 5

#: Degrees of freedom of the position, and of the rotation.
XY, TURNS = np.arange(2), np.arange(2, FREEDOMS)

#: Regularisation of the separation, share of the variances (docs/constants.toml).
RIDGE = 1e-9

#: Share of an increment's variance that stays in all later poses, without a map of the ball (docs/constants.toml).
DRIFT_SHARE = 0.08

#: Standard deviation of a position found anew by the outline, relative to those before, px (docs/constants.toml).
REFOUND_PX = 0.05

#: Least share of its variance that remains to a separated value (docs/constants.toml).
MIN_OWN_SHARE = 0.01


@dataclass(frozen=True)
class Poses:
    """Measured poses of n recordings of t frames; a shorter recording is padded with frames that were not seen."""

    times: Tensor  # (n, t), frames, rising
    step: Tensor  # steps of the reference trajectory to the next frame (n, t - 1, 5), px and rad
    covariance: Tensor  # covariance of the error of each frame's pose (n, t, 5, 5)
    drift: Tensor  # covariance (n, t - 1, 5, 5) of errors of the steps that stay in all later poses
    seen: Tensor  # (n, t, 5), True where the pose was measured

    @property
    def drift_variance(self) -> Tensor:
        """Variances (n, t - 1, 5) of the drift."""
        return self.drift.diagonal(dim1=-2, dim2=-1)

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

        Rotation vectors are simply added, which is accurate enough to search for the time of a change.
        """
        step, duration = self.step / self.unit[:, None], self.times.diff(dim=-1)[..., None]
        known = self.seen[:, 1:] & self.seen[:, :-1]
        rate = torch.where(known, step / duration, torch.nan).nanmedian(1, keepdim=True).values.nan_to_num()
        moved = torch.nn.functional.pad((step - rate * duration).cumsum(1), (0, 0, 1, 0))
        return torch.where(self.seen, moved, 0.0)

    @functools.cached_property
    def separation(self) -> Tensor:
        """Combinations (n, 5, 5) of the poses, in units of the errors, whose errors are independent.

        A degree of freedom whose chain was broken has no share in the others, as they would get its jump, too.
        """
        own = self.covariance.diagonal(dim1=-2, dim2=-1)
        unbroken = (self.drift_variance <= own[:, 1:] + own[:, :-1]).all(1, keepdim=True)
        return separation(self._scaled(self.covariance), self.value, self.times, self.seen & unbroken)

    def _scaled(self, covariance: Tensor) -> Tensor:
        """Covariances (n, t, 5, 5) in units of the errors."""
        return covariance / self.unit[:, None, :, None] / self.unit[:, None, None]

    def series(self) -> Series:
        """The poses as independent degrees of freedom, by the combinations of `separation`."""
        matrix = self.separation[:, None]
        value = matrix @ self.value[..., None]
        variance, drift = (_separated(self._scaled(errors), matrix) for errors in (self.covariance, self.drift))
        variance = torch.where(self.seen, variance, 1.0)
        return Series(self.times, *(v.mT for v in (value[..., 0], variance, drift, self.seen)))


def _separated(covariance: Tensor, matrix: Tensor) -> Tensor:
    """Variances (n, t, 5) of the combinations ``matrix`` (n, 1, 5, 5) of errors of a covariance (n, t, 5, 5)."""
    least = MIN_OWN_SHARE * covariance.diagonal(dim1=-2, dim2=-1)
    return torch.maximum((matrix @ covariance @ matrix.mT).diagonal(dim1=-2, dim2=-1), least)


def separation(covariance: Tensor, value: Tensor, times: Tensor, seen: Tensor) -> Tensor:
    """Matrix (n, k, k), 1 on its diagonal, whose products with the values have independent errors.

    ``covariance`` (n, t, k, k) is that of the errors, ``value`` (n, t, k) is in units of the errors, ``times`` are
    (n, t) and ``seen`` (n, t, k). The method is Gram and Schmidt's with the mean covariance, from the value with the
    least variance about a straight line on. A value that was not seen in all frames of another has no share in it.
    """
    order = _variance_about_line(value, times, seen).argsort(-1).argsort(-1)
    quieter = order[:, None] < order[:, :, None]
    always = (seen[..., None, :] | ~seen[..., None]).all(1) & seen.any(1)[..., None]
    # Mean covariances (n, i, j, l) of j and l over the frames in which i was seen.
    mean = torch.einsum("nti,ntjl->nijl", seen.to(covariance), covariance)
    mean = mean / seen.sum(1).clamp_min(1)[..., None, None]
    own = mean.diagonal(dim1=-2, dim2=-1)
    usable = (quieter & always & (own > 0)).to(covariance)
    # Values that are left out get a row of the identity.
    others = mean * usable[..., None] * usable[..., None, :] + torch.diag_embed(1.0 - usable + RIDGE * own)
    across = torch.stack([mean[:, i, i] for i in range(mean.shape[1])], 1)
    weights = torch.linalg.solve(others, (across * usable)[..., None])[..., 0]
    return torch.eye(value.shape[-1]).to(value) - weights


def _variance_about_line(value: Tensor, times: Tensor, seen: Tensor) -> Tensor:
    """Variance (n, k) of the values seen about a straight line."""
    weight = seen.to(value)
    count = weight.sum(1, keepdim=True).clamp_min(1.0)
    value, time = (weight * (v - (weight * v).sum(1, keepdim=True) / count) for v in (value, times[..., None]))
    slope = (time * value).sum(1, keepdim=True) / time.square().sum(1, keepdim=True).clamp_min(1e-12)
    return (value - slope * time).square().sum(1) / count[:, 0]


def poses(tracks: Sequence[Track], times: Sequence[Array]) -> Poses:
    """Poses of tracks at ``times``, in frames, padded to the longest with frames that were not seen."""
    longest = max(map(len, times))
    columns: list[list[Array]] = [[] for _ in range(5)]
    for track, moments in zip(tracks, times, strict=True):
        more = longest - len(moments)
        later = moments[-1] + np.arange(1, more + 1)
        padded = (np.concatenate((part, np.zeros((more, *part.shape[1:]), part.dtype))) for part in _measured(track))
        for column, part in zip(columns, (np.concatenate((moments, later)), *padded), strict=True):
            column.append(part)
    return Poses(*(torch.from_numpy(np.stack(column)) for column in columns))


def measured_increments(track: Track) -> NDArray[np.bool_]:
    """(n - 1, 2), True where the increment's translation, and its rotation, was measured."""
    translation = np.isfinite(track.increment[:, :2]).all(1)
    return np.stack((translation, translation & np.isfinite(track.increment[:, 2:]).all(1)), 1)


def _measured(track: Track) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Steps (n - 1, 5), covariances (n, 5, 5), drifts (n - 1, 5, 5) and mask of the values seen (n, 5) of one track."""
    valid = np.repeat(measured_increments(track), (2, 3), axis=1)
    increment = np.where(valid, track.increment, 0.0)
    both = valid[:, :, None] & valid[:, None, :]
    covariance = _pose_covariance(np.where(both, track.covariance, np.nan))
    own = np.diagonal(covariance, axis1=1, axis2=2)
    position = np.isfinite(track.position[:, 0])
    turned = np.isfinite(track.orientation[:, 0, 0]) & position
    seen = np.repeat(np.stack((position, turned & valid[:, 2].any()), 1), (2, 3), axis=1)
    seen[1:] |= valid
    seen[:-1] |= valid
    seen &= np.isfinite(own)
    share = 0.0 if track.findings.is_on_map else DRIFT_SHARE
    # As the errors of the poses themselves, those of x and of the rotation that looks like it are nearly one.
    drift = share * np.nan_to_num(covariance[:-1] + covariance[1:])
    for a, b in itertools.pairwise(np.flatnonzero(seen[:, 0])):
        if not valid[a:b, 0].all():
            increment[a:b, :2] = (track.position[b] - track.position[a]) / (b - a)
            if not (turned[a] and turned[b]):
                drift[b - 1, XY, XY] += REFOUND_PX**2
    for a, b in itertools.pairwise(np.flatnonzero(seen[:, 2])):
        if not valid[a:b, 2].all():
            if turned[a] and turned[b]:
                matrix = torch.from_numpy(track.orientation[b] @ track.orientation[a].T)
                increment[a:b, 2:] = So3.from_matrix(matrix[None]).log()[0].numpy() / (b - a)
            else:
                # After a broken chain an orientation is as unknown as before the first measurement.
                drift[b - 1, TURNS, TURNS] += PRIOR_VARIANCE * np.nan_to_num(own[b, 2:])
    return increment, np.nan_to_num(covariance), drift, seen


def _pose_covariance(covariance: Array) -> Array:
    """Covariance (n, 5, 5) of each pose: half the mean of the increments' to and from it, else half their median."""
    half = np.full((2, len(covariance) + 1, FREEDOMS, FREEDOMS), np.nan)
    half[0, 1:], half[1, :-1] = covariance / 2, covariance / 2
    known = np.isfinite(half)
    count = known.sum(0)
    mean = np.where(known, half, 0.0).sum(0) / np.maximum(count, 1)
    finite = np.isfinite(covariance)
    typical = np.full((FREEDOMS, FREEDOMS), np.nan)
    for i, j in np.argwhere(finite.any(0)):
        typical[i, j] = np.median(covariance[finite[:, i, j], i, j]) / 2
    return np.where(count > 0, _without_mixed(mean, count), _without_mixed(typical, finite.sum(0)))


def _without_mixed(covariance: Array, count: NDArray[np.int64]) -> Array:
    """Covariances (..., 5, 5), with translation and rotation independent where they rest on different steps.

    Where the outline gives the translation of one step and the texture both of the next, the covariance of the two
    may exceed what the variances allow, and the matrix would not be positive.
    """
    is_mixed = (count != count[..., :1, :1]).any((-2, -1))[..., None, None]
    is_rotation = np.arange(FREEDOMS) >= 2
    return np.where(is_mixed & (is_rotation[:, None] != is_rotation), 0.0, covariance)
