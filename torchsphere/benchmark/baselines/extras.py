"""The libraries of the extra ``baselines``, imported when a rival is run and not before."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Brightest grey level of the images that OpenCV's 8 bit functions take.
WHITE = 255.0


def load(module: str) -> Any:
    """Import ``module`` of the extra.

    Raises
    ------
    ModuleNotFoundError
        If it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ModuleNotFoundError(
            f"this rival tracker needs {module.partition('.')[0]}, which is not installed: "
            "pip install torchsphere[baselines]",
            name=module,
        ) from error


def eight_bit_gain(image: NDArray[np.float32]) -> float:
    """Factor that brings grey levels to 8 bit: 1 where they are 8 bit already, so that nothing is rounded twice."""
    brightest = float(image.max())
    # Below a quarter of the range an 8 bit image would lose more by rounding than by its own noise.
    return 1.0 if WHITE / 4 < brightest <= WHITE else WHITE / max(brightest, 1e-12)


def eight_bit(image: NDArray[np.float32], gain: float) -> NDArray[np.uint8]:
    """``gain * image`` rounded to whole levels from 0 to 255."""
    return np.clip(np.rint(gain * image), 0, WHITE).astype(np.uint8)
