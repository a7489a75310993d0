"""What the measured motion does not explain: each image minus the one before it, carried along with the ball."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation import znssd
from torchsphere.correlation.options import Options, margin
from torchsphere.correlation.reference import Filtered, build_reference
from torchsphere.correlation.warp import warp
from torchsphere.geometry import motion_models as motion
from torchsphere.geometry.camera import Camera
from torchsphere.imaging import crop, interlacing, interpolation

#: Radius of the ball, px, up to which a map has the images' own pixels; a larger ball's are means of several, so that a
#: map costs a ms or so whatever the camera. A map is looked at at the size of a thumb.
FULL_UP_TO_PX = 72.0
BINNED_TO_PX = 48.0


@dataclass(frozen=True)
class Pairs:
    """m pairs of images (h, w) of the ball, the place ``circles`` (m, 3) in the first of each, and the motion (m, k).

    The motion as (dx, dy, wx, wy, wz, growth): px and rad; all finite.
    """

    before: Sequence[Tensor]
    after: Sequence[Tensor]
    circles: Tensor
    motion: Tensor


def binning(radius: float) -> int:
    """Side of the squares of pixels whose means a map has, px."""
    return 1 if radius <= FULL_UP_TO_PX else round(radius / BINNED_TO_PX)


def options_of(settings: dict[str, Any]) -> Options:
    """The correlation's options from the ``settings`` of a `Track`."""
    names = set(Options.__dataclass_fields__)
    known = {name: value for name, value in settings.items() if name in names}
    camera = known.get("camera")
    return Options(**known | {"camera": Camera(**camera) if isinstance(camera, dict) else camera})


def residual_maps(pairs: Pairs, ignore: Tensor | None, options: Options) -> NDArray[np.float32]:
    """Second image minus first within the region of interest, grey levels.

    Gain and offset are matched, as the criterion has it (equation (3) of the paper); blurred as for the correlation.

    Returns
    -------
    ndarray
        (m, s, s) around the ball's centre in the first image (to the whole pixel), NaN outside the region and where
        an image cannot be used.
    """
    k = binning(float(pairs.circles[:, 2].max()))
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
    # In means of pixels the pattern is finer, so that without this blur their own aliasing is most of what is left.
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
    """The crops with means of ``k`` x ``k`` pixels for pixels; their origin counts in those."""
    if k == 1:
        return crops
    usable = crops.usable
    if usable is not None:
        usable = F.max_pool2d((~usable)[:, None].to(crops.images), k)[:, 0] == 0
    return crop.Crops(F.avg_pool2d(crops.images[:, None], k)[:, 0], usable, crops.origin / k)
