"""A recording in which a ball is looked for."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchsphere.detection.outline_arcs import Arcs, arcs_of
from torchsphere.detection.silhouette import Images, still_background


@dataclass(frozen=True)
class Scene:
    """Images, and what is known of them before a ball is found."""

    images: Images
    count: int
    background: Tensor | None  # still background (h, w); None for too few frames
    ignore: Tensor | None  # (h, w), True where the images are not to be used

    @classmethod
    def of(cls, images: Images, count: int, ignore: Tensor | None) -> Scene:
        """The scene of ``count`` frames."""
        return cls(images, count, still_background(images, count), ignore)

    def image(self, frame: int) -> Tensor:
        """Grey levels (h, w)."""
        return self.images(frame, frame + 1)[0]

    def views(self, frame: int) -> Tensor:
        """The image as recorded and, where it is known, minus the still background: (k, h, w)."""
        image = self.image(frame)
        # A slow ball is part of the median background: the image alone may show its limb better.
        return image[None] if self.background is None else torch.stack((image, image - self.background))

    def arcs(self, frame: int, circle: Tensor) -> Arcs:
        """Arcs of the ``circle`` (3,), px, in the view of a frame that shows more of them."""
        return max((arcs_of(view, circle, self.ignore) for view in self.views(frame)), key=lambda arcs: arcs.share)
