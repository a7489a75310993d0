"""A still ball for figures 2 and 3, rendered at sub-pixel positions and small angles, or moved by a model's field.

A ball of any radius in the middle of a small image, in the light of the preset ``example``, with speckle of 4 px. The
light of the renderer has no noise and no rounding, so that the error of a tracker is bias alone.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy import ndimage
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from experiments.experiment import Array
from render import preset
from render.frames import render_frames, render_radiance
from render.pose import Motion, Poses
from render.scene import Setup
from torchsphere.geometry import motion_models

Circle = tuple[float, float, float]

#: Shifts of 0 to 1 px, as many as in the paper.
SHIFTS_PX = np.arange(20) / 20
RADIUS_PX, SPECKLE_PX = 50.0, 4.0
#: Margin of the images around the ball, px.
MARGIN_PX = 14
#: Light paths per pixel; their noise changes a motion by less than 0.0005 px.
SAMPLES = 256


def ball(radius_px: float, seed: int, extra_width: int = 0) -> tuple[Setup, Circle]:
    """A still ball in the middle of a small image, and its circle."""
    side = 2 * (int(radius_px) + MARGIN_PX)
    changes = {
        "camera.width": side + extra_width,
        "camera.height": side,
        "camera.scale_px_per_mm": radius_px / 15.0,
        "pattern.speckle_mm": SPECKLE_PX * 15.0 / radius_px,
        "pattern.seed": seed,
        "sensor.seed": seed,
        "quality.samples": SAMPLES,
    }
    setup = preset.load("example", [f"{name}={value}" for name, value in changes.items()]).setup
    return setup, (*setup.camera.centre_px, radius_px)


def turned(shifts_px: Array, angles_deg: Array, px_per_m: float) -> Motion:
    """Poses at the times 0, 1, 2, ...: moved along x, turned about y."""
    rotation = Rotation.from_rotvec(np.radians(angles_deg)[:, None] * np.array((0.0, 1.0, 0.0))).as_matrix()
    position = shifts_px[:, None] / px_per_m * np.array((1.0, 0.0, 0.0))

    def at(times_s: Array) -> Poses:
        rows = np.rint(times_s).astype(int)
        return Poses(position[rows], rotation[rows])

    return at


def rendered(setup: Setup, shifts_px: Array, angles_deg: Array, what: str) -> Array:
    """Light (n, h, w) of the ball in n poses, in grey levels without noise and rounding."""
    poses = turned(shifts_px, angles_deg, setup.camera.px_per_m(1.0))
    frames = render_radiance(setup, poses, np.arange(len(shifts_px), dtype=np.float64))
    return np.stack(list(tqdm(frames, f"rendering {what}", len(shifts_px), leave=False)))


def still_image(setup: Setup) -> Array:
    """A noisy image (h, w) of the ball at rest."""
    return next(render_frames(setup, turned(np.zeros(1), np.zeros(1), 1.0), np.zeros(1))).astype(np.float64)


def advected(image: Array, circle: Circle, q: Array, model: str) -> Array:
    """The image (h, w) moved by the field of the model: ``g(x + u(x)) = f(x)``.

    The point ``x`` that comes to a pixel is found by iteration; its grey level is that of the cubic spline.
    """
    y, x = np.mgrid[: image.shape[0], : image.shape[1]].astype(np.float64)
    geometry = motion_models.Geometry(torch.tensor(circle[2], dtype=torch.float64))
    step, before = np.zeros((*image.shape, 2)), None
    for _ in range(8):  # within the region each iteration leaves at most a twentieth of the error
        if before is not None and np.array_equal(step, before):
            break
        before = step
        from_centre = np.stack((x - step[..., 0] - circle[0], y - step[..., 1] - circle[1]), -1)
        points = torch.from_numpy(from_centre.reshape(-1, 2))
        step = motion_models.MODELS[model](torch.from_numpy(q), points, geometry).numpy().reshape(step.shape)
    return np.asarray(ndimage.map_coordinates(image, (y - step[..., 1], x - step[..., 0]), order=3, mode="mirror"))
