"""The scale of grey levels: images of any gain and offset as levels of one kind, from 0 to about 255.

Neither the gain of a camera nor its offset says anything of the ball. Limits in grey levels mean the same in all
recordings only if all have one scale: black is the darkest of the first image that shows anything, white its brightest.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

#: Standard level of the brightest pixels: that of an 8-bit image.
WHITE = 255.0

#: Share of the pixels that are darker than black, and brighter than white: single pixels of a sensor may be defective.
TAIL = 0.001

#: Most pixels whose levels are sorted.
MOST_PIXELS = 100_000

#: Distance of levels from whole steps, in steps, that float32 leaves.
MAX_OFF_STEP = 0.1

#: Difference below which two standard levels are the same. The step of 16 bit is 0.004; a camera's noise is more.
SAME = 0.01

#: Least standard deviation of a standard level: the rounding errors of float32 over a hundred terms.
LEAST_SD = 1e-5 * WHITE


@dataclass(frozen=True)
class LevelScale:
    """Standard levels of an image, ``(recorded - black) / unit``."""

    black: float = 0.0  # recorded level of the standard level 0
    unit: float = 1.0  # recorded levels per standard level
    step: float = 1.0  # difference of neighbouring levels in the file, recorded levels; 0 where these are continuous

    @classmethod
    def of(cls, read: Callable[[int, int], Any], count: int) -> LevelScale:
        """The scale of ``count`` images that ``read(start, stop)`` gives, from the first that is not of one level."""
        for frame in (0, *(2**k for k in range(count.bit_length()) if 2**k < count)):
            levels = _some_levels(read(frame, frame + 1))
            if levels.size and levels[-1] > levels[0]:
                return cls._of_sorted(levels)
        return cls()

    @classmethod
    def _of_sorted(cls, levels: NDArray[Any]) -> LevelScale:
        last = levels.size - 1
        black, white = float(levels[round(TAIL * last)]), float(levels[round((1 - TAIL) * last)])
        if black == white:
            black, white = float(levels[0]), float(levels[-1])
        return cls(black, (white - black) / WHITE, _step(np.unique(levels)))

    @property
    def rounding_variance(self) -> float:
        """Variance that the steps of the file leave, and the least that any level has; standard levels squared."""
        return max((self.step / self.unit) ** 2 / 12, LEAST_SD**2)

    def standard(self, images: Tensor, dtype: torch.dtype) -> Tensor:
        """Standard levels of recorded ``images``, in new memory."""
        if not images.is_floating_point():
            return self.standard_in_place(images.to(dtype))
        # Twice the digits, where the images have these, until a large offset is gone.
        return (images - self.black).to(dtype).mul_(1 / self.unit)

    def standard_in_place(self, images: Tensor) -> Tensor:
        """Standard levels of recorded floating-point ``images``, in their own memory."""
        return images.sub_(self.black).mul_(1 / self.unit)


def alike(one: Tensor, other: Tensor) -> Tensor:
    """True where two images hold the same standard level: a copy, as a camera's noise is new in each image."""
    return (one - other).abs() < SAME


def _some_levels(image: Any) -> NDArray[Any]:
    """Finite levels of an image, in order; up to `MOST_PIXELS`, spread over it."""
    levels = np.asarray(image.cpu() if isinstance(image, Tensor) else image).ravel()
    levels = levels[:: max(1, levels.size // MOST_PIXELS)]
    return np.sort(levels[np.isfinite(levels)])


def _step(levels: NDArray[Any]) -> float:
    """Difference of which all differences of the ``levels`` (m,), ascending, are multiples; 0 without one."""
    if levels.dtype.kind in "bui":
        return float(np.gcd.reduce(np.diff(levels.astype(np.int64))))
    off = levels.astype(np.float64) - float(levels[0])
    # The whole range tells the step more exactly than the smallest difference does.
    count = round(float(off[-1] / np.diff(off).min()))
    step = float(off[-1]) / count
    return step if bool((np.abs(off / step - np.round(off / step)) < MAX_OFF_STEP).all()) else 0.0
