"""The exposure: a pixel shows the mean of what the moving ball shows while the shutter is open.

Outline and pattern are smeared along the motion of each image: the outline along the ball's path, each point of the
surface along its own. The model of an image is the mean of the models at moments of its exposure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce

import numpy as np
import torch
from torch import Tensor

from torchsphere.sphere_map import forward_model
from torchsphere.sphere_map.ball import Poses, TexturedBall
from torchsphere.sphere_map.design import Design
from torchsphere.sphere_map.forward_model import Linearisation
from torchsphere.sphere_map.window import Windows

#: Least smear of any point that is drawn, px: one of a px has the variance of a pixel (docs/constants.toml).
LEAST_SMEAR_PX = 1.0

#: Smear per moment, px, and largest number of moments (docs/constants.toml).
SMEAR_PER_MOMENT_PX, MAX_MOMENTS = 1.5, 16


@dataclass(frozen=True)
class Blur:
    """Blur of the images of a recording."""

    optics_px: float = 0.0  # standard deviation by the optics, px; 0 where the images are sharp
    open_share: float = 0.0  # exposure over the time between frames
    is_share_known: bool = False  # whether that exposure was given, or is that of the file
    outline_px: float = 0.0  # standard deviation across the outlines, px, of sharp images, too; 0 where it is not known


def moments(motion: Tensor, share: float, radius: float) -> Tensor | None:
    """`Windows.moments` (n, m, 5) of images in ``motion`` (n, 5) per frame, with the shutter open for that ``share``.

    ``motion`` is in px, rotations times the ``radius``. None where no point moves by `LEAST_SMEAR_PX`.
    """
    if not share or not len(motion):
        return None
    longest = share * float((motion[:, :2].norm(dim=1) + motion[:, 2:].norm(dim=1)).quantile(0.9))
    if longest < LEAST_SMEAR_PX:
        return None
    count = min(1 + math.ceil(longest / SMEAR_PER_MOMENT_PX), MAX_MOMENTS)
    at = torch.from_numpy(np.polynomial.legendre.leggauss(count)[0]).to(motion)
    return 0.5 * share * at.reshape(-1, 1) * motion.unsqueeze(1)


def linearise(windows: Windows, poses: Poses, ball: TexturedBall) -> Linearisation:
    """`forward_model.linearise`, with the exposure: the derivatives are those by the pose in its middle."""
    if windows.moments is None:
        return forward_model.linearise(windows, poses, ball)
    parts = _parts(windows, poses, ball)
    models = ((share, forward_model.linearise(windows, at, ball)) for share, at in parts)
    scaled = (Linearisation(share * model.levels, share * model.jacobian) for share, model in models)
    return reduce(lambda a, b: Linearisation(a.levels + b.levels, a.jacobian + b.jacobian), scaled)


def design(windows: Windows, poses: Poses, ball: TexturedBall) -> Design:
    """`forward_model.design`, with the exposure."""
    if windows.moments is None:
        return forward_model.design(windows, poses, ball)
    shares, moments = zip(*_parts(windows, poses, ball), strict=True)
    return Design.mean([forward_model.design(windows, at, ball) for at in moments], list(shares))


def _parts(windows: Windows, poses: Poses, ball: TexturedBall) -> list[tuple[float, Poses]]:
    """Share of the exposure, and poses, of each moment."""
    assert windows.moments is not None
    shares = 0.5 * np.polynomial.legendre.leggauss(windows.moments.shape[1])[1]
    moves = windows.moments.unbind(1)
    return [(float(share), poses.moved(move, ball.radius)) for share, move in zip(shares, moves, strict=True)]
