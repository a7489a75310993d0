"""The limb of a speckled ball in a blurred image: circle, blur of the optics and exposure together.

Optics blur the image, not the surface. Across the outline the mean grey level falls as the blurred disc does; the
pattern falls earlier, as its spots are narrow near the limb. The motion during the exposure blurs the outline along
the motion alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from torchsphere.detection.limb_fit import (
    ARC,
    COMMON_PX,
    INWARDS_PX,
    RINGING,
    SPACING_PX,
    SYSTEMATIC_ARC,
    TEXTURE_ARC_PX,
    TEXTURE_PX,
    averaged,
    between,
    summed,
)
from torchsphere.geometry.camera import Camera
from torchsphere.imaging import polar

#: Standard deviation of the blur at the start, px, rounds of the fit, and rounds that tell a sharp image.
FIRST_BLUR_PX, ROUNDS, TRIAL_ROUNDS = 0.72, 30, 4

#: Largest change of the blur's variance in a round, as a share of it, and step, px, after which the fit has settled.
MOST_CHANGE, SETTLED_PX = 0.5, 0.005

#: Smallest and largest blur with the pixel's, px (docs/constants.toml).
LEAST_BLUR_PX, MOST_BLUR_PX = 0.45, 5.0

#: Blur and smear of the outline from which an image counts as blurred, px, and the blur after the rounds of the trial
#: from which the fit goes on (docs/constants.toml).
BLURRED_PX, SMEARED_PX, TRIAL_PX = 0.85, 2.2, 0.78

#: Least motion from frame to frame that may smear the outline, px.
LEAST_MOTION_PX = 2.0

#: Variance of the pattern over that which is left about the mean of its own arc (docs/constants.toml).
OWN_MEAN = 1.1

#: Reach inwards and start of the background in units of the blur, and length of the background's places, px.
INWARDS, INWARDS_MORE_PX, CLEAR, BACKGROUND_PX = 1.6, 3.0, 2.1, 4.5

#: Number of smears, px, in the table.
SMEARS = 9

#: Standard deviation of the pattern's correlation on the ball, px (docs/constants.toml).
PATTERN_PX = 2.4

#: Standard deviation of the result over that of the scores (docs/constants.toml).
SCORES_TO_SD = 2.5

#: Root of the depth of the pattern below the outline, px, and number of places in it.
ROOT_DEPTH, PLACES = 5.2, 80


@dataclass(frozen=True)
class LimbBlur:
    """Blur across the outline."""

    variance: float  # of optics and pixel together, px^2
    exposure: float  # exposure over the time between frames
    smear_px: float  # largest motion during the exposure, px

    @property
    def is_sharp(self) -> bool:
        """Whether the sharp limb of `limb_fit` describes the image."""
        return self.variance < BLURRED_PX**2 and self.smear_px < SMEARED_PX


@dataclass(frozen=True)
class _Profile:
    """Share of the mean level, and variance of the pattern, across the outline: (n, a, m) each."""

    mean: Tensor
    pattern: Tensor

    def change(self, other: _Profile, step: float) -> _Profile:
        """Derivative from the difference of the ``other`` profile, a ``step`` further."""
        return _Profile((other.mean - self.mean) / step, (other.pattern - self.pattern) / step)


@dataclass(frozen=True)
class _Limb:
    """What the model of the limb needs beside the blur."""

    steps: Tensor  # distances (m,) from the expected edge, px outwards
    radius: float
    motion: Tensor  # motion (n, a) per frame across the outline, px

    def profile(self, variance: float, exposure: float, shift: float = 0.0) -> _Profile:
        """The profile where the edge lies ``shift`` px outside the expected one."""
        smear = exposure * self.motion
        most = float(smear.max())
        smears = torch.linspace(0, most, SMEARS if most else 1, dtype=torch.float64)
        mean, pattern = self._table(variance, smears, shift)
        if len(smears) == 1:
            return _Profile(*(part[0].expand(*smear.shape, -1) for part in (mean, pattern)))
        at = smear * ((len(smears) - 1) / most)
        low = at.floor().long().clamp(max=len(smears) - 2)
        share = (at - low).unsqueeze(-1)
        return _Profile(*(part[low] + share * (part[low + 1] - part[low]) for part in (mean, pattern)))

    def _table(self, variance: float, smears: Tensor, shift: float) -> tuple[Tensor, Tensor]:
        """Mean share and pattern's variance (k, m) under each of the ``smears`` (k,), px."""
        root = (torch.arange(PLACES, dtype=torch.float64) + 0.5) * (ROOT_DEPTH / PLACES)
        depth, width = root.square(), 2 * root * (ROOT_DEPTH / PLACES)
        arc = self.radius * torch.asin((1 - depth / self.radius).clamp(-1, 1))
        alike = torch.exp(-0.5 * ((arc[:, None] - arc) / PATTERN_PX).square())
        nodes, shares = _gauss_rule()
        blur = math.sqrt(variance)
        # A straight edge in place of the circle enlarges the disc: see `sphere_map.rays.coverage`.
        steps = self.steps - shift + variance / (2 * self.radius)
        at = (steps[:, None] + 0.5 * smears[:, None, None] * nodes) / blur  # (k, m, nodes)
        mean = (0.5 * torch.erfc(at / math.sqrt(2)) * shares).sum(-1)
        apart = at.unsqueeze(-2) + (depth / blur)[:, None]  # (k, m, places, nodes)
        kernel = (torch.exp(-0.5 * apart.square()) * shares).sum(-1) * width / (math.sqrt(2 * math.pi) * blur)
        return mean, ((kernel @ alike) * kernel).sum(-1)


def _gauss_rule() -> tuple[Tensor, Tensor]:
    """Points from -1 to 1 and weights, of the sum 1, of a Gauss rule of three points."""
    half, other = math.sqrt(0.6), 5 / 18
    return torch.tensor([-half, 0.0, half], dtype=torch.float64), torch.tensor([other, 8 / 18, other]).double()


def fit_as_needed(
    images: Tensor,
    circles: Tensor,
    *,
    motion: Tensor | None = None,
    ignore: Tensor | None = None,
    camera: Camera | None = None,
    is_elliptic: bool = False,
    only_blurred: bool = False,
) -> tuple[Tensor, Tensor, LimbBlur] | None:
    """`fit` from the ``circles`` (n, 3) of sharp limbs, with a few rounds for sharp images; None without a limb.

    None for sharp images, too, if ``only_blurred`` ones count. ``motion`` (n, 2), px per frame, is not used where the
    ball hardly moves. See `fit` for outlines that are elliptic.
    """
    if motion is not None and float(motion.norm(dim=1).max()) < LEAST_MOTION_PX:
        motion = None
    given = partial(fit, images, motion=motion, ignore=ignore, camera=camera, is_elliptic=is_elliptic)
    try:
        found = given(circles, rounds=TRIAL_ROUNDS)
        near, _, blur = found
        if blur.variance >= TRIAL_PX**2 or blur.smear_px >= SMEARED_PX:
            # Circles that no image shows keep their first guess.
            found = given(torch.where(near.isfinite(), near, circles))
    except torch.linalg.LinAlgError:  # type: ignore[attr-defined]
        return None
    is_left_out = only_blurred and found[2].is_sharp
    return found if bool(found[0].isfinite().all(1).any()) and not is_left_out else None


def fit(
    images: Tensor,
    circles: Tensor,
    *,
    motion: Tensor | None = None,
    ignore: Tensor | None = None,
    camera: Camera | None = None,
    is_elliptic: bool = False,
    rounds: int = ROUNDS,
) -> tuple[Tensor, Tensor, LimbBlur]:
    """As `limb_fit.fit`, with one blur for all images, which is fitted, too; guesses are right to about the blur.

    ``motion`` (n, 2), px per frame: the outline is smeared along it by an unknown share, the exposure. One that
    ``is_elliptic`` may be longer than wide, as a lens or a near camera shows it, which is no smear. With the mean
    level M of the ball over the background, and the variances n^2 outside and c^2 of the pattern, grey levels d are
    normally distributed about ``M P`` with the variance ``n^2 + c^2 Q + e^2 (c^2 + M^2)``. P falls from 1 to 0 across
    the outline, Q is the variance that blur leaves of the pattern, and e the error of the interpolation. Fisher's
    scoring finds the maximum of the likelihood.
    """
    fitted = circles.to("cpu", torch.float64).clone()
    angles = polar.angles(float(fitted[0, 2]))
    design = polar.design(angles)
    across = torch.zeros(len(fitted), len(angles)) if motion is None else (design[:, :2] @ motion.T).T.abs()
    if is_elliptic:
        design = torch.cat((design, polar.ellipse(angles)), 1)
    shape = fitted.new_zeros(len(fitted), design.shape[1])
    splines = polar.Splines(images, ignore)
    count = 1 if motion is None else 2
    unknowns = torch.tensor([FIRST_BLUR_PX**2, 0.05][:count], dtype=torch.float64)
    for _ in range(rounds):
        variance, exposure = float(unknowns[0]), math.sqrt(float(unknowns[1:].sum()))
        widest = math.sqrt(variance + (exposure * float(across.max())) ** 2 / 12)
        limb = _Limb(_steps(widest), float(fitted[:, 2].mean()), across.double())
        levels, known = polar.across_edge(splines, fitted, limb.steps, angles, camera, shape @ design.T)
        score, information, texture = _scores(levels.double().cpu(), limb, widest, variance, exposure, count)
        score, normal, certain = _by_unknowns(score, information, design, known)
        step = _joint_step(score, normal, count)
        of_outlines = step[:-count].reshape(len(fitted), -1).clamp(-widest, widest)
        fitted = fitted + of_outlines[:, :3]
        shape[:, 3:] += of_outlines[:, 3:]
        before, limit = unknowns, MOST_CHANGE * widest**2
        unknowns = _within_bounds(unknowns + step[-count:].clamp(-limit, limit))
        if float(step[:-count].abs().max()) < SETTLED_PX and float((unknowns - before).abs().max()) < SETTLED_PX:
            break
    variance, exposure = float(unknowns[0]), math.sqrt(float(unknowns[1:].sum()))
    blur = LimbBlur(variance, exposure, exposure * float(across.max()))
    covariance = _covariance(score, normal, texture, certain, design)
    fitted[known.double().mean(-1) < 0.3] = math.nan
    return fitted, covariance, blur


def _covariance(score: Tensor, normal: Tensor, texture: Tensor, certain: Tensor, design: Tensor) -> Tensor:
    """Covariance (n, 3, 3) of the circles from the scatter of the scores, with the errors of `limb_fit` by texture."""
    by_texture = torch.zeros_like(score)
    by_texture[..., : design.shape[1]] = (TEXTURE_ARC_PX * texture * certain).unsqueeze(-1) * design
    scatter = SCORES_TO_SD**2 * summed(score, ARC) + summed(by_texture, SYSTEMATIC_ARC)
    inverse = torch.linalg.inv(normal)
    covariance = (inverse @ scatter @ inverse)[:, :3, :3]
    common = TEXTURE_PX * (texture.square() * certain).sum(-1) / certain.sum(-1).clamp_min(1e-9)
    covariance[:, 2, 2] += COMMON_PX**2 + common.square()
    return covariance


def _within_bounds(unknowns: Tensor) -> Tensor:
    """Variance, px^2, and square of the exposure within their bounds."""
    low = torch.tensor([LEAST_BLUR_PX**2, 0.0], dtype=torch.float64)[: len(unknowns)]
    high = torch.tensor([MOST_BLUR_PX**2, 1.0], dtype=torch.float64)[: len(unknowns)]
    return unknowns.clamp(low, high)


def _steps(widest: float) -> Tensor:
    """Distances (m,) from the outline at which the levels of a limb of that blur are taken, px outwards."""
    inwards = max(INWARDS_PX, INWARDS_MORE_PX + INWARDS * widest)
    outwards = CLEAR * widest + BACKGROUND_PX
    return torch.arange(-round(inwards / SPACING_PX), round(outwards / SPACING_PX) + 1).double() * SPACING_PX


def _scores(
    levels: Tensor, limb: _Limb, widest: float, variance: float, exposure: float, count: int
) -> tuple[Tensor, Tensor, Tensor]:
    """Scores (n, a, k) of each ray by the shift of its edge and by the blur, and Fisher's information (n, a, k, k).

    Also the background's standard deviation (n, a) beside the ball in units of the ball's deviation from its level.
    """
    profile, step = limb.profile(variance, exposure), 0.01
    changes = [profile.change(limb.profile(variance, exposure, step), step)]
    changes += [profile.change(limb.profile(variance + step, exposure), step)]
    if count > 1:
        changes += [profile.change(limb.profile(variance, math.sqrt(exposure**2 + step)), step)]
    clear = CLEAR * widest
    near = between(limb.steps, clear, clear + BACKGROUND_PX / 2)
    far = between(limb.steps, clear + BACKGROUND_PX / 2, clear + BACKGROUND_PX + SPACING_PX)
    within = between(limb.steps, -math.inf, 0.0)
    deviation = levels - levels[..., near].quantile(0.5, -1, keepdim=True)
    squared = deviation[..., far].square()
    common = 1.4826**2 * squared.flatten(1).median(-1).values
    outside = torch.maximum(averaged(squared.mean(-1), ARC), common.clamp_min(0.25)[:, None])

    def fitted(values: Tensor, shape: Tensor) -> Tensor:
        return averaged((values * shape)[..., within].sum(-1), ARC) / averaged(shape.square()[..., within].sum(-1), ARC)

    mean = fitted(deviation, profile.mean)[..., None]
    residual = deviation - mean * profile.mean
    beyond = residual.square()[..., within].sum(-1) - outside * (within.stop - within.start)
    pattern = OWN_MEAN * averaged(beyond, ARC) / averaged(profile.pattern[..., within].sum(-1), ARC)
    pattern = pattern.clamp_min(1e-3)[..., None]
    total = outside[..., None] + pattern * profile.pattern + RINGING**2 * (pattern + mean.square())
    by_mean = torch.stack([mean * change.mean / total.sqrt() for change in changes], -1)
    by_variance = torch.stack([pattern * change.pattern / total for change in changes], -1)
    normal = (residual / total.sqrt()).unsqueeze(-1)
    # Places nearer to each other than a px are not independent.
    score = (by_mean * normal + 0.5 * by_variance * (normal.square() - 1)).sum(2) * SPACING_PX
    information = (by_mean.mT @ by_mean + 0.5 * by_variance.mT @ by_variance) * SPACING_PX
    inside = deviation.square()[..., within].mean(-1)
    texture = (outside / (averaged(inside, ARC) - outside).clamp_min(1e-3)).clamp(max=1.0).sqrt()
    return score, information, texture


def _by_unknowns(score: Tensor, information: Tensor, design: Tensor, known: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Scores (n, a, k) by circle and blur, and normal matrices (n, k, k), from those by the shift of each edge.

    Also the information (n, a) of each ray on its edge.
    """
    blurs, outline = score.shape[-1] - 1, design.shape[1]
    spread = torch.zeros(len(design), 1 + blurs, outline + blurs, dtype=torch.float64)
    spread[:, 0, :outline] = design
    spread[:, 1:, outline:] = torch.eye(blurs, dtype=torch.float64)
    weighted = information * known[..., None, None]
    normal = torch.einsum("naij,aik,ajl->nkl", weighted, spread, spread)
    normal = normal + 1e-9 * torch.eye(outline + blurs, dtype=torch.float64)
    return torch.einsum("nai,aik->nak", score * known[..., None], spread), normal, weighted[..., 0, 0]


def _joint_step(score: Tensor, normal: Tensor, count: int) -> Tensor:
    """Step (k n + count,) of the outlines of n images, k unknowns each, and of the blur that they share."""
    n, own = len(normal), normal.shape[-1] - count
    size = own * n + count
    whole, gradient = torch.zeros(size, size, dtype=torch.float64), torch.zeros(size, dtype=torch.float64)
    for i in range(n):
        rows = torch.cat((torch.arange(own * i, own * i + own), torch.arange(own * n, size)))
        whole[rows[:, None], rows] += normal[i]
        gradient[rows] += score[i].sum(0)
    return torch.linalg.solve(whole, gradient)
