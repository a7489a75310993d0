"""The ball told from its background, in three ways, each right where another fails.

By its difference from the still background (the median of the recording; fails where the ball hardly moves), by its
difference from a uniform background (fails over texture), and by its change from frame to frame (fails for a plain
ball).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import torch
from torch import Tensor

from torchsphere.detection import ordered

#: Frames that tell the still background.
BACKGROUND_FRAMES = 25

Images = Callable[[int, int], Tensor]


def still_background(images: Images, count: int) -> Tensor | None:
    """Median (h, w) of frames spread over the recording; None where there are too few."""
    if count < 5:
        return None
    chosen = torch.linspace(0, count - 1, min(count, BACKGROUND_FRAMES)).round().long().tolist()
    return ordered.median(torch.cat([images(i, i + 1) for i in chosen]))


def silhouettes(
    images: Images, frame: int, count: int, background: Tensor | None, ignore: Tensor | None
) -> Iterator[tuple[Tensor, Tensor]]:
    """Maps (h, w) from 0 (background) to 1 (ball) of a frame, each with the image whose edges belong to it."""
    image = images(frame, frame + 1)[0]
    edge = max(2, min(image.shape) // 40)
    sides = (image[:edge], image[-edge:], image[:, :edge], image[:, -edge:])
    level = torch.cat([side.flatten() for side in sides]).median()
    maps = [((image - level).abs(), image)]
    if background is not None:
        maps.append(((image - background).abs(), image - background))
    neighbours = [images(i, i + 1)[0] for i in (frame - 1, frame + 1) if 0 <= i < count]
    if neighbours:
        # What the ball uncovers or covers next differs from one neighbour only; the ball's own pattern from both.
        maps.append((torch.stack([(n - image).abs() for n in neighbours]).amin(0), image))
    for difference, contrast in maps:
        if ignore is not None:
            difference = torch.where(ignore, 0.0, difference)
        if float(difference.max()) > 0:
            yield saturated(difference), contrast


def saturated(difference: Tensor) -> Tensor:
    """From 0 to 1: most of the image is background, whose spread is the noise; strong differences all count as one."""
    flat = difference.flatten()
    noise = 1.4826 * float(ordered.median(flat))
    strong = ordered.quantile(flat[:: max(1, len(flat) // 100_000)], 0.97)
    return (difference / max(5 * noise, 0.25 * strong, 1e-6)).clamp(max=1.0)
