"""Residual maps: each image minus the image before it, moved with the ball."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812  (torch's convention)
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation import znssd
from torchsphere.correlation.options import Options, margin
from torchsphere.correlation.reference import Filtered, build_reference
from torchsphere.correlation.warp import warp
from torchsphere.geometry import motion_models as motion
from torchsphere.geometry.camera import Camera
from torchsphere.imaging import crop, interlacing, interpolation

#: Largest radius of a ball, px, whose map has the pixels of the images.
MAX_FULL_RADIUS_PX = 72.0

#: Radius of a larger ball in its map, px: pixels are binned, so that a map takes about 1 ms for every camera.
BINNED_RADIUS_PX = 48.0


@dataclass(frozen=True)
class Pairs:
    """m pairs of images (h, w) of the ball; all values are finite."""

    before: Sequence[Tensor]
    after: Sequence[Tensor]
    circles: Tensor  # (x, y, radius) of the ball (m, 3) in the first image, px
    motion: Tensor  # (dx, dy, wx, wy, wz, growth) to the second image (m, 6), px, rad and a share of the radius


def bin_size(radius: float) -> int:
    """Side of the squares of pixels that are binned, px; 1 for none."""
    return 1 if radius <= MAX_FULL_RADIUS_PX else round(radius / BINNED_RADIUS_PX)


def options_of(settings: dict[str, Any]) -> Options:
    """Options of the correlation, from the ``settings`` of a `Track`."""
    names = set(Options.__dataclass_fields__)
    known = {name: value for name, value in settings.items() if name in names}
    camera = known.get("camera")
    return Options(**known | {"camera": Camera(**camera) if isinstance(camera, dict) else camera})


def residual_maps(pairs: Pairs, ignore: Tensor | None, options: Options) -> NDArray[np.float32]:
    """Second image minus first image within the region of interest, grey levels.

    Gain and offset are matched as in the ZNSSD, equation (3) of the paper. Images are blurred as in the correlation.

    Returns
    -------
    ndarray
        (m, s, s) around the ball's centre in the first image, rounded to whole pixels. NaN outside the region, and
        where a pixel of an image cannot be used.
    """
    k = bin_size(float(pairs.circles[:, 2].max()))
    half = crop.half_size(float(pairs.circles[:, 2].max()), margin(options))
    crops_f = crop.cut(pairs.before, pairs.circles[:, :2], half, ignore)
    crops_g = crop.cut(pairs.after, pairs.circles[:, :2] + pairs.motion[:, :2].to(pairs.circles), half, ignore)
    if interlacing.is_interlaced(crops_f):
        crops_f, crops_g = interlacing.one_field(crops_f), interlacing.one_field(crops_g)
    crops_f, crops_g = _binned(crops_f, k), _binned(crops_g, k)
    circles = pairs.circles.clone()
    circles[:, :2] = (circles[:, :2] - (k - 1) / 2) / k
    circles[:, 2] /= k
    camera = None if options.camera is None else options.camera.reduced(k)
    # The pattern is finer in binned pixels. Without this blur their aliasing dominates the residual.
    pre_blur = max(options.pre_blur, interpolation.PRE_BLUR_PX) if k > 1 else options.pre_blur
    reference = build_reference(
        Filtered.of(crops_f, pre_blur), circles, options.roi, pre_blur, camera, blurred_every=None
    )
    c_g = interpolation.coefficients(crops_g.images, pre_blur)
    model = motion.MODELS["finite" if options.model == "rigid" else options.model]
    q = pairs.motion[:, : motion.degrees_of_freedom(model)].clone()
    q[:, :2] /= k
    shift = (circles[:, :2] - crops_g.origin).to(c_g)
    warped, weights = warp(reference, c_g, shift, q.to(c_g), model)
    difference = -znssd.residual(reference.values, warped, weights)
    difference = torch.where(weights > 0, difference, torch.nan)
    maps = torch.full((len(difference), reference.side * reference.side), torch.nan)
    maps[:, reference.places.cpu()] = difference.float().cpu()
    return maps.unflatten(-1, (reference.side, reference.side)).numpy()


def _binned(crops: crop.Crops, k: int) -> crop.Crops:
    """The crops with ``k`` x ``k`` pixels binned to their mean; the origin is in binned pixels."""
    if k == 1:
        return crops
    usable = crops.usable
    if usable is not None:
        usable = F.max_pool2d((~usable)[:, None].to(crops.images), k)[:, 0] == 0
    return crop.Crops(F.avg_pool2d(crops.images[:, None], k)[:, 0], usable, crops.origin / k)
