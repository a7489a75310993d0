"""Colour to grey."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# Luma of ITU-R Recommendation BT.601, section 2.5.1, for red, green and blue.
REC_601 = (0.299, 0.587, 0.114)

GREY_NOTE = "Colour was converted to grey with the Rec. 601 weights 0.299 R + 0.587 G + 0.114 B."
ALPHA_NOTE = "The transparency channel was ignored."


def to_grey(colour: NDArray[Any], *, reverse: bool = False) -> NDArray[np.float32]:
    """Grey levels (...) of colours (..., c): red, green, blue and further channels, or blue first if ``reverse``."""
    red, green, blue = REC_601[::-1] if reverse else REC_601
    grey: NDArray[np.float32] = np.multiply(colour[..., 0], np.float32(red), dtype=np.float32)
    grey += np.multiply(colour[..., 1], np.float32(green), dtype=np.float32)
    grey += np.multiply(colour[..., 2], np.float32(blue), dtype=np.float32)
    return grey
