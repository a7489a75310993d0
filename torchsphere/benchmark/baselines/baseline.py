"""What every rival tracker returns, whatever it measures, and the signature that all of them share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Baseline:
    """Motion of the ball over n frames as another tracker measures it, px and rad, image and camera frame.

    Attributes
    ----------
    position : ndarray
        Centre in each image (n, 2) as (x, y), px; NaN where the tracker failed.
    increment : ndarray
        Motion (n - 1, 5) from each frame to the next as (dx, dy, wx, wy, wz), px and rad; NaN for what the method does
        not measure at all, and where it failed.
    status : ndarray
        Strings (n,), each one of `result.STATUSES`; row i speaks of frame i and of the increment that
        leads to it. A frame found again after a gap is "lost" with a position: no increment leads to it.
    seconds : float
        Wall time of the call, reading of the images included and the import of the method's library not.
    settings : dict
        Every setting used, the method's name first.
    """

    position: NDArray[np.float64]
    increment: NDArray[np.float64]
    status: NDArray[np.str_]
    seconds: float
    settings: dict[str, Any]


class Tracker(Protocol):
    """A ball tracker: images and the first outline in, motion out."""

    def __call__(self, images: Any, circle: Any, *, progress: Progress | None = None) -> Baseline:
        """Follow the ball.

        Parameters
        ----------
        images : Recording or array_like
            Images (n, h, w), NumPy or torch, or a `Recording`, which is read as it is needed.
        circle : tuple of float or Circle
            Outline (x, y, radius) of the ball in the first image, px.
        progress : callable, optional
            Called as ``progress(done, total)`` with numbers of frames.

        Raises
        ------
        ValueError
            If there are fewer than two images or the circle does not fit the first of them.
        ModuleNotFoundError
            If a library of the extra ``baselines`` is missing.
        """
        ...
