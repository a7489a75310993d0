"""Pose of the ball in one image against a known texture map: Gauss-Newton on the forward model."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchsphere.sphere_map import forward_model, pixel_weights
from torchsphere.sphere_map.pixel_weights import Profile
from torchsphere.sphere_map.projection import Ball, Pose
from torchsphere.sphere_map.window import Window

#: Steps at most, and the length below which the last one ends the iteration, px. Steps shrink tenfold each.
MAX_STEPS, TOLERANCE_PX = 12, 2e-3

#: Steps after which it is looked once more at what hides the ball, or one step no longer than this, px: a pose within a
#: hundredth of a px, as most are guessed, is right enough for that.
SECOND_LOOK, LOOK_AGAIN_PX = 2, 0.01

#: After a step no longer than this, px, the derivatives are those of the step before: they cost twice what the grey
#: levels do. In dim light a map is noisy, and with it they change within a fraction of a px: up to 0.05 and 0.2 px
#: steps were 8 and 16 % less precise there.
SLOPES_HOLD_PX = 0.01


@dataclass(frozen=True)
class Registration:
    """One image on the map.

    Attributes
    ----------
    pose : Pose
    covariance : Tensor
        (5, 5) of (dx, dy, wx, wy, wz), px, rotations times the radius; of the image's own noise alone.
    converged : bool
    misfit : float
        Mean square of the weighted residual; 1 where the image fits as well as those that made the map.
    """

    pose: Pose
    covariance: Tensor
    converged: bool
    misfit: float


def register(window: Window, pose: Pose, ball: Ball, profile: Profile) -> Registration:
    """Fit pose, gain and offset of one image, from a pose that is right to within half a speckle."""
    length, looks = torch.inf, 0
    for turn in range(MAX_STEPS):
        looked = looks == 0 or (looks == 1 and (turn == SECOND_LOOK or length <= LOOK_AGAIN_PX))
        looks += looked
        if length > SLOPES_HOLD_PX:
            now = forward_model.linearised(window, pose, ball, of_ball=False)
        else:
            now = replace(now, levels=forward_model.appearance(window, pose, ball))
        if looked:
            lit = pixel_weights.levelled(window, pose, profile, now.levels)
            now, pose = now.relit(pose, lit), lit
            window = pixel_weights.doubt(window, pose, profile, now.levels)
        weights = pixel_weights.weights(window, pose, profile)
        rest = window.levels - now.levels
        # Gain and offset move with the pose, so that they take nothing of its motion.
        slopes = torch.cat((now.slopes, now.levels[:, None] / 100, torch.ones_like(rest)[:, None]), -1)
        normal = (slopes.T @ (weights[:, None] * slopes)).double()
        normal = normal + 1e-9 * normal.trace() * torch.eye(len(normal), dtype=normal.dtype)
        inverse = torch.linalg.inv(normal)
        step = inverse @ (slopes.T @ (weights * rest)).double()
        length = float(step[:5].abs().max())
        if not length < ball.radius:
            break
        pose = forward_model.moved(pose, step[:5], ball.radius)
        change = 1 + float(step[5]) / 100
        pose = replace(pose, gain=pose.gain * change, offset=pose.offset * change + float(step[6]))
        if length < TOLERANCE_PX and looks == 2:
            break
    used = (window.trust > 0.5).to(rest)
    misfit = float((weights * used * rest.square()).sum() / used.sum().clamp_min(1))
    return Registration(pose, inverse[:5, :5], length < 5 * TOLERANCE_PX, misfit)


def own_covariance(window: Window, pose: Pose, ball: Ball, profile: Profile) -> Tensor:
    """`Registration.covariance` (5, 5) of an image whose pose is known already."""
    now = forward_model.linearised(window, pose, ball, of_ball=False)
    slopes = torch.cat((now.slopes, now.levels[:, None], torch.ones_like(now.levels)[:, None]), -1)
    weights = pixel_weights.weights(window, pose, profile)
    return torch.linalg.inv((slopes.T @ (weights[:, None] * slopes)).double())[:5, :5]
