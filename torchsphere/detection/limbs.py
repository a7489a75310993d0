"""The limbs of a ball in several frames, each fitted around a circle: along a path, or around one that all share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.detection import blurred_limb, limb_fit
from torchsphere.geometry.camera import Camera

#: Most frames whose limbs are fitted (docs/constants.toml).
MAX_FRAMES = 16

#: Distance from its guess up to which a limb is sure to be found, px (docs/constants.toml).
IN_SIGHT_PX = 1.0

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Limbs:
    """Limbs in m frames."""

    frames: NDArray[np.int64]  # numbers (m,)
    circles: Array  # (m, 3), px
    sd: Array  # (m, 3), px
    guesses: Array  # circles (m, 3) around which they were looked for, px

    def rows(self, kept: NDArray[np.bool_]) -> Limbs:
        """The limbs of the ``kept`` rows (m,)."""
        return Limbs(self.frames[kept], self.circles[kept], self.sd[kept], self.guesses[kept])

    @property
    def found(self) -> Limbs:
        """The limbs that were found."""
        return self.rows(np.asarray((np.isfinite(self.circles) & np.isfinite(self.sd) & (self.sd > 0)).all(1)))


def fit_along_path(
    images: Tensor,
    frames: NDArray[np.int64],
    path: Array,
    *,
    ignore: Tensor | None = None,
    camera: Camera | None = None,
) -> Limbs:
    """Limbs in the ``images`` (m, h, w) of ``frames`` (m,), looked for where the ``path`` (m, 3) is, px.

    Where they are farther from it than a limb's fit can see, each is looked for where the path ends up by the last.
    """
    found = _fit(images, frames, path, ignore, camera)
    if (np.abs(found.circles - path) < IN_SIGHT_PX).all():
        return found.found
    # The limb of a blurred image seems to lie outside.
    blurred = blurred_limb.fit_if_blurred(images, torch.from_numpy(path), ignore=ignore, camera=camera)
    if blurred is not None:
        return _as_limbs(frames, *blurred[:2], path).found
    shift, ratio = np.zeros(2), 1.0
    for k in range(len(images)):
        guess = np.append(path[k, :2] + shift, path[k, 2] * ratio)[None]
        one = _fit(images[k : k + 1], frames[k : k + 1], guess, ignore, camera)
        found.circles[k], found.sd[k] = one.circles[0], one.sd[0]
        if np.isfinite(one.circles).all():
            shift, ratio = one.circles[0, :2] - path[k, :2], one.circles[0, 2] / path[k, 2]
    return found.found


def fit_around_one(
    images: Tensor,
    frames: NDArray[np.int64],
    circle: Array,
    *,
    ignore: Tensor | None = None,
    camera: Camera | None = None,
) -> Limbs:
    """Limbs in the ``images`` (m, h, w) of ``frames`` (m,) of a ball that stays at about the ``circle`` (3,), px."""
    first = _fit(images, frames, np.tile(circle, (len(frames), 1)), ignore, camera)
    # A guess that is off by more than a px needs a second fit, from what most frames show.
    common = torch.from_numpy(first.circles).nanmedian(0).values.numpy()
    if not np.isfinite(common).all():
        return first.found
    return _fit(images, frames, np.tile(common, (len(frames), 1)), ignore, camera).found


def _fit(
    images: Tensor, frames: NDArray[np.int64], guesses: Array, ignore: Tensor | None, camera: Camera | None
) -> Limbs:
    fitted, covariance = limb_fit.fit(images, torch.from_numpy(guesses), ignore=ignore, camera=camera)
    return _as_limbs(frames, fitted, covariance, guesses)


def _as_limbs(frames: NDArray[np.int64], fitted: Tensor, covariance: Tensor, guesses: Array) -> Limbs:
    """Fitted circles (m, 3) with the sd of their ``covariance`` (m, 3, 3), px^2; NaN where no limb was found."""
    return Limbs(frames, fitted.numpy(), covariance.diagonal(dim1=1, dim2=2).clamp_min(0).sqrt().numpy(), guesses)
