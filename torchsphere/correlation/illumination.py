"""Light that changes unevenly over the ball from image to image: an object near the ball shades one side.

Gain, offset and distant light are part of every criterion (`znssd.nuisances`). Without an allowance for uneven light, a
target that shades the ball changes the measured steps before the contact: a force that does not exist.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchsphere.correlation import residual_noise, znssd
from torchsphere.correlation.gauss_newton import Solution
from torchsphere.correlation.reference import Reference, nuisances
from torchsphere.geometry import motion_models
from torchsphere.geometry.motion_models import Displacement

#: Least sum of 15 squared scores of uneven light (docs/constants.toml).
MIN_UNEVEN_SCORE = 40.0

#: Largest turn out of the image plane at which uneven light is allowed for, deg (docs/constants.toml).
MAX_LIGHT_TURN_DEG = 1.0

#: Largest squared distance from the axis, in radii, at which the normal of a block is taken.
MAX_NORMAL_RADIUS2 = 0.9


def light_is_uneven(reference: Reference, solution: Solution, model: Displacement) -> Tensor:
    """True (n,) where the residual of a converged pair holds a smooth change of light.

    The residual is summed over blocks; each harmonic's sum over the blocks is compared with their scatter.
    """
    if reference.uneven_light or model not in motion_models.RIGID_BALL:
        return torch.zeros_like(solution.converged)
    difference = znssd.residual(reference.values, solution.warped, solution.weights)
    sums = residual_noise.block_sums(reference, difference[:, None], solution.weights)[:, 0]
    # All pairs have the same blocks.
    across = reference.surface[:1, :2] / reference.geometry.radius[0]
    ones = torch.ones_like(across[:, :1])
    x, y, count = residual_noise.block_sums(reference, torch.cat((across, ones), 1), ones[:, 0])[0]
    x, y = x / count.clamp_min(1), y / count.clamp_min(1)
    inwards = (MAX_NORMAL_RADIUS2 / (x * x + y * y).clamp_min(MAX_NORMAL_RADIUS2)).sqrt()
    x, y = x * inwards, y * inwards
    normals = torch.stack((x, y, -(1 - x * x - y * y).sqrt()))[None]
    harmonics = znssd.harmonics(normals)[0]
    score = (sums @ harmonics.T).square() / (sums.square() @ harmonics.square().T).clamp_min(1e-30)
    return is_light_identifiable(solution, model) & (score.sum(-1) > MIN_UNEVEN_SCORE)


def is_light_identifiable(solution: Solution, model: Displacement) -> Tensor:
    """True (n,) for converged pairs whose turn is too small for the changed view of the texture to look like light."""
    if model not in motion_models.RIGID_BALL:
        return torch.zeros_like(solution.converged)
    return solution.converged & (solution.q[:, 2:4].norm(dim=-1) < math.radians(MAX_LIGHT_TURN_DEG))


def in_reference_light(reference: Reference, warped: Tensor, weights: Tensor, model: Displacement) -> Tensor:
    """The deformed image (n, p) in the light of the reference where uneven light is allowed for, else unchanged."""
    if not reference.uneven_light:
        return warped
    # Equal gain first: the result must not depend on the deformed image's gain.
    difference = znssd.residual(reference.values, warped, weights)[:, None]
    return reference.values - znssd.project(difference, nuisances(reference, model, weights), weights)[:, 0]
