"""The pixels around the ball in several images, as squares of one size."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchsphere.sphere_map.perspective import Optics

#: Width of the margin around the disc, px, for the blur of the edge and the error of the pose.
MARGIN_PX = 2.0


@dataclass(frozen=True)
class Windows:
    """Squares of s by s pixels around the ball in n images."""

    levels: Tensor  # grey levels (n, s, s) of the images
    background: Tensor  # grey levels (n, s, s) of the still background
    # (n, s, s), 1 where the pixel shows ball or background, 0 where it is ignored or far from the ball, less than 1
    # where an object may hide the ball.
    visibility: Tensor
    origin: Tensor  # image coordinates (n, 2) of the first pixels, px, float64
    optics: Optics | None = None  # None for an orthographic view
    bend: Tensor | None = (
        None  # where the pixels would be without the lens's distortion (n, s, s, 2), px from where they are
    )
    # Moves (n, m, 5) of the ball from the middle of each exposure to its moments, px, rotations times the radius: see
    # `exposure`. None for sharp images.
    moments: Tensor | None = None

    @classmethod
    def joined(cls, parts: list[Windows]) -> Windows:
        """The images of all parts, of one size and one camera, one after the other."""
        columns = zip(*((p.levels, p.background, p.visibility, p.origin) for p in parts), strict=True)
        levels, background, visibility, origin = (torch.cat(column) for column in columns)
        bends = [p.bend for p in parts if p.bend is not None]
        moments = [p.moments for p in parts if p.moments is not None]
        bend, moved = (torch.cat(column) if column else None for column in (bends, moments))
        return cls(levels, background, visibility, origin, parts[0].optics, bend, moved)

    def __len__(self) -> int:
        return len(self.levels)

    def take(self, rows: Tensor | slice) -> Windows:
        """Images of the given row numbers (k,)."""
        bend, moments = (None if part is None else part[rows] for part in (self.bend, self.moments))
        levels, background, visibility = self.levels[rows], self.background[rows], self.visibility[rows]
        return Windows(levels, background, visibility, self.origin[rows], self.optics, bend, moments)

    def with_visibility(self, visibility: Tensor) -> Windows:
        """The same pixels with another ``visibility`` (n, s, s)."""
        return replace(self, visibility=visibility)

    def seen_by(self, optics: Optics) -> Windows:
        """The same pixels seen by another camera."""
        return replace(self, optics=optics, bend=_bend(self.origin, self.levels.shape[-1], optics, self.levels))

    def offsets(self, centre: Tensor) -> tuple[Tensor, Tensor]:
        """Offsets x and y of the pixels from ``centre`` (n, 2), px, in the type of the images.

        They broadcast to (n, s, s): x (n, 1, s) and y (n, s, 1) in an orthographic view. In perspective they are the
        offsets that an orthographic view would have: see `perspective.View.offsets`.
        """
        steps = torch.arange(self.levels.shape[-1], dtype=centre.dtype, device=centre.device)
        x, y = (self.origin - centre).unbind(1)
        x, y = x.unsqueeze(1) + steps, y.unsqueeze(1) + steps
        x, y = x.to(self.levels.dtype).unsqueeze(1), y.to(self.levels.dtype).unsqueeze(2)
        if self.bend is not None:
            x, y = x + self.bend[..., 0], y + self.bend[..., 1]
        return (x, y) if self.optics is None else self.optics.view(centre).offsets(x, y)


def cut_windows(
    images: Tensor,
    background: Tensor,
    centres: Tensor,
    radius: float | Tensor,
    usable: Tensor | None = None,
    optics: Optics | None = None,
    moments: Tensor | None = None,
) -> Windows:
    """Cut squares around ``centres`` (n, 2) from ``images`` (n, h, w), with the pixels up to `MARGIN_PX` from the disc.

    The ``radius`` of the outline is that of all images, or of each (n,), px.

    ``background`` and ``usable``, where given, are (h, w); ``usable`` is False for pixels to ignore. With ``optics``
    the centres are those without the lens's distortion.
    """
    reach = torch.as_tensor(radius, dtype=torch.float64, device=centres.device) + MARGIN_PX
    if moments is not None:
        reach = reach + moments[..., :2].norm(dim=-1).max()
    half = half_size(centres, float(reach.max()), optics)
    at = centres if optics is None else optics.bent(centres)
    origin = at.double().round() - half
    levels, behind, inside = _squares(images, background, origin, 2 * half + 1, usable)
    levels = levels if levels.is_floating_point() else levels.float()
    behind = behind.to(levels)
    bend = None if optics is None else _bend(origin, 2 * half + 1, optics, levels)
    windows = Windows(levels, behind, levels, origin, optics, bend)
    across, down = windows.offsets(centres.double())
    seen = across.square() + down.square() < reach.square().to(across).reshape(-1, 1, 1)
    if inside is not None:
        seen = seen & inside
        # Ignored pixels may hold any value, NaN too.
        behind = torch.where(inside, behind, 0.0)
        levels = torch.where(inside, levels, 0.0)
    return Windows(levels, behind, seen.expand_as(levels).to(levels), origin, optics, bend, moments)


def half_size(centres: Tensor, reach: float, optics: Optics | None) -> int:
    """Pixels from the middle of a window to its border, for balls seen at ``centres`` (n, 2) with that ``reach``."""
    if optics is not None:
        reach *= optics.enlargement(centres, reach)
    return math.ceil(reach) + 1


def _bend(origin: Tensor, side: int, optics: Optics, like: Tensor) -> Tensor | None:
    """`Windows.bend` of windows of that ``side`` from ``origin`` (n, 2) on; None without a distortion."""
    if not optics.is_distorted:
        return None
    steps = torch.arange(side, dtype=origin.dtype, device=origin.device)
    points = origin.reshape(-1, 1, 1, 2) + torch.stack(
        (steps.expand(side, side), steps[:, None].expand(side, side)), -1
    )
    return (optics.straightened(points) - points).to(like)


def _squares(
    images: Tensor, background: Tensor, origin: Tensor, side: int, usable: Tensor | None
) -> tuple[Tensor, Tensor, Tensor | None]:
    """Squares (n, s, s) of the images and of the background from ``origin`` (n, 2) on, and the pixels that can be used.

    The last is None where all can.
    """
    height, width = images.shape[-2:]
    if images.device.type == "cpu" and usable is None:
        corners = origin.long().tolist()
        if all(0 <= x <= width - side and 0 <= y <= height - side for x, y in corners):
            # Slices are ten times faster than places.
            slices = [(slice(y, y + side), slice(x, x + side)) for x, y in corners]
            levels = torch.stack([image[s] for image, s in zip(images, slices, strict=True)])
            return levels, torch.stack([background[s] for s in slices]), None
    steps = torch.arange(side, device=images.device)
    x, y = (start.unsqueeze(1) + steps for start in origin.long().unbind(1))
    column, row = x.clamp(0, width - 1).unsqueeze(1), y.clamp(0, height - 1).unsqueeze(2)
    number = torch.arange(len(images), device=images.device).reshape(-1, 1, 1)
    inside = ((x >= 0) & (x < width)).unsqueeze(1) & ((y >= 0) & (y < height)).unsqueeze(2)
    if usable is not None:
        inside = inside & usable[row, column]
    return images[number, row, column], background[row, column], inside


def texture_variance(windows: Windows) -> float:
    """Median over the images of the grey levels' variance around the ball."""
    visible = windows.visibility
    count = visible.sum((1, 2)).clamp_min(1)
    mean = (visible * windows.levels).sum((1, 2)) / count
    squares = (visible * (windows.levels - mean.reshape(-1, 1, 1)).square()).sum((1, 2))
    return float((squares / count).median())
