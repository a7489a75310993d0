"""Registration of one image on a known texture map: Gauss-Newton on the forward model."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchsphere.sphere_map import forward_model, pixel_weights
from torchsphere.sphere_map.forward_model import Pose, TexturedBall
from torchsphere.sphere_map.pixel_weights import ResidualProfile
from torchsphere.sphere_map.window import Window

#: Largest number of steps, and length of the last step, px (docs/constants.md).
MAX_STEPS, TOLERANCE_PX = 12, 2e-3

#: Number of steps, or length of a step, px, before the second estimate of the weights (docs/constants.md).
REWEIGHT_STEP, REWEIGHT_PX = 2, 0.01

#: Length of a step, px, up to which the next step uses the same Jacobian (docs/constants.md).
KEEP_JACOBIAN_PX = 0.01

#: Scale of the gain's unknown: a grey level, roughly.
GAIN_SCALE = 100


@dataclass(frozen=True)
class Registration:
    """Pose of one image on the map."""

    pose: Pose
    covariance: Tensor  # (5, 5) of (dx, dy, wx, wy, wz), px, rotations times the radius, by the image's own noise alone
    converged: bool
    misfit: float  # mean square of the weighted residual; 1 if the image fits as well as the images that made the map


def register(window: Window, pose: Pose, ball: TexturedBall, profile: ResidualProfile) -> Registration:
    """Fit pose, gain and offset of one image, from a pose with an error of up to half a speckle.

    Gain and offset are unknowns beside the pose, so that they do not take up a part of its motion.
    """
    length, estimates = torch.inf, 0
    for step_number in range(MAX_STEPS):
        if length > KEEP_JACOBIAN_PX:
            model = forward_model.linearise(window, pose, ball, by_ball=False)
        else:
            model = replace(model, levels=forward_model.predict(window, pose, ball))
        settling = step_number == REWEIGHT_STEP or length <= REWEIGHT_PX
        if estimates == 0 or (estimates == 1 and settling):
            estimates += 1
            brightened = pixel_weights.fit_brightness(window, pose, profile, model.levels)
            model, pose = model.with_brightness(pose, brightened), brightened
            window = pixel_weights.estimate_visibility(window, pose, profile, model.levels)
        weights = pixel_weights.weights(window, pose, profile)
        residual = window.levels - model.levels
        by_brightness = model.levels[:, None] / GAIN_SCALE, torch.ones_like(residual)[:, None]
        jacobian = torch.cat((model.jacobian, *by_brightness), -1)
        normal = (jacobian.T @ (weights[:, None] * jacobian)).double()
        normal = normal + 1e-9 * normal.trace() * torch.eye(len(normal), dtype=normal.dtype)
        inverse = torch.linalg.inv(normal)
        step = inverse @ (jacobian.T @ (weights * residual)).double()
        length = float(step[:5].abs().max())
        if not length < ball.radius:
            break
        pose = forward_model.move_pose(pose, step[:5], ball.radius)
        change = 1 + float(step[5]) / GAIN_SCALE
        pose = replace(pose, gain=pose.gain * change, offset=pose.offset * change + float(step[6]))
        if length < TOLERANCE_PX and estimates == 2:
            break
    visible = (window.visibility > 0.5).to(residual)
    misfit = float((weights * visible * residual.square()).sum() / visible.sum().clamp_min(1))
    return Registration(pose, inverse[:5, :5], length < 5 * TOLERANCE_PX, misfit)


def pose_covariance(window: Window, pose: Pose, ball: TexturedBall, profile: ResidualProfile) -> Tensor:
    """`Registration.covariance` (5, 5) of an image whose pose is known."""
    model = forward_model.linearise(window, pose, ball, by_ball=False)
    jacobian = torch.cat((model.jacobian, model.levels[:, None], torch.ones_like(model.levels)[:, None]), -1)
    weights = pixel_weights.weights(window, pose, profile)
    return torch.linalg.inv((jacobian.T @ (weights[:, None] * jacobian)).double())[:5, :5]
