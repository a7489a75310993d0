"""What the baselines share: the result, the signature, the import of optional libraries, and 8 bit images."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

#: Brightest grey level of the 8 bit images that OpenCV's functions take.
WHITE = 255.0

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Baseline:
    """Motion of the ball over n frames as another tracker measures it, in the image and camera frame.

    A frame found again after a gap has the status "lost" and a position, because no increment leads to the frame.
    """

    position: NDArray[np.float64]  # centre (n, 2) as (x, y), px; NaN where the tracker failed
    increment: NDArray[np.float64]  # (n - 1, 5) as (dx, dy, wx, wy, wz), px and rad; NaN where not measured
    status: NDArray[np.str_]  # (n,), of `frame_status.STATUSES`; for frame i and the increment that leads to frame i
    seconds: float  # wall time with the reading of the images, without the import of libraries
    settings: dict[str, Any]  # every setting, the method's name first


class Tracker(Protocol):
    """A ball tracker: images and the first outline in, motion out."""

    def __call__(self, images: Any, circle: Any, *, progress: Progress | None = None) -> Baseline:
        """Follow the ball; raises if the circle does not fit the first image, or if a library is missing.

        ``images`` (n, h, w) are a `Recording` or an array; ``circle`` is the outline (x, y, radius) in the first image,
        px. ``progress(done, total)`` is called with numbers of frames.
        """
        ...


def load(module: str) -> Any:
    """Import ``module`` of the extra ``baselines``; raises ModuleNotFoundError if it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ModuleNotFoundError(
            f"this baseline tracker needs {module.partition('.')[0]}, which is not installed: "
            "pip install torchsphere[baselines]",
            name=module,
        ) from error


def eight_bit_gain(image: NDArray[np.float32]) -> float:
    """Factor that scales grey levels to 8 bit; 1 for 8 bit images, so that they are not rounded twice."""
    brightest = float(image.max())
    # Below a quarter of the range, rounding would cost an 8 bit image more than its own noise.
    return 1.0 if WHITE / 4 < brightest <= WHITE else WHITE / max(brightest, 1e-12)


def eight_bit(image: NDArray[np.float32], gain: float) -> NDArray[np.uint8]:
    """``gain * image`` rounded to whole levels from 0 to 255."""
    return np.clip(np.rint(gain * image), 0, WHITE).astype(np.uint8)
