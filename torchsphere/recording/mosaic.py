"""The colour mosaic of a sensor (Bayer's, U.S. Patent 3,971,065), measured on its green pixels.

Half of the pixels are green, on a chessboard, and one colour needs no knowledge of the light: a grey level between them
is interpolated from twelve green neighbours. Grey from interpolated colours errs by twice as much on a coloured ball,
and gains for each colour leave the mosaic of all that is coloured.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.settings.choices import BAYER

#: Weights of the four green neighbours at a distance of 1 px and the eight at that of a knight's move: the only ones
#: that keep every cubic polynomial.
NEAR, FAR = 10 / 32, -1 / 32

#: Least height and width of images that hold these neighbours, px.
LEAST_SIZE = 3


def first_green(pattern: str) -> int:
    """Column of the green pixel in the first row of a `BAYER` pattern; in the second row it is the other one."""
    return pattern.index("G")


def pattern_of(codes: tuple[int, ...]) -> str | None:
    """The pattern of the four codes 0 (red), 1 (green), 2 (blue), row by row, as TIFF states them; None for others."""
    name = "".join("RGB"[code] for code in codes if 0 <= code <= 2)
    return name if name in BAYER else None


def green(images: NDArray[Any], pattern: str) -> NDArray[np.float32]:
    """Green levels (n, h, w) of stored mosaics ``images`` (n, h, w) with a `BAYER` pattern."""
    levels = images.astype(np.float32)
    height, width = levels.shape[1:]
    rows, columns = np.indices((height, width))
    is_other = (rows + columns + first_green(pattern)) % 2 == 1
    # Mirrored at the middle of the border's pixels, which keeps the chessboard.
    padded = np.pad(levels, ((0, 0), (2, 2), (2, 2)), mode="reflect")

    def moved(dy: int, dx: int) -> NDArray[np.float32]:
        return padded[:, 2 + dy : 2 + dy + height, 2 + dx : 2 + dx + width]

    near = moved(-1, 0) + moved(1, 0) + moved(0, -1) + moved(0, 1)
    far = np.zeros_like(levels)
    for dy, dx in ((1, 2), (2, 1)):
        for y, x in ((dy, dx), (dy, -dx), (-dy, dx), (-dy, -dx)):
            far += moved(y, x)
    between = np.float32(NEAR) * near + np.float32(FAR) * far
    return np.where(is_other, between, levels)
