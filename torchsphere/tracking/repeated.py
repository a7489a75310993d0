"""Images that repeat the one before although the ball moves: a copy is no measurement."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.tracking.prediction import Seen

#: Rows of the images between those that are compared first: two images that differ do so in some of these.
SPARSE = 16


def repeats(images: Tensor, seen: Seen) -> NDArray[np.bool_]:
    """Which of the images (m + 1, h, w) after the first repeat the one before (m,), while the ball moves."""
    if not seen.moves:
        return np.zeros(len(images) - 1, dtype=bool)
    same = (images[1:, ::SPARSE] == images[:-1, ::SPARSE]).flatten(1).all(-1)
    if bool(same.any()):
        same = (images[1:] == images[:-1]).flatten(1).all(-1)
    return same.cpu().numpy()
