"""Light that changes unevenly over the ball from one image to the next: what a target does that shades it.

The criterion allows for gain and offset, and for light far away that stays where it is (`znssd.nuisances`). An
object that the ball comes near to takes away light from one side of it, by some per cent of the limb's brightness per
frame. On rendered frontal impacts (four patterns) the steps towards the target then changed by 0.010 px and 0.017 deg
from the first frame to the last before the contact, the worst places left out as occluders: a force that is not there.
With nothing left out it was 0.017 px and 0.031 deg; with the light allowed for 0.002 px and 0.004 deg, as without a
target.
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

#: Sum of 15 squared scores, of mean 15 and standard deviation 5.5 where the residual is noise, from which the light
#: counts as uneven.
MIN_UNEVEN_SCORE = 40.0

#: Turn out of the image's plane from which the changing view of the texture passes for light, deg: allowing for it cost
#: 0.015 px and 0.02 deg at 3 deg.
MAX_LIGHT_TURN_DEG = 1.0

#: Largest squared distance from the axis, in radii, at which the normal of a block is taken.
MAX_NORMAL_RADIUS2 = 0.9


def light_is_uneven(reference: Reference, solution: Solution, model: Displacement) -> Tensor:
    """True (n,) where the residual of a converged pair holds a smooth change of light.

    The residual is summed over blocks of the region, as in `inflation`; each harmonic's sum over the blocks is
    compared with their scatter.
    """
    if reference.uneven_light or model not in motion_models.RIGID_BALL:
        return torch.zeros_like(solution.converged)
    difference = znssd.residual(reference.values, solution.warped, solution.weights)
    sums = residual_noise.block_sums(reference, difference[:, None], solution.weights)[:, 0]
    # The places of the blocks are the same for all pairs.
    across = reference.surface[:1, :2] / reference.geometry.radius[0]
    once = torch.ones_like(across[:, :1])
    x, y, count = residual_noise.block_sums(reference, torch.cat((across, once), 1), once[:, 0])[0]
    x, y = x / count.clamp_min(1), y / count.clamp_min(1)
    inwards = (MAX_NORMAL_RADIUS2 / (x * x + y * y).clamp_min(MAX_NORMAL_RADIUS2)).sqrt()
    x, y = x * inwards, y * inwards
    normals = torch.stack((x, y, -(1 - x * x - y * y).sqrt()))[None]
    of_light = znssd.harmonics(normals)[0]
    score = (sums @ of_light.T).square() / (sums.square() @ of_light.square().T).clamp_min(1e-30)
    return is_light_identifiable(solution, model) & (score.sum(-1) > MIN_UNEVEN_SCORE)


def is_light_identifiable(solution: Solution, model: Displacement) -> Tensor:
    """True (n,) for converged pairs of a ball whose texture is not seen so differently that this looks like light."""
    if model not in motion_models.RIGID_BALL:
        return torch.zeros_like(solution.converged)
    return solution.converged & (solution.q[:, 2:4].norm(dim=-1) < math.radians(MAX_LIGHT_TURN_DEG))


def in_reference_light(reference: Reference, warped: Tensor, weights: Tensor, model: Displacement) -> Tensor:
    """The deformed image (n, p) in the light of the reference, where uneven light is allowed for; else as it is."""
    if not reference.uneven_light:
        return warped
    # Of equal gain first: what is left must not depend on the deformed image's own.
    difference = znssd.residual(reference.values, warped, weights)[:, None]
    return reference.values - znssd.project(difference, nuisances(reference, model, weights), weights)[:, 0]
