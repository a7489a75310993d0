"""Images with square pixels, from stored pixels that are wider than high or higher than wide.

The images are enlarged along the side along which a pixel is longer: nothing of them is thrown away. The outer edges of
the image stay where they are, as in a player.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Ratio of the sides less 1 that counts as the rounding of a square pixel's (docs/constants.toml).
SQUARE_WITHIN = 1e-4

#: Weight of a stored pixel that is left out, of a spline's that fall by a factor of 3.7 per px.
_NEGLIGIBLE = 1e-7


def is_square(aspect: float | None) -> bool:
    """Whether pixels of a width over height of ``aspect`` are square, or may be as nothing is stated."""
    return aspect is None or abs(aspect - 1) <= SQUARE_WITHIN


def stretch(aspect: float | None) -> float:
    """Longer over shorter side of a stored pixel: how far the images were enlarged."""
    return 1.0 if aspect is None or is_square(aspect) else max(aspect, 1 / aspect)


def shape_with_square_pixels(shape: tuple[int, int], aspect: float) -> tuple[int, int]:
    """Height and width in square pixels of images (h, w) of pixels with a width over height of ``aspect``."""
    height, width = shape
    return (height, round(width * aspect)) if aspect > 1 else (round(height / aspect), width)


def with_square_pixels(images: NDArray[Any], aspect: float) -> NDArray[np.float32]:
    """Stored ``images`` (n, h, w) enlarged to square pixels, by cubic splines."""
    shape: tuple[int, int] = (images.shape[1], images.shape[2])
    height, width = shape_with_square_pixels(shape, aspect)
    shown = np.empty((len(images), height, width), np.float32)
    for image, stored in zip(shown, images, strict=True):
        levels = stored.astype(np.float32)
        if aspect > 1:
            image[:] = (_weights(shape[1], width, aspect) @ levels.T).T
        else:
            image[:] = _weights(shape[0], height, 1 / aspect) @ levels
    return shown


@functools.lru_cache(maxsize=4)
def _weights(size: int, shown: int, ratio: float) -> csr_array:
    """Matrix (shown, size) of the weights of stored pixels that are longer by ``ratio`` than the shown ones."""
    # SciPy takes long to import, and most recordings have square pixels.
    from scipy.interpolate import make_interp_spline
    from scipy.sparse import csr_array

    places = ((np.arange(shown) + 0.5) / ratio - 0.5).clip(0, size - 1)
    degree = min(3, size - 1)
    matrix = make_interp_spline(np.arange(size), np.eye(size), k=degree)(places)
    matrix[np.abs(matrix) < _NEGLIGIBLE] = 0.0
    return csr_array(matrix.astype(np.float32))
