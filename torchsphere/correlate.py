"""Image correlation of pairs: reference -> correlation operator, built once -> batched Gauss-Newton.

The criterion is the paper's equation (3): the squared difference between the reference image ``f`` and the deformed
image ``g`` at the displaced points, gain and offset chosen so that mean and standard deviation agree over the region
of interest (ZNSSD). The operator is that of equations (7) to (10). Beyond the paper, models of a turning ball leave
open what light that does not turn with it may change (`criterion.nuisances`). Inside, rotations are multiplied by the
radius, so that all unknowns are px and the operator is well scaled.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from numpy.typing import NDArray
from torch import Tensor

from torchsphere import covariance, criterion, crop, light, misfit, motion, robust
from torchsphere.inputs import as_images, as_mask, as_rows, check_circle
from torchsphere.motion import Displacement
from torchsphere.newton import (
    APPROACH_STEPS,
    EVERY,
    FEWEST,
    Approach,
    How,
    Solution,
    bring_near,
    gauss_newton,
)
from torchsphere.options import Options, margin
from torchsphere.reference import Filtered, Reference, build_reference, enough

STATUSES = ("ok", "weak_texture", "low_correlation", "not_converged", "out_of_frame", "lost")
OK, WEAK_TEXTURE, LOW_CORRELATION, NOT_CONVERGED, OUT_OF_FRAME, LOST = range(6)

#: Turn per pair from which the gradient of the deformed image is taken at each iterate, deg: that of the reference is
#: too far off at the limb by then.
GRADIENT_FROM_DEG = 2.0


@dataclass(frozen=True)
class Correlation:
    """Motion of n pairs; rows that are not "ok" are NaN in `q` and `covariance`.

    Attributes
    ----------
    q : Tensor
        Increment (n, 5) as (dx, dy, wx, wy, wz): px and rad, camera frame.
    covariance : Tensor
        (n, 5, 5), in the units of `q`.
    zncc : Tensor
        Zero-mean normalised cross-correlation coefficient (n,) over the region of interest, at the last iterate.
    iterations : Tensor
        Gauss-Newton steps taken (n,).
    growth, sd_growth : Tensor
        Relative change (n,) of the ball's size in the image and its standard deviation; 0 with models that do not know
        it, NaN like `q`.
    uneven_light : Tensor
        (n,), True where light that changes unevenly over the ball was allowed for: see `torchsphere.light`.
    status : ndarray
        Strings (n,), each one of `STATUSES`.
    """

    q: Tensor
    covariance: Tensor
    zncc: Tensor
    iterations: Tensor
    growth: Tensor
    sd_growth: Tensor
    uneven_light: Tensor
    status: NDArray[np.str_]

    @property
    def turn(self) -> Tensor:
        """Angle (n,) that the ball turns by, rad; NaN where it was not measured."""
        return self.q[:, 2:].norm(dim=-1)

    @classmethod
    def joined(cls, parts: Sequence[Correlation]) -> Correlation:
        """The rows of all parts, one after the other."""
        names = ("q", "covariance", "zncc", "iterations", "growth", "sd_growth", "uneven_light")
        fields = {name: torch.cat([getattr(part, name) for part in parts]) for name in names}
        return cls(status=np.concatenate([part.status for part in parts]), **fields)

    def split(self, sizes: Sequence[int]) -> list[Correlation]:
        """Parts of so many rows each, one after the other."""
        names = ("q", "covariance", "zncc", "iterations", "growth", "sd_growth", "uneven_light")
        fields = [getattr(self, name).split(sizes) for name in names]
        status = np.split(self.status, np.cumsum(sizes)[:-1])
        return [
            Correlation(status=own, **dict(zip(names, part, strict=True)))
            for own, *part in zip(status, *fields, strict=True)
        ]

    def replaced(self, rows: Tensor, other: Correlation) -> Correlation:
        """The same with the rows (m,) taken from ``other``."""
        status = self.status.copy()
        status[rows.cpu().numpy()] = other.status
        merged = {
            name: getattr(self, name).index_copy(0, rows, getattr(other, name))
            for name in ("q", "covariance", "zncc", "iterations", "growth", "sd_growth", "uneven_light")
        }
        return Correlation(status=status, **merged)


def correlate(f: Any, g: Any, circle: Any, *, start: Any = None, ignore: Any = None, **options: Any) -> Correlation:
    """Measure the motion of the ball between the images of each pair.

    Parameters
    ----------
    f, g : array_like
        Reference and deformed images (n, h, w) or (h, w), NumPy or torch, grey levels. float64 images are measured
        in float64, all others in float32; the device is that of ``f``.
    circle : array_like
        Outline (x, y, radius) of the ball in ``f``, px: one for all pairs, or (n, 3) with one radius. With a camera
        the projected centre and the radius at its depth, see `torchsphere.perspective`.
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

    Notes
    -----
    Equations (3) and (5) to (10) of the paper.
    """
    settings = Options(**options)
    f, g = as_images(f, "f"), as_images(g, "g")
    if f.shape != g.shape:
        raise ValueError(f"f and g must have one shape, got {tuple(f.shape)} and {tuple(g.shape)}")
    n = len(f)
    if f.dtype != g.dtype:
        raise ValueError(f"f and g must have one precision, got {f.dtype} and {g.dtype}; convert one of them")
    circles = as_rows(circle, n, 3, "circle")
    check_circle(circles, f.shape[-2:])
    first = as_rows(torch.zeros(5) if start is None else start, n, 5, "start").to(f)
    if not bool(first.isfinite().all()):
        raise ValueError("start: expected finite numbers dx, dy, wx, wy, wz in px and rad")
    mask = None if ignore is None else as_mask(ignore, f)
    if settings.camera is not None:
        if settings.camera.focal_px is None:
            raise ValueError("camera: pairs need its focal_px; only a track can tell it from the ball's distance")
        settings = dataclasses.replace(settings, camera=settings.camera.settled(f.shape))
    return correlate_pairs(f, g, circles, first, mask, settings)


def correlate_pairs(
    f: Tensor, g: Tensor, circles: Tensor, start: Tensor, ignore: Tensor | None, options: Options
) -> Correlation:
    """`correlate` for arguments that have been checked: ``circles`` (n, 3) in ``f``, float64, ``start`` (n, 5)."""
    half = crop.half_size(float(circles[:, 2].max()), margin(options))
    crops_f = crop.cut(f, circles[:, :2], half, ignore)
    crops_g = crop.cut(g, circles[:, :2] + start[:, :2].to(circles), half, ignore)
    pairs = Pairs(Filtered.of(crops_f, options.pre_blur), Filtered.of(crops_g, options.pre_blur), circles)
    start = start.to(pairs.g.c)
    near = approach(pairs, start, options)
    found = solve(pairs, near.near, options, start)
    return dataclasses.replace(found, iterations=found.iterations + near.steps)


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

    @classmethod
    def joined(cls, parts: Sequence[Pairs]) -> Pairs:
        """The pairs of all parts, whose crops have one size, one after the other."""
        if len(parts) == 1:
            return parts[0]
        f, g, circles = zip(*parts, strict=True)
        return cls(Filtered.joined(f), Filtered.joined(g), torch.cat(circles))

    def rows(self, start: int, stop: int) -> Pairs:
        """Pairs ``start`` to ``stop - 1``."""
        return Pairs(self.f.rows(start, stop), self.g.rows(start, stop), self.circles[start:stop])

    def take(self, rows: Tensor) -> Pairs:
        """The given rows (m,) alone."""
        return Pairs(self.f.take(rows), self.g.take(rows), self.circles[rows.cpu()])


def approach(pairs: Pairs, start: Tensor, options: Options) -> Approach:
    """Unknowns brought from ``start`` (n, 5) to within a hundredth of a px on a part of the points.

    Small balls have no points to spare and stay where they are.
    """
    radius = options.roi * float(pairs.circles[:, 2].max())
    points = math.pi * (radius / enough(radius, options.pre_blur)) ** 2
    if points < EVERY * FEWEST or options.max_iterations <= APPROACH_STEPS:
        return Approach.none(start)
    model = motion.MODELS[options.model]
    model = motion.finite if model is motion.rigid else model
    exact = bool((start[:, 2:].norm(dim=-1) >= math.radians(GRADIENT_FROM_DEG)).any())
    reference, first = _reference(pairs, start, model, options, every=EVERY)
    how = How(options.max_iterations, options.tolerance_px, exact or options.jacobian == "autograd")
    return bring_near(reference, pairs.g.c, pairs.shift, first, model, how)


def solve(pairs: Pairs, near: Tensor, options: Options, start: Tensor | None = None) -> Correlation:
    """Correlate n pairs: see `correlate`. From ``near`` (n, k), which came from ``start`` (n, 5) by `approach`."""
    start = near if start is None else start
    if motion.MODELS[options.model] not in (motion.rigid, *motion.EXACT):
        return _solve(pairs, near, start, options)
    exact = "finite" if options.model == "rigid" else options.model
    exactly = dataclasses.replace(options, model=exact, jacobian="autograd")
    # Measured at 0.57 deg per frame: the second order of the rotation, which `rigid` lacks, is half of its bias (0.0009
    # of 0.0018 deg), and costs a tenth of the time.
    slowly = options if options.finite_from_deg else dataclasses.replace(options, model=exact)
    limit = math.radians(options.finite_from_deg or GRADIENT_FROM_DEG)
    turning = near[:, 2:5].norm(dim=-1) >= limit
    if bool(turning.all()):
        return _solve(pairs, near, start, exactly)
    found = _solve(pairs, near, start, slowly, again_from=limit)
    # Rows whose turn asks for more, whether that was expected or is only found now.
    beyond = turning | (found.turn >= limit)
    if not bool(beyond.any()):
        return found
    rows = torch.nonzero(beyond)[:, 0]
    better = torch.where(found.q.isfinite() & ~turning[:, None], found.q, near[:, :5])[rows]
    return found.replaced(rows, _solve(pairs.take(rows), better, start[rows], exactly))


def _solve(
    pairs: Pairs, near: Tensor, start: Tensor, options: Options, again_from: float = math.inf, *, uneven: bool = False
) -> Correlation:
    """`solve` with one model for all rows; those that turn by ``again_from``, rad, or more are to be solved again.

    With ``uneven``, light that changes unevenly over the ball is allowed for; rows that show it are solved so by
    themselves.
    """
    model = motion.MODELS[options.model]
    reference, first = _reference(pairs, near, model, options)
    reference = dataclasses.replace(reference, uneven_light=uneven)
    c_g, shift = pairs.g.c, pairs.shift
    how = How(options.max_iterations, options.tolerance_px, options.jacobian == "autograd")
    solution = gauss_newton(reference, c_g, shift, first, model, how)
    visible = (solution.weights > 0).sum(-1)
    lit = light.is_uneven(reference, solution, model)
    # Judging takes a few steps of its own.
    if options.robust and model in (motion.rigid, *motion.EXACT) and options.max_iterations > robust.STEPS:
        doubt = ~solution.converged | robust.doubtful(reference, solution, model, options.pre_blur)
        # What is not explained of a large turn so far is no occluder.
        turned = solution.q[:, 2:5].norm(dim=-1) >= again_from
        doubt = doubt & ~(solution.converged & turned)
        if not uneven:
            # What looks like an occluder may be light; only what that does not explain is left out.
            lit = lit | (doubt & light.judgeable(solution, model))
            doubt = doubt & ~lit
        guesses = (first, as_unknowns(start, model))
        reference, solution = robust.reconsider(
            reference, c_g, shift, guesses, solution, doubt, model, how, options.pre_blur
        )
    found = _conclude(reference, solution, visible, model, options)
    rows = torch.nonzero(lit)[:, 0]
    if len(rows) == 0:
        return found
    again = _solve(pairs.take(rows), solution.q[rows], start[rows], options, again_from, uneven=True)
    return found.replaced(rows, dataclasses.replace(again, iterations=again.iterations + found.iterations[rows]))


def _reference(
    pairs: Pairs, start: Tensor, model: Displacement, options: Options, every: int = 1
) -> tuple[Reference, Tensor]:
    """The reference, weighted for a motion like ``start``, and that as the model's unknowns (n, k)."""
    first = as_unknowns(start, model)
    spacing = enough(options.roi * float(pairs.circles[:, 2].max()), options.pre_blur)
    reference = build_reference(
        pairs.f, pairs.circles, options.roi, options.pre_blur, options.camera, spacing=spacing, every=every
    )
    reference = _where_target_is_usable(reference, pairs.g.crops, pairs.shift, first, model)
    return robust.by_view(reference, first, model) if model in motion.EXACT else reference, first


def as_unknowns(increments: Tensor, model: Displacement) -> Tensor:
    """Increments (n, 5) as a model's unknowns (n, k): it may have fewer, or growth as a sixth."""
    k = motion.degrees_of_freedom(model)
    return F.pad(increments, (0, max(k - increments.shape[-1], 0)))[:, :k]


def _where_target_is_usable(
    reference: Reference, crops: crop.Crops, shift: Tensor, start: Tensor, model: Displacement
) -> Reference:
    """The reference with the weights of points that fall on unusable pixels of the deformed image set to 0.

    The first guess decides: it is right to a pixel or two, and weights that stay as they are let the iteration settle.
    """
    if crops.usable is None:
        return reference
    moved = reference.points + motion.displacement(model, start, reference.points, reference.geometry)
    last = crops.images.shape[-1] - 1
    at = (moved + shift[:, None]).nan_to_num(0.0).round().long().clamp(0, last)
    rows = torch.arange(len(at), device=at.device)[:, None]
    usable = crops.usable[rows, at[..., 1], at[..., 0]]
    return dataclasses.replace(reference, weights=reference.weights * usable)


def _conclude(
    reference: Reference, solution: Solution, visible: Tensor, model: Displacement, options: Options
) -> Correlation:
    """Status, covariance and coefficient of each pair; what cannot be vouched for becomes NaN.

    ``visible`` (n,) is the number of points in sight, whether they agree or not.
    """
    q, iterations, converged, warped, weights, jacobian, factor = solution
    coefficient = criterion.zncc(reference.values, warped, weights)
    warped = light.relit(reference, warped, weights, model)
    difference = criterion.residual(reference.values, warped, weights)
    gram = criterion.operator(jacobian, weights)
    spread = covariance.increment_covariance(reference, difference, weights, q, model, gram, options.pre_blur)
    wider = misfit.inflation(reference, jacobian, factor, difference, weights, spread)
    spread = spread * wider[:, :, None] * wider[:, None, :]
    carried = covariance.texture_carries_modes(reference, difference, weights, q, model, gram, options.pre_blur)
    points = torch.pi * (options.roi * reference.geometry.radius / reference.spacing) ** 2
    status = torch.full((len(q),), OK, device=q.device)
    for wrong, code in (
        (coefficient < options.min_zncc, LOW_CORRELATION),
        (~converged, NOT_CONVERGED),
        (~carried, WEAK_TEXTURE),
        (visible < options.min_visible * points, OUT_OF_FRAME),
    ):
        status = torch.where(wrong, code, status)
    good = status == OK
    k = min(q.shape[-1], 5)
    full_q = torch.zeros(len(q), 6).to(q)
    full_q[:, : q.shape[-1]] = q
    full_q = torch.where(good[:, None], full_q, torch.nan)
    # What a model does not measure it cannot state an uncertainty of.
    full = torch.full((len(q), 5, 5), torch.nan).to(spread)
    full[:, :k, :k] = spread[:, :k, :k]
    return Correlation(
        q=full_q[:, :5],
        covariance=torch.where(good[:, None, None], full, torch.nan),
        zncc=coefficient,
        iterations=iterations,
        growth=full_q[:, 5],
        uneven_light=torch.full_like(good, reference.uneven_light),
        sd_growth=torch.where(good, spread[:, 5, 5].sqrt() if q.shape[-1] == 6 else 0.0, torch.nan),
        status=np.array(STATUSES)[status.cpu().numpy()],
    )
