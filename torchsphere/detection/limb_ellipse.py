"""Whether the limb of a ball is an ellipse with axes along the image's, as where pixels are not square.

The fit is that of `limb_fit`, with an outline of the distance ``R (1 + e cos 2 a + s sin 2 a)`` at the angle a. It
begins on a coarse scale, as an outline of pixels of 5:4 lies an eighth of the radius off its circle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchsphere.detection import limb_fit
from torchsphere.imaging import polar

#: Rounds of the fit on each coarse scale and on the finest, and distance from the outline on the coarsest, radii.
COARSE_ROUNDS, ROUNDS, COARSEST = 4, 10, 0.12


def fit(images: Tensor, circles: Tensor, ignore: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """Coefficients (n, 2), e and s, of the limbs of ``images`` (n, h, w) near ``circles`` (n, 3), and their sd (n, 2).

    Width over height of the outline is ``(1 + e) / (1 - e)``. A row is NaN where less than half of the rays are known.
    """
    fitted = torch.cat((circles.to("cpu", torch.float64), torch.zeros(len(circles), 2, dtype=torch.float64)), 1)
    splines, angles = polar.Splines(images, ignore), polar.angles(float(fitted[0, 2]))
    coarsest = COARSEST * float(fitted[:, 2].max()) / limb_fit.INWARDS_PX
    scales = [2.0**k for k in range(math.ceil(math.log2(max(coarsest, 1.0))) + 1, 0, -1) for _ in range(COARSE_ROUNDS)]
    for scale in [*scales, *(ROUNDS * [1.0])]:
        rays = _rays(splines, fitted, angles, scale)
        normal = rays.design.mT @ (rays.information[..., None] * rays.design) + 1e-9 * torch.eye(5, dtype=torch.float64)
        correction = torch.linalg.solve(normal, rays.design.mT @ rays.score[..., None])[..., 0]
        radius = fitted[:, 2:3]
        most = scale * torch.cat((torch.ones_like(radius).expand(-1, 3), 1 / radius.expand(-1, 2)), 1)
        fitted = fitted + correction.clamp(-most, most)
    by_arc = (limb_fit.SYSTEMATIC_PX**2 + (limb_fit.TEXTURE_ARC_PX * rays.texture).square()).sqrt()
    scatter = limb_fit.summed(rays.score[..., None] * rays.design, limb_fit.ARC)
    systematic = limb_fit.summed((by_arc * rays.information)[..., None] * rays.design, limb_fit.SYSTEMATIC_ARC)
    inverse = torch.linalg.inv(normal)
    sd = (inverse @ (scatter + systematic) @ inverse).diagonal(dim1=1, dim2=2).clamp_min(0).sqrt()
    fitted[(rays.information > 0).double().mean(-1) < 0.5] = math.nan
    return fitted[:, 3:], sd[:, 3:]


@dataclass(frozen=True)
class _Rays:
    """Rays (n, a) across the outlines; 0 where a ray is not known."""

    score: Tensor  # of each ray's edge, 1 / px
    information: Tensor  # 1 / px^2
    texture: Tensor  # of the background, in units of the pattern's
    design: Tensor  # (n, a, 5): derivatives of the outline's distance, in units of the scale


def _rays(splines: polar.Splines, fitted: Tensor, angles: Tensor, scale: float) -> _Rays:
    """Rays across the outlines ``fitted`` (n, 5): x, y, radius, e and s; ``scale`` is the unit of length, px."""
    end, step = limb_fit.OUTWARDS_PX, limb_fit.SPACING_PX
    steps = torch.arange(-limb_fit.INWARDS_PX, end + step / 2, step, dtype=torch.float64)
    around, radius = torch.stack(((2 * angles).cos(), (2 * angles).sin()), -1), fitted[:, 2:3]
    edge = radius * (1 + fitted[:, 3:] @ around.T)
    levels, inside = polar.levels(splines, fitted[:, :3], (edge[..., None] + scale * steps).clamp_min(0.5), angles)
    known = inside.all(-1).cpu()
    score, information, texture = limb_fit.scores_of_rays(levels.double().cpu(), steps, limb_fit.BLUR_PX)
    design = torch.cat((polar.design(angles).expand(len(fitted), -1, -1), radius[..., None] * around), -1) / scale
    return _Rays(score * known, information * known, texture * known, design)
