"""Pairs of images to be correlated: their crops, filtered, and the ball in the reference images."""

from __future__ import annotations

from typing import NamedTuple

from torch import Tensor

from torchsphere.correlation.reference import Filtered


class Pairs(NamedTuple):
    """What n pairs are measured from.

    Attributes
    ----------
    f, g : Filtered
        Crops of the reference and of the deformed images.
    circles : Tensor
        The ball in the reference images (n, 3), px, float64 on the CPU.
    """

    f: Filtered
    g: Filtered
    circles: Tensor

    @property
    def shift(self) -> Tensor:
        """From the ball's centre in the reference image to the deformed image's crop (n, 2), px."""
        return (self.circles[:, :2] - self.g.crops.origin).to(self.g.c)

    def rows(self, start: int, stop: int) -> Pairs:
        """Pairs ``start`` to ``stop - 1``."""
        return Pairs(self.f.rows(start, stop), self.g.rows(start, stop), self.circles[start:stop])

    def take(self, rows: Tensor) -> Pairs:
        """The given rows (m,) alone."""
        return Pairs(self.f.take(rows), self.g.take(rows), self.circles[rows.cpu()])
