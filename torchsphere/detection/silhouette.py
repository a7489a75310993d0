"""Silhouettes of the ball by three differences, each valid where another fails.

From the still background, the median of the recording (not for a slow ball); from a uniform background (not over
texture); from frame to frame (not for a plain ball). NumPy selects medians 3 to 10 times faster than torch on a CPU.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import torch
from torch import Tensor


def median(values: Tensor) -> Tensor:
    """Median (...) along the first axis of ``values`` (n, ...), the lower of two; NaN if a value is NaN."""
    if not _selectable(values):
        return values.median(0).values
    middle = (len(values) - 1) // 2
    return torch.from_numpy(np.asarray(np.partition(values.numpy(), middle, axis=0)[middle]))


def quantile(values: Tensor, share: float) -> float:
    """Quantile of ``values`` (n,), interpolated, equal to `torch.quantile` to the last bit."""
    if not _selectable(values):
        return float(torch.quantile(values, share))
    rank = values.new_tensor(share) * (len(values) - 1)
    below, above = int(rank.floor()), int(rank.ceil())
    around = np.partition(values.numpy(), (below, above))[[below, above]]
    lower, upper = torch.from_numpy(around)
    return float(torch.lerp(lower, upper, rank - rank.floor()))


def _selectable(values: Tensor) -> bool:
    """Whether NumPy selects as torch does: on the CPU and without NaN."""
    return values.device.type == "cpu" and bool(values.sum().isfinite())


#: Frames whose median is the still background.
BACKGROUND_FRAMES = 25

#: Median of a difference along the image's border, over that in the whole image, below which the border alone is taken
#: for the background (docs/constants.toml).
QUIET_BORDER = 0.2

Images = Callable[[int, int], Tensor]


def still_background(images: Images, count: int) -> Tensor | None:
    """Median (h, w) of frames spread over the recording; None for fewer than 5."""
    if count < 5:
        return None
    chosen = torch.linspace(0, count - 1, min(count, BACKGROUND_FRAMES)).round().long().tolist()
    return median(torch.cat([images(i, i + 1) for i in chosen]))


def silhouettes(
    images: Images, frame: int, count: int, background: Tensor | None, ignore: Tensor | None
) -> Iterator[tuple[Tensor, Tensor]]:
    """Maps (h, w) from 0 (background) to 1 (ball) of a frame, each with its image for the edges."""
    image = images(frame, frame + 1)[0]
    maps = [((image - _border(image).median()).abs(), image)]
    if background is not None:
        maps.append(((image - background).abs(), image - background))
    neighbours = [images(i, i + 1)[0] for i in (frame - 1, frame + 1) if 0 <= i < count]
    if neighbours:
        # Background next to the ball differs from one neighbour only, the ball's pattern from both.
        maps.append((torch.stack([(n - image).abs() for n in neighbours]).amin(0), image))
    for difference, contrast in maps:
        if ignore is not None:
            difference = torch.where(ignore, 0.0, difference)
        if float(difference.max()) > 0:
            yield saturated(difference), contrast
            border = _border(difference) if ignore is None else _border(difference)[~_border(ignore)]
            if len(border) and float(median(border)) < QUIET_BORDER * float(median(difference.flatten())):
                # A ball that fills most of the image makes the median.
                yield saturated(difference, border), contrast


def _border(image: Tensor) -> Tensor:
    """The values (n,) along the four sides of an image (h, w)."""
    edge = max(2, min(image.shape) // 40)
    sides = (image[:edge], image[-edge:], image[:, :edge], image[:, -edge:])
    return torch.cat([side.flatten() for side in sides])


def saturated(difference: Tensor, background: Tensor | None = None) -> Tensor:
    """The difference (h, w) from 0 to 1, where strong differences are 1.

    The median of its values in the ``background`` (n,), by default of all values, is noise.
    """
    flat = difference.flatten()
    noise = 1.4826 * float(median(flat if background is None else background))
    strong = quantile(flat[:: max(1, len(flat) // 100_000)], 0.97)
    return (difference / max(5 * noise, 0.25 * strong, 1e-6)).clamp(max=1.0)
