"""The ball and its poses: what the forward model draws."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from kornia.geometry.liegroup import So3
from torch import Tensor

#: Number of terms of the light: see `TexturedBall.light`.
LIGHT_TERMS = 4


@dataclass(frozen=True)
class Poses:
    """Pose and brightness of the ball in n images, float64."""

    centre: Tensor  # (n, 2), px
    orientation: Tensor  # rotations (n, 3, 3) from body to camera axes
    gain: Tensor  # brightness (n,) of the images relative to each other
    offset: Tensor  # (n,), grey levels
    added_radius: Tensor  # radius (n,) of the outline less that of the ball, px: it grows as the ball comes nearer

    @classmethod
    def at(cls, centre: Tensor, orientation: Tensor, added_radius: Tensor | None = None) -> Poses:
        """Poses with gain 1 and offset 0, and the radius of the ball where none is added."""
        zero = torch.zeros_like(centre[:, 0])
        return cls(centre, orientation, torch.ones_like(zero), zero, zero if added_radius is None else added_radius)

    @classmethod
    def joined(cls, parts: list[Poses]) -> Poses:
        """The poses of all parts, one after the other."""
        columns = zip(*(vars(part).values() for part in parts), strict=True)
        return cls(*(torch.cat(column) for column in columns))

    def __len__(self) -> int:
        return len(self.centre)

    def take(self, rows: Tensor | slice | list[int]) -> Poses:
        """Poses of the given rows."""
        return Poses(*(part[rows] for part in vars(self).values()))

    def radii(self, of_ball: Tensor | float) -> Tensor:
        """Radius (n,) of the outline in each image, px."""
        return of_ball + self.added_radius

    def moved(self, step: Tensor, radius: Tensor | float) -> Poses:
        """The poses after a ``step`` (n, 5) of (dx, dy, wx, wy, wz), px, of a ball of that ``radius``.

        Rotations are times the radius of the outline in each image.
        """
        step = step.double()
        rotation = So3.exp(step[:, 2:] / self.radii(radius).unsqueeze(1)).matrix()
        return replace(self, centre=self.centre + step[:, :2], orientation=rotation @ self.orientation)

    def enlarged(self, change: Tensor) -> Poses:
        """The poses after a ``change`` (n,) of the outlines' radii, px."""
        return replace(self, added_radius=self.added_radius + change.double())

    def brightened(self, change: Tensor) -> Poses:
        """The poses after a ``change`` (n, 2) of the gain and of the offset."""
        gain, offset = change.double().unbind(1)
        return replace(self, gain=self.gain + gain, offset=self.offset + offset)


@dataclass(frozen=True)
class TexturedBall:
    """Properties of the ball that all images share."""

    radius: Tensor  # radius of the outline (), px, float64
    edge_blur: Tensor  # standard deviation () of the optics' blur at the outline, px, without the width of a pixel
    cells: int  # cells along a face of the texture map
    coefficients: Tensor  # coefficients (m,) of the texture map
    # (4,): the light on a point of the surface is the first term plus the product of the others with its normal. This
    # is a matt ball under light from one side and from all around. Terms of second order, for attached shadows
    # (R. Basri and D. Jacobs, IEEE Trans. Pattern Anal. Mach. Intell. 25 (2003) 218, doi:10.1109/TPAMI.2003.1177153),
    # cannot be separated from the texture where the ball turns by less than a radian.
    light: Tensor
    # Standard deviation of the optics' blur, px, that a pixel's footprint on the surface has beside the pixel's width.
    footprint_blur: float = 0.0
    # Bend of the edge by the camera's tone curve: see `rays.bent`.
    edge_bend: float = 0.0
    # Number of rays of a pixel at the outline: see `rays.rim_points`.
    rim_points: int = 12
    # Whether the radius in each image is an unknown of its pose: the ball comes nearer or goes away.
    grows: bool = False
    # Whether it turns in its place: all images have one centre.
    stays: bool = False


def uniform_light(like: Tensor) -> Tensor:
    """Light (4,) that is the same from all sides."""
    return torch.eye(LIGHT_TERMS, dtype=like.dtype, device=like.device)[0]
