"""The ball's outline: the circle through the edges along rays from the centre.

Along a ray the model is the background, a blurred step to the ball's grey level, and the step's shift: three linear
unknowns. A ray counts by the square of its step, because a speckled ball has limbs brighter and darker than the
background. The model reaches further outwards, over background, than inwards, over pattern.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchsphere.detection import robust_fit
from torchsphere.geometry.camera import Camera
from torchsphere.imaging import polar

#: Standard deviation of the step's blur by the pixel and the optics, px.
STEP_BLUR_PX = 0.4

#: Reach of the model inwards and outwards, in units of the step's blur.
INWARDS, OUTWARDS = 2.0, 8.0

#: Reach of a plain ball's edge inwards, as a fraction of the radius, and outwards, px.
PLAIN_INWARDS, PLAIN_OUTWARDS = 0.15, 6.0

#: Largest difference between neighbouring rays at a plain ball's limb, share of the edge's height.
PLAIN_UNREST = 0.08


@dataclass(frozen=True)
class OutlineFit:
    """Circles fitted to the edges of n images; a failed fit has a support of 0 and NaN elsewhere."""

    circle: Tensor  # (n, 3) as (x, y, radius), px, float64
    covariance: Tensor  # (n, 3, 3), px^2; rays with correlated errors (a speckle is wider than a ray) count as one
    support: Tensor  # share (n,) of the rays in the image whose edge lies on the circle
    contrast: Tensor  # median height (n,) of the step from background to ball, grey levels
    residual: Tensor  # of each ray's shift (n, a), px
    weights: Tensor  # weight (n, a) of each ray in the fit


def step_shifts(levels: Tensor, steps: Tensor, step_blur: float) -> tuple[Tensor, Tensor]:
    """Shift (n, a) of each ray's step from the expected edge, px outwards, and the step's height, grey levels.

    ``levels`` (n, a, m) at the distances ``steps`` (m,) from the expected edge, px outwards.
    """
    t = (steps / step_blur).to(levels)
    ball = 0.5 * torch.erfc(t / math.sqrt(2))
    shifted = torch.exp(-0.5 * t**2) / (math.sqrt(2 * math.pi) * step_blur)
    solve = torch.linalg.pinv(torch.stack((torch.ones_like(t), ball, shifted), -1))
    _, height, product = (levels @ solve.T).unbind(-1)
    # The linear model does not hold for a shift of more than the blur; the next round starts nearer.
    shift = product / torch.where(height.abs() < 1e-6, 1e-6, height)
    return shift.clamp(-1.5 * step_blur, 1.5 * step_blur), height


def centroid_shifts(levels: Tensor, steps: Tensor) -> tuple[Tensor, Tensor]:
    """`step_shifts` of a ball without pattern: centroid of the slope along the ray, which no symmetric blur moves."""
    height = levels[..., :1] - levels[..., -1:]
    height = torch.where(height.abs() < 1e-6, 1e-6, height)
    ball = (levels - levels[..., -1:]) / height
    spacing = steps[1] - steps[0]
    shift = steps[0] + spacing * 0.5 * (ball[..., 1:] + ball[..., :-1]).sum(-1)
    return shift.to(levels), height[..., 0]


def refine(
    images: Tensor,
    circles: Tensor,
    *,
    ignore: Tensor | None = None,
    window: float = 3.0,
    rounds: int = 6,
    fixed_radius: bool = False,
    plain: bool = False,
    patterned: bool = False,
    camera: Camera | None = None,
) -> OutlineFit:
    """Fit circles to the outlines in ``images`` (n, h, w), each from a guess (n, 3) that is right to ``window`` px.

    ``rounds``: how often the rays are cut around the last circle, with a narrower step each time. ``fixed_radius`` fits
    the centre alone. A ``plain`` ball takes `centroid_shifts` in the last two rounds. For a ``patterned`` ball in an
    image that is no silhouette, the other rounds use the difference from the background, since a wide window would find
    edges of the pattern. With a ``camera``, circles are projected centres and radii at their depth.
    """
    fitted = circles.to("cpu", torch.float64).clone()
    angles = polar.angles(float(fitted[0, 2]))
    k = 2 if fixed_radius else 3
    design = polar.design(angles)[:, :k]
    splines = polar.Splines(images, ignore)
    for turn in range(rounds):
        # The blur decreases geometrically to the sharpest step, which the last two rounds use.
        step_blur = STEP_BLUR_PX * max(window / STEP_BLUR_PX, 1.0) ** max(1 - turn / max(rounds - 2, 1), 0.0)
        by_centroid = plain and turn >= rounds - 2
        first, last = -INWARDS * step_blur, OUTWARDS * step_blur
        if by_centroid:
            first, last = -PLAIN_INWARDS * float(fitted[0, 2].nan_to_num(1.0)), PLAIN_OUTWARDS
        steps = torch.arange(first, last + 0.125, 0.25, dtype=torch.float64)
        levels, known = polar.across_edge(splines, fitted, steps, angles, camera)
        if patterned and turn < rounds - 2:
            levels = _silhouette(levels)
        shift, height = centroid_shifts(levels, steps) if by_centroid else step_shifts(levels, steps, step_blur)
        shift, height = shift.double().cpu(), height.double().cpu()
        correction, weights, normal = robust_fit.least_squares(design, shift, height.square() * known)
        fitted[:, :k] += correction
    residual = shift - correction @ design.T
    spread = robust_fit.covariance(residual, height.square() * known, weights, normal)
    on_circle = (weights > 0) & known & (residual.abs() < 1.0)
    steepness = torch.where(known, height.abs(), torch.nan)
    support = on_circle.sum(-1) / known.sum(-1).clamp_min(1)
    failed = (known.double().mean(-1) < 0.3) | ~fitted.isfinite().all(-1) | (fitted[:, 2] < 2)
    covariance = torch.full((len(fitted), 3, 3), torch.nan, dtype=torch.float64)
    covariance[:, :k, :k] = spread
    fitted[failed] = torch.nan
    support = torch.where(failed, 0.0, support)
    return OutlineFit(fitted, covariance, support, steepness.nanmedian(-1).values, residual, weights)


def _silhouette(levels: Tensor) -> Tensor:
    """Difference (n, a, m) of ``levels`` from the ray's outer end: 0 for background, 1 for a clear difference."""
    outer = levels[..., -(levels.shape[-1] // 3) :]
    background = outer.median(-1, keepdim=True).values
    noise = (outer - background).abs().flatten(1).median(-1).values
    difference = (levels - background).abs()
    strong = torch.quantile(difference.flatten(1), 0.9, dim=-1)
    return (difference / torch.maximum(5 * noise, 0.25 * strong).clamp_min(1e-6)[:, None, None]).clamp(max=1.0)


def centre_step(fit: OutlineFit) -> tuple[Tensor, Tensor]:
    """Step (2,) of the centre between two fits with one radius, px, and its covariance (2, 2).

    The covariance comes from the difference of both outlines ray by ray, without errors that both share.
    """
    design = polar.design(polar.angles(float(fit.circle[0, 2])))[:, :2]
    weights = fit.weights.amin(0)
    used = (weights > 0).double()
    change = (fit.residual[1] - fit.residual[0]) * weights.sqrt() * used
    normal = (design.T * weights) @ design + 1e-9 * torch.eye(2, dtype=torch.float64)
    variance = change.square().sum() / (used.sum() - 2).clamp_min(1) * robust_fit.run_length(change[None])[0]
    return fit.circle[1, :2] - fit.circle[0, :2], variance * torch.linalg.inv(normal)


def is_plain(image: Tensor, circle: Tensor) -> bool:
    """Whether the ball in ``image`` (h, w) has no pattern: its limb changes slowly along the ``circle`` (3,), px."""
    angles = polar.angles(float(circle[2]))
    radii = circle[2] * torch.tensor([[[0.80, 0.85, 0.90, 1.1]]], dtype=torch.float64)
    levels, inside = polar.levels(polar.Splines(image[None]), circle[None], radii, angles)
    known = inside.all(-1)[0].to(levels.device)
    limb, outside = levels[0, known, :3], levels[0, known, 3]
    if len(limb) < 16:
        return False
    unrest = (limb[4:] - limb[:-4]).abs().mean()
    return bool(unrest < PLAIN_UNREST * (limb.mean(-1) - outside).abs().median())
