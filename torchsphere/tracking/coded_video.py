"""Video after strong compression, as by H.264 or MPEG-4: images are drawn from pieces of the images before.

No camera's noise gives a piece of an image the same grey levels twice. A codec does, and leaves the ball's trail behind
it so. It moves pieces of the ball likewise, by quarters of a px, and mends only what is seen to be wrong.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.recording.level_scale import SAME, alike
from torchsphere.tracking.background_blocks import MIN_BLOCKS

#: Share of the background's blocks with a texture that are copies, from which the video is a codec's
#: (docs/constants.toml).
MIN_COPIES = 0.03

#: Error of the steps on a map of such images over the stated one, and size of a codec's steps, px
#: (docs/constants.toml).
WIDENING, VECTOR_PX = 2.0, 0.25

Array = NDArray[np.float64]


def is_coded(looks: Sequence[Tensor]) -> bool:
    """Whether parts of the background, `background_blocks`, are copied from image to image."""
    copies, total = 0, 0
    for first, following, _ in looks:
        is_textured = first.var(1) > SAME**2 if len(first) else torch.zeros(0, dtype=torch.bool)
        is_copy = alike(following, first).all(1)
        if not bool(is_copy.all()):
            # An image that is shown twice is no sign of a codec.
            copies, total = copies + int((is_copy & is_textured).sum()), total + int(is_textured.sum())
    return copies >= MIN_BLOCKS and copies > MIN_COPIES * total


def widened(covariance: Array, on_map: NDArray[np.bool_], radius: float) -> Array:
    """The ``covariance`` (n - 1, 5, 5) with a codec's errors; ``on_map`` (n,) is True for frames on a map of the ball.

    Steps between two images keep the error of a codec's step on the ball's front.
    """
    both = (on_map[:-1] & on_map[1:])[:, None, None]
    of_step = np.square(VECTOR_PX / np.array([1, 1, radius, radius, radius])) / 12
    return WIDENING**2 * covariance + np.where(both, 0.0, np.diag(of_step))
