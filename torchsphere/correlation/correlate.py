"""Image correlation of pairs: checks of the arguments, crops, and the solution by `solve`.

Inside the package rotations are multiplied by the radius, so that all unknowns are px and the operator is well scaled.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation import frame_status
from torchsphere.correlation.options import Options, adapt_pre_blur, margin, options_for
from torchsphere.correlation.reference import SLACK_PX, Filtered, Pairs
from torchsphere.correlation.result import Correlation
from torchsphere.correlation.solve import solve, solve_coarsely
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import crop
from torchsphere.runtime import threads
from torchsphere.settings.arrays import as_images, as_mask, as_rows, check_circle
from torchsphere.settings.limits import require_one_of

#: Largest distance of a pair's circle from the circle expected by the pair before, for one crop of both, px.
MAX_SHARED_CROP_PX = SLACK_PX / 2


def correlate(
    f: Any, g: Any, circle: Any, *, start: Any = None, ignore: Any = None, engine: str = "fast", **options: Any
) -> Correlation:
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
        First guess of the increments, (5,) or (n, 5); 0 by default. It must be right to about half a speckle;
        `torchsphere.track` finds it by itself.
    ignore : array_like, optional
        (h, w), True where the images are not to be used.
    engine : str
        "fast", or "plain": the same criterion in plain torch and Kornia (`torchsphere.correlation.plain`), over every
        pixel of the region, with the exact rotation at any angle. Occluders and uneven light only widen its
        covariance: ``robust`` and ``finite_from_deg`` have no effect.
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
    require_one_of(("fast", "plain"))("engine", engine)
    if engine == "plain":
        from torchsphere.correlation.plain_engine import correlate_plain  # Kornia's warps take a second to load

        return correlate_plain(f, g, circles, first, mask, settings)
    return correlate_pairs(f, g, circles, first, mask, settings)


def _as_numbers(circle: Any) -> Any:
    """A `Circle`, or each `Circle` of a list, as (x, y, radius); other values unchanged."""
    if isinstance(circle, Circle):
        return circle.x, circle.y, circle.radius
    return [_as_numbers(each) for each in circle] if isinstance(circle, (list, tuple)) else circle


def correlate_pairs(
    f: Tensor, g: Tensor, circles: Tensor, start: Tensor, ignore: Tensor | None, options: Options
) -> Correlation:
    """`correlate` for checked arguments: ``circles`` (n, 3) in ``f``, float64, ``start`` (n, 5)."""
    half = crop.half_size(float(circles[:, 2].max()), margin(options))

    def correlate_rows(a: int, b: int) -> Correlation:
        return _correlate_rows(f[a:b], g[a:b], circles[a:b], start[a:b], ignore, options, half)

    with threads.row_runner(f.device, (2 * half) ** 2) as shared:
        return Correlation.joined(shared(correlate_rows, len(f)))


def _correlate_rows(
    f: Tensor, g: Tensor, circles: Tensor, start: Tensor, ignore: Tensor | None, options: Options, half: int
) -> Correlation:
    """`correlate_pairs` on crops of ``2 half + 1`` px."""

    def filtered(images: Tensor | list[Tensor], centres: Tensor) -> Filtered:
        return Filtered.of(crop.cut(images, centres, half, ignore), options.pre_blur)

    balls, expected = circles[:, :2], circles[:, :2] + start[:, :2].to(circles)
    if _are_successive(f, g) and float((balls[1:] - expected[:-1]).abs().max()) <= MAX_SHARED_CROP_PX:
        # Every inner image is a deformed image and then a reference: it is filtered once.
        images = filtered([*f, g[-1]], torch.cat((balls, expected[-1:])))
        pairs = Pairs(images.rows(0, len(f)), images.rows(1, len(f) + 1), circles)
    else:
        pairs = Pairs(filtered(f, balls), filtered(g, expected), circles)
    start = start.to(pairs.g.c)
    coarse = solve_coarsely(pairs, start, options)
    found = solve(pairs, coarse.q, options, start)
    return dataclasses.replace(found, iterations=found.iterations + coarse.iterations, status=_with_lost(found, pairs))


def _are_successive(f: Tensor, g: Tensor) -> bool:
    """Whether each deformed image is the next pair's reference in memory; on a GPU sharing them saves no time."""
    return f.device.type == "cpu" and len(f) > 1 and f.stride() == g.stride() and f[1].data_ptr() == g.data_ptr()


def _with_lost(found: Correlation, pairs: Pairs) -> NDArray[np.str_]:
    """The status (n,) of each pair, "lost" where a crop of a failed pair holds a value that is not finite."""
    if (found.status == frame_status.OK).all():
        return found.status
    # One such value changes all coefficients of its crop's spline.
    finite = (pairs.f.crops.images.isfinite() & pairs.g.crops.images.isfinite()).flatten(1).all(1)
    return frame_status.of_unknown_values(found.status, finite.cpu().numpy())
