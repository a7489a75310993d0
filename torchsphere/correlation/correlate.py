"""Image correlation of pairs: reference -> correlation operator, built once -> batched Gauss-Newton.

The criterion is the paper's equation (3): the squared difference between the reference image ``f`` and the deformed
image ``g`` at the displaced points, gain and offset chosen so that mean and standard deviation agree over the region
of interest (ZNSSD). The operator is that of equations (7) to (10). Beyond the paper, models of a turning ball leave
open what light that does not turn with it may change (`znssd.nuisances`). Inside, rotations are multiplied by the
radius, so that all unknowns are px and the operator is well scaled.

Here arguments are checked and crops cut; `solve` finds the motion, `uncertainty` judges it.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation.options import Options, adapt_pre_blur, margin, options_for
from torchsphere.correlation.pairs import Pairs
from torchsphere.correlation.reference import SLACK_PX, Filtered
from torchsphere.correlation.result import Correlation
from torchsphere.correlation.solve import solve, solve_coarsely
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import crop
from torchsphere.runtime import threads
from torchsphere.settings.arrays import as_images, as_mask, as_rows, check_circle

#: How far the circle of a pair may lie from where the pair before expects the ball, px, for one crop to serve both: it
#: leaves the ball as much again.
MAX_SHARED_CROP_PX = SLACK_PX / 2


def correlate(f: Any, g: Any, circle: Any, *, start: Any = None, ignore: Any = None, **options: Any) -> Correlation:
    """Measure the motion of the ball between the images of each pair.

    Parameters
    ----------
    f, g : array_like
        Reference and deformed images (n, h, w) or (h, w), NumPy or torch, grey levels. float64 images are measured
        in float64, all others in float32; the device is that of ``f``.
    circle : array_like or Circle
        Outline (x, y, radius) of the ball in ``f``, px: one for all pairs, or (n, 3), or a list of n `Circle`, with
        one radius. With a camera the projected centre and the radius at its depth, see `torchsphere.geometry.camera`.
    start : array_like, optional
        First guess of the increments, (5,) or (n, 5); by default none moves. It must be right to about half a
        speckle; `torchsphere.track` finds it by itself.
    ignore : array_like, optional
        (h, w), True where the images are not to be used.
    **options
        Fields of `Options`.

    Returns
    -------
    Correlation

    Raises
    ------
    ValueError
        If shapes do not fit, a circle is not finite or lies outside the image, or an option is out of its range.
    TypeError
        If there is no such option.

    Notes
    -----
    Equations (3) and (5) to (10) of the paper.
    """
    settings = options_for(correlate, options)
    f, g = as_images(f, "f"), as_images(g, "g")
    if f.shape != g.shape:
        raise ValueError(f"f and g must have one shape, got {tuple(f.shape)} and {tuple(g.shape)}")
    n = len(f)
    if f.dtype != g.dtype:
        raise ValueError(f"f and g must have one precision, got {f.dtype} and {g.dtype}; convert one of them")
    circles = as_rows(_as_numbers(circle), n, 3, "circle")
    check_circle(circles, f.shape[-2:])
    if "pre_blur" not in options:
        settings = adapt_pre_blur(settings, float(circles[:, 2].max()))
    first = as_rows(torch.zeros(5) if start is None else start, n, 5, "start").to(f)
    if not bool(first.isfinite().all()):
        raise ValueError("start: expected finite numbers dx, dy, wx, wy, wz in px and rad")
    mask = None if ignore is None else as_mask(ignore, f)
    if settings.camera is not None:
        if settings.camera.focal_px is None:
            raise ValueError("camera: pairs need its focal_px; only a track can tell it from the ball's distance")
        settings = dataclasses.replace(settings, camera=settings.camera.settled(f.shape))
    return correlate_pairs(f, g, circles, first, mask, settings)


def _as_numbers(circle: Any) -> Any:
    """A `Circle`, or each in a list, as (x, y, radius); all else as it is."""
    if isinstance(circle, Circle):
        return circle.x, circle.y, circle.radius
    return [_as_numbers(each) for each in circle] if isinstance(circle, (list, tuple)) else circle


def correlate_pairs(
    f: Tensor, g: Tensor, circles: Tensor, start: Tensor, ignore: Tensor | None, options: Options
) -> Correlation:
    """`correlate` for arguments that have been checked: ``circles`` (n, 3) in ``f``, float64, ``start`` (n, 5)."""
    half = crop.half_size(float(circles[:, 2].max()), margin(options))

    def part(a: int, b: int) -> Correlation:
        return _correlate_rows(f[a:b], g[a:b], circles[a:b], start[a:b], ignore, options, half)

    with threads.sharing(f.device, (2 * half) ** 2) as shared:
        return Correlation.joined(shared(part, len(f)))


def _correlate_rows(
    f: Tensor, g: Tensor, circles: Tensor, start: Tensor, ignore: Tensor | None, options: Options, half: int
) -> Correlation:
    """`correlate_pairs` on crops of ``2 half + 1`` px."""

    def filtered(images: Tensor | list[Tensor], centres: Tensor) -> Filtered:
        return Filtered.of(crop.cut(images, centres, half, ignore), options.pre_blur)

    balls, expected = circles[:, :2], circles[:, :2] + start[:, :2].to(circles)
    if _are_successive(f, g) and float((balls[1:] - expected[:-1]).abs().max()) <= MAX_SHARED_CROP_PX:
        # Every image but the first and the last is a deformed image and then a reference: it is filtered once.
        all_of_them = filtered([*f, g[-1]], torch.cat((balls, expected[-1:])))
        pairs = Pairs(all_of_them.rows(0, len(f)), all_of_them.rows(1, len(f) + 1), circles)
    else:
        pairs = Pairs(filtered(f, balls), filtered(g, expected), circles)
    start = start.to(pairs.g.c)
    near = solve_coarsely(pairs, start, options)
    found = solve(pairs, near.q, options, start)
    return dataclasses.replace(found, iterations=found.iterations + near.iterations, status=_with_lost(found, pairs))


def _are_successive(f: Tensor, g: Tensor) -> bool:
    """Whether each deformed image is the next pair's reference, in one place of the memory: two parts of one array.

    A GPU, which would have to copy them to one place, is as fast without.
    """
    return f.device.type == "cpu" and len(f) > 1 and f.stride() == g.stride() and f[1].data_ptr() == g.data_ptr()


def _with_lost(found: Correlation, pairs: Pairs) -> NDArray[np.str_]:
    """The status (n,) of each pair, "lost" where values that are no numbers leave nothing to be judged."""
    judged = ~np.isin(found.status, ("ok", "out_of_frame"))
    if not judged.any():
        return found.status
    # One such value is in all coefficients of its crop's spline.
    numbers = (pairs.f.crops.images.isfinite() & pairs.g.crops.images.isfinite()).flatten(1).all(1)
    return np.where(judged & ~numbers.cpu().numpy(), "lost", found.status)
