"""The limb of a speckled ball: the circle outside of which the image is background and inside of which it is not.

A speckle may have any grey level, the background's too, and at the limb several share a pixel: no ray has a step of
known height, and one whose limb happens to look like the background shows its next speckle's edge instead. So no edge
is looked for. Grey levels along a ray have the background's small variance outside the circle and the pattern's
large one inside, and the circle is where that is likeliest. The pattern's variance is taken arc by arc: an arc as
dark as the background says nothing, and leaves the centre unknown along its direction.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchsphere.geometry.camera import Camera
from torchsphere.imaging import polar

#: Standard deviation of the passage from background to pattern along a ray, px: the pixel, the interpolation and the
#: speckles that share the last pixels. Chosen so that the radius has no bias: with 0.70 px +0.036 to -0.038 px, with
#: 0.74 px -0.007 to -0.059 px, in seven kinds of shots of two renderers (R = 30 to 80 px, three presets, three grey
#: levels behind the ball).
BLUR_PX = 0.72

#: Blur in the first round, and rounds: half of them until the blur is the last, half with it.
FIRST_BLUR_PX, ROUNDS = 1.0, 8

#: Reach of the rays inwards and outwards, where the background begins, and the distance of the places on a ray, px.
INWARDS_PX, OUTWARDS_PX, CLEAR_PX, SPACING_PX = 4.0, 6.0, 1.5, 0.5

#: Up to here the places beyond the limb tell the background's level, and from here how far it is from that, px: as far
#: away as the limb is on the other side. A texture differs the more, the farther. With level and variance from the same
#: places its blotches were taken for the ball's: radii 0.3 to 0.5 px too large before one of 10 grey levels, and 6 px
#: before one of 40 with spots of 5 px; now 0.1 px off.
MIDDLE_PX = 3.75

#: Share of the outline over which the variances are averaged and rays may err together.
ARC = 0.1

#: What an eighth of the outline is off by however little its rays scatter, px: its speckles are not the noise that the
#: likelihood takes them for. Measured: centres off by 0.10 px (R = 40 and 50 px) where the scatter tells 0.035.
SYSTEMATIC_PX, SYSTEMATIC_ARC = 0.2, 0.125

#: What the radius is off by in all shots of a kind alike, px: the root mean square of ten kinds' biases.
COMMON_PX = 0.05

#: A texture behind the ball is no white noise. What its standard deviation in units of the pattern's adds to what an
#: arc is off by, and its square to all arcs, px: chosen so that slow balls before four kinds of texture are off by 0.3
#: to 0.7 times what is stated, those whose background is known worst, which are off by 4 px, by 1.2 times.
TEXTURE_ARC_PX, TEXTURE_PX = 2.0, 4.0


def fit(
    images: Tensor, circles: Tensor, *, ignore: Tensor | None = None, camera: Camera | None = None
) -> tuple[Tensor, Tensor]:
    """Likeliest circles of speckled balls in n images, each from one that is right to about a px.

    Parameters
    ----------
    images : Tensor
        Grey levels (n, h, w).
    circles : Tensor
        First guesses (n, 3) as (x, y, radius), px.
    ignore : Tensor, optional
        (h, w), True where the images are not to be used.
    camera : Camera, optional
        The circles are projected centres and radii at their depth, before and after: the outline is an ellipse.

    Returns
    -------
    circles : Tensor
        (n, 3), float64; NaN where the rays tell no circle.
    covariance : Tensor
        (n, 3, 3), px^2.

    Notes
    -----
    With the deviation d of a grey level from the background, and the variances n^2 outside and s^2 inside, the
    logarithm of the likelihood is ``-(log v + d^2 / v) / 2``, ``v = n^2 + P^2 s^2``, where P falls from 1 to 0 across
    the circle. It is climbed by Fisher's scoring. The covariance is that of an estimate under a wrong model, from the
    scatter of the scores (White, Econometrica 50 (1982), 1, doi:10.2307/1912526).
    """
    fitted = circles.to("cpu", torch.float64).clone()
    angles = polar.angles(float(fitted[0, 2]))
    design = polar.design(angles)
    splines = polar.Splines(images, ignore)
    steps = torch.arange(-INWARDS_PX, OUTWARDS_PX + SPACING_PX / 2, SPACING_PX, dtype=torch.float64)
    for turn in range(ROUNDS):
        blur = max(BLUR_PX, FIRST_BLUR_PX * (BLUR_PX / FIRST_BLUR_PX) ** (2 * turn / ROUNDS))
        levels, known = polar.across_edge(splines, fitted, steps, angles, camera)
        score, information, texture = (v * known for v in _scores(levels.double().cpu(), steps, blur))
        normal = (design.T * information[:, None]) @ design + 1e-9 * torch.eye(3, dtype=torch.float64)
        correction = torch.linalg.solve(normal, design.T @ score[..., None])[..., 0]
        fitted = fitted + correction.clamp(-blur, blur)
    rest = (score - information * (correction @ design.T))[..., None] * design
    by_arc = (SYSTEMATIC_PX**2 + (TEXTURE_ARC_PX * texture).square()).sqrt()
    systematic = (by_arc * information)[..., None] * design
    inverse = torch.linalg.inv(normal)
    covariance = inverse @ (_summed(rest, ARC) + _summed(systematic, SYSTEMATIC_ARC)) @ inverse
    alike = TEXTURE_PX * (texture.square() * information).sum(-1) / information.sum(-1).clamp_min(1e-9)
    covariance[:, 2, 2] += COMMON_PX**2 + alike.square()
    fitted[known.double().mean(-1) < 0.3] = math.nan
    return fitted, covariance


def _scores(levels: Tensor, steps: Tensor, blur: float) -> tuple[Tensor, Tensor, Tensor]:
    """Derivative (n, a) of the likelihood's logarithm by each ray's edge, 1 / px, Fisher's information, 1 / px^2,
    and the background's standard deviation beside the ball in units of the pattern's, at most 1.

    ``levels`` (n, a, m) at the distances ``steps`` (m,) from the expected edge, px outwards.
    """
    near, far = _between(steps, CLEAR_PX, MIDDLE_PX), _between(steps, MIDDLE_PX, OUTWARDS_PX + SPACING_PX)
    background = levels[..., near].quantile(0.5, -1, keepdim=True)
    squared = (levels - background).square()
    # An arc before something else than the still background has its own, larger variance outside.
    common = 1.4826**2 * squared[..., far].flatten(1).median(-1).values
    outside = _averaged(squared[..., far].mean(-1), ARC)
    outside = torch.maximum(outside, common.clamp_min(0.25)[:, None])
    within = _between(steps, 1 - INWARDS_PX, -CLEAR_PX / 2)
    inside = (_averaged(squared[..., within].mean(-1), ARC) - outside).clamp_min(1e-3)[..., None]
    t = steps / blur
    passage = 0.5 * torch.erfc(t / math.sqrt(2))
    slope = torch.exp(-0.5 * t**2) / (math.sqrt(2 * math.pi) * blur)
    variance = outside[..., None] + passage**2 * inside
    relative = 2 * passage * slope * inside / variance
    # Places nearer to each other than a px are no measurements of their own.
    score = 0.5 * ((squared / variance - 1) * relative).sum(-1) * SPACING_PX
    texture = (outside / inside[..., 0]).clamp(max=1.0).sqrt()
    return score, 0.5 * relative.square().sum(-1) * SPACING_PX, texture


def _between(steps: Tensor, low: float, high: float) -> slice:
    """Those of the ascending ``steps`` (m,) that lie between, neither limit included."""
    return slice(int((steps <= low).sum()), int((steps < high).sum()))


def _averaged(values: Tensor, share: float) -> Tensor:
    """Mean (n, a) or (n, a, k) of each ray and its neighbours, which are that share of the outline together."""
    half = max(1, round(share * values.shape[1] / 2))
    length = 2 * half + 1
    # Differences of running sums: Fourier transforms were half of the time of one image's fit.
    sums = torch.cat((values[:, -half - 1 :], values, values[:, :half]), 1).cumsum(1)
    return (sums[:, length:] - sums[:, :-length]) / length


def _summed(terms: Tensor, share: float) -> Tensor:
    """Covariance (n, k, k) of the sum of terms (n, a, k) whose neighbours within that share of the outline go together.

    Bartlett's weights, as the square of a moving mean.
    """
    mean = _averaged(terms, share)
    return share * terms.shape[1] * mean.transpose(1, 2) @ mean
