"""Images as files store them: turned and mirrored, or as the mosaic of a colour sensor."""

from __future__ import annotations

import numpy as np

#: The tag's own words for each code: the side of the image that the first stored row is, and the first stored column.
SIDES = {
    1: ("top", "left"),
    2: ("top", "right"),
    3: ("bottom", "right"),
    4: ("bottom", "left"),
    5: ("left", "top"),
    6: ("right", "top"),
    7: ("right", "bottom"),
    8: ("left", "bottom"),
}


def as_stored(image: np.ndarray, code: int) -> np.ndarray:
    """The rows of a file with that code, pixel by pixel after the words of the standard."""
    height, width = image.shape
    first_row, first_column = SIDES[code]
    is_turned = first_row in ("left", "right")
    stored = np.empty((width, height) if is_turned else (height, width), image.dtype)
    for row, column in np.ndindex(*stored.shape):
        place = {first_row: row, first_column: column}
        x = place["left"] if "left" in place else width - 1 - place["right"]
        y = place["top"] if "top" in place else height - 1 - place["bottom"]
        stored[row, column] = image[y, x]
    return stored


def mosaic_of(red: np.ndarray, green: np.ndarray, blue: np.ndarray, pattern: str) -> np.ndarray:
    """Images (n, h, w) of a sensor with that pattern, from three colours (n, h, w)."""
    images = np.empty_like(green)
    for k, letter in enumerate(pattern):
        place = (slice(None), slice(k // 2, None, 2), slice(k % 2, None, 2))
        images[place] = {"R": red, "G": green, "B": blue}[letter][place]
    return images
