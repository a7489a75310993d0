"""The limbs of a ball in several frames, each fitted around a circle: along a path, or around one that all share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.detection import blurred_limb, limb_fit
from torchsphere.geometry.camera import Camera
from torchsphere.runtime.arrays import Array

#: Most frames whose limbs are fitted (docs/constants.toml).
MAX_FRAMES = 16

#: Distance from its guess up to which a limb is sure to be found, px (docs/constants.toml).
IN_SIGHT_PX = 1.0

#: Largest deviation of a limb, and of the limbs' trend, of a ball that stays, standard deviations
#: (docs/constants.toml).
STAY_SD = 3.0

#: Deviation of a path or of a radius from the limbs that is significant, standard deviations (docs/constants.toml).
SIGNIFICANT_SD = 4.0

Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class Limbs:
    """Limbs in m frames; NaN where none was found."""

    frames: Numbers  # (m,)
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


def fit_along_path(images: Tensor, frames: Numbers, path: Array, ignore: Tensor | None, camera: Camera | None) -> Limbs:
    """Limbs in the ``images`` (m, h, w) of ``frames`` (m,), looked for where the ``path`` (m, 3) is, px.

    Where they are farther from it than a limb's fit can see, each is looked for where the path ends up by the last.
    """
    circles, sd = _fit(images, path, ignore, camera)
    if not (np.abs(circles - path) < IN_SIGHT_PX).all():
        # The limb of a blurred image seems to lie outside.
        blurred = blurred_limb.fit_as_needed(
            images, torch.from_numpy(path), ignore=ignore, camera=camera, only_blurred=True
        )
        circles, sd = _as_arrays(*blurred[:2]) if blurred else _one_by_one(images, path, ignore, camera)
    return Limbs(frames, circles, sd, path).found


def fit_around(images: Tensor, frames: Numbers, circle: Array, ignore: Tensor | None, camera: Camera | None) -> Limbs:
    """Limbs in the ``images`` (m, h, w) of ``frames`` (m,) of a ball that stays at about the ``circle`` (3,), px."""
    guesses = np.tile(circle, (len(frames), 1))
    circles, sd = _fit(images, guesses, ignore, camera)
    # A guess that is off by more than a px needs a second fit, from what most frames show.
    common = torch.from_numpy(circles).nanmedian(0).values.numpy()
    if np.isfinite(common).all():
        guesses = np.tile(common, (len(frames), 1))
        circles, sd = _fit(images, guesses, ignore, camera)
    return Limbs(frames, circles, sd, guesses).found


def _one_by_one(images: Tensor, path: Array, ignore: Tensor | None, camera: Camera | None) -> tuple[Array, Array]:
    """Circles (m, 3) and their sd, each looked for where the ``path`` (m, 3) ends up by the last one found."""
    circles, sd = np.empty_like(path), np.empty_like(path)
    shift, ratio = np.zeros(2), 1.0
    for k in range(len(images)):
        guess = np.append(path[k, :2] + shift, path[k, 2] * ratio)
        circles[k : k + 1], sd[k : k + 1] = _fit(images[k : k + 1], guess[None], ignore, camera)
        if np.isfinite(circles[k]).all():
            shift, ratio = circles[k, :2] - path[k, :2], circles[k, 2] / path[k, 2]
    return circles, sd


def _fit(images: Tensor, guesses: Array, ignore: Tensor | None, camera: Camera | None) -> tuple[Array, Array]:
    return _as_arrays(*limb_fit.fit(images, torch.from_numpy(guesses), ignore=ignore, camera=camera))


def _as_arrays(fitted: Tensor, covariance: Tensor) -> tuple[Array, Array]:
    """Circles (m, 3) and their sd, px; NaN where no limb was found."""
    return fitted.numpy(), covariance.diagonal(dim1=1, dim2=2).clamp_min(0).sqrt().numpy()
