"""Which way is up: stored images turned and mirrored as a player shows them.

The codes are those of the tag Orientation of TIFF and Exif, which name all eight ways. A video states a matrix instead,
a CINE two mirrors and an angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: What is done to a stored image, by its code: whether columns become rows, then whether x, and y, are mirrored.
STEPS = {
    1: (False, False, False),
    2: (False, True, False),
    3: (False, True, True),
    4: (False, False, True),
    5: (True, False, False),
    6: (True, True, False),
    7: (True, True, True),
    8: (True, False, True),
}

#: The same in words.
WORDS = {
    1: "as stored",
    2: "mirrored left to right",
    3: "turned by 180 deg",
    4: "mirrored top to bottom",
    5: "mirrored about the diagonal from the top left",
    6: "turned by 90 deg clockwise",
    7: "mirrored about the diagonal from the top right",
    8: "turned by 90 deg counterclockwise",
}


def turned(images: NDArray[Any], code: int) -> NDArray[Any]:
    """Stored ``images`` (n, h, w) as they are shown: (n, h, w), or (n, w, h) where columns become rows."""
    transposed, mirror_x, mirror_y = STEPS[code]
    if transposed:
        images = images.swapaxes(1, 2)
    return images[:, :: -1 if mirror_y else 1, :: -1 if mirror_x else 1]


def swaps_axes(code: int) -> bool:
    """Whether columns of the stored images become rows."""
    return STEPS[code][0]


def code_of_matrix(matrix: Sequence[Sequence[float]]) -> int | None:
    """The code of a ``matrix`` (2, 2) from stored (x, y) to shown (x, y), y downwards, of any size.

    None unless it turns by whole right angles.
    """
    values = np.array(matrix, dtype=np.float64)
    largest = np.abs(values).max()
    # A matrix in fixed point is right to 1 / 65536.
    signs = np.where(np.abs(values) > 1e-3 * largest, np.sign(values), 0) if largest > 0 else values
    return next((code for code in STEPS if np.array_equal(_matrix(code), signs)), None)


def after_another(first: int, second: int) -> int:
    """The code of two steps, one after the other."""
    code = code_of_matrix((_matrix(second) @ _matrix(first)).tolist())
    assert code is not None
    return code


def _matrix(code: int) -> NDArray[np.float64]:
    transposed, mirror_x, mirror_y = STEPS[code]
    mirrored = np.diag([-1.0 if mirror_x else 1.0, -1.0 if mirror_y else 1.0])
    return mirrored @ np.array([[0.0, 1.0], [1.0, 0.0]]) if transposed else mirrored
