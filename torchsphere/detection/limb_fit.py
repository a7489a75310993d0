"""The limb of a speckled ball: the likeliest circle between background and pattern.

A speckle may have the background's grey level, and speckles share pixels of the limb: a single edge is no measure. Grey
levels along a ray have the background's small variance outside the circle and the pattern's large variance inside.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchsphere.geometry.camera import Camera
from torchsphere.imaging import polar

#: Standard deviation of the passage from background to pattern along a ray, px (docs/constants.toml).
BLUR_PX = 0.66

#: Blur in the first round, px, and rounds: half of them with a decreasing blur, half with the last.
FIRST_BLUR_PX, ROUNDS = 1.0, 8

#: Reach of the rays inwards and outwards, start of the background, and distance of the places on a ray, px.
INWARDS_PX, OUTWARDS_PX, CLEAR_PX, SPACING_PX = 4.0, 6.0, 1.5, 0.5

#: End of the places that give the background's level and start of those that give its variance, px
#: (docs/constants.toml).
MIDDLE_PX = 3.75

#: Error of a grey level between pixels, as a share of the contrast: the interpolation rings beside a sharp edge
#: (docs/constants.toml).
RINGING = 0.03

#: Share of the outline over which the variances are averaged and the errors of rays are correlated.
ARC = 0.1

#: Systematic error of an arc, px, and the share of the outline of such an arc (docs/constants.toml).
SYSTEMATIC_PX, SYSTEMATIC_ARC = 0.2, 0.125

#: Error of the radius that all shots of a kind share, px (docs/constants.toml).
COMMON_PX = 0.05

#: Error of an arc and of all arcs before a background as strong as the pattern, px (docs/constants.toml).
TEXTURE_ARC_PX, TEXTURE_PX = 2.0, 4.0


def fit(
    images: Tensor, circles: Tensor, *, ignore: Tensor | None = None, camera: Camera | None = None
) -> tuple[Tensor, Tensor]:
    """Likeliest circles (n, 3), float64, of speckled balls in ``images`` (n, h, w); their covariance (n, 3, 3), px^2.

    The guesses ``circles`` (n, 3) are right to about a px; with a camera, circles are projected centres and radii at
    their depth. A row is NaN where less than 30 % of the rays are known.

    With the deviation d of a grey level from the background, and the variances n^2 outside and s^2 inside, the
    logarithm of the likelihood is ``-(log v + d^2 / v) / 2``, ``v = n^2 + (P^2 + e^2) s^2``, where P falls from 1 to 0
    across the circle, and e is the error of the interpolation. Fisher's scoring finds its maximum. The covariance is
    that of an estimate under a wrong model, from the scatter of the scores (White, Econometrica 50 (1982), 1,
    doi:10.2307/1912526).
    """
    fitted = circles.to("cpu", torch.float64).clone()
    angles = polar.angles(float(fitted[0, 2]))
    design = polar.design(angles)
    splines = polar.Splines(images, ignore)
    steps = torch.arange(-INWARDS_PX, OUTWARDS_PX + SPACING_PX / 2, SPACING_PX, dtype=torch.float64)
    for turn in range(ROUNDS):
        blur = max(BLUR_PX, FIRST_BLUR_PX * (BLUR_PX / FIRST_BLUR_PX) ** (2 * turn / ROUNDS))
        levels, known = polar.across_edge(splines, fitted, steps, angles, camera)
        score, information, texture = (v * known for v in scores_of_rays(levels.double().cpu(), steps, blur))
        normal = (design.T * information[:, None]) @ design + 1e-9 * torch.eye(3, dtype=torch.float64)
        correction = torch.linalg.solve(normal, design.T @ score[..., None])[..., 0]
        fitted = fitted + correction.clamp(-blur, blur)
    scores = (score - information * (correction @ design.T))[..., None] * design
    by_arc = (SYSTEMATIC_PX**2 + (TEXTURE_ARC_PX * texture).square()).sqrt()
    systematic = (by_arc * information)[..., None] * design
    inverse = torch.linalg.inv(normal)
    covariance = inverse @ (summed(scores, ARC) + summed(systematic, SYSTEMATIC_ARC)) @ inverse
    common_error = TEXTURE_PX * (texture.square() * information).sum(-1) / information.sum(-1).clamp_min(1e-9)
    covariance[:, 2, 2] += COMMON_PX**2 + common_error.square()
    fitted[known.double().mean(-1) < 0.3] = math.nan
    return fitted, covariance


def scores_of_rays(levels: Tensor, steps: Tensor, blur: float) -> tuple[Tensor, Tensor, Tensor]:
    """Score (n, a), 1 / px, and Fisher's information, 1 / px^2, of each ray's edge, and the background's texture.

    ``levels`` (n, a, m) at the distances ``steps`` (m,) from the expected edge, px outwards. The texture (n, a) is the
    background's standard deviation beside the ball in units of the pattern's, at most 1.
    """
    near, far = between(steps, CLEAR_PX, MIDDLE_PX), between(steps, MIDDLE_PX, OUTWARDS_PX + SPACING_PX)
    background = levels[..., near].quantile(0.5, -1, keepdim=True)
    squared = (levels - background).square()
    # An arc before another object has its own, larger variance outside.
    common = 1.4826**2 * squared[..., far].flatten(1).median(-1).values
    outside = averaged(squared[..., far].mean(-1), ARC)
    outside = torch.maximum(outside, common.clamp_min(0.25)[:, None])
    within = between(steps, 1 - INWARDS_PX, -CLEAR_PX / 2)
    inside = (averaged(squared[..., within].mean(-1), ARC) - outside).clamp_min(1e-3)[..., None]
    t = steps / blur
    passage = 0.5 * torch.erfc(t / math.sqrt(2))
    slope = torch.exp(-0.5 * t**2) / (math.sqrt(2 * math.pi) * blur)
    variance = outside[..., None] + (passage**2 + RINGING**2) * inside
    relative = 2 * passage * slope * inside / variance
    # Places nearer to each other than a px are not independent.
    score = 0.5 * ((squared / variance - 1) * relative).sum(-1) * SPACING_PX
    texture = (outside / inside[..., 0]).clamp(max=1.0).sqrt()
    return score, 0.5 * relative.square().sum(-1) * SPACING_PX, texture


def between(steps: Tensor, low: float, high: float) -> slice:
    """The ascending ``steps`` (m,) between two limits, which are excluded."""
    return slice(int((steps <= low).sum()), int((steps < high).sum()))


def averaged(values: Tensor, share: float) -> Tensor:
    """Moving mean (n, a) or (n, a, k) over neighbouring rays that are this share of the outline."""
    half = max(1, round(share * values.shape[1] / 2))
    length = 2 * half + 1
    # Differences of running sums; Fourier transforms take half of the time of one image's fit.
    sums = torch.cat((values[:, -half - 1 :], values, values[:, :half]), 1).cumsum(1)
    return (sums[:, length:] - sums[:, :-length]) / length


def summed(terms: Tensor, share: float) -> Tensor:
    """Covariance (n, k, k) of the sum of terms (n, a, k) that are correlated within this share of the outline.

    Bartlett's weights, as the square of a moving mean.
    """
    mean = averaged(terms, share)
    return share * terms.shape[1] * mean.transpose(1, 2) @ mean
