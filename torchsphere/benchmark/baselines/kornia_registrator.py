"""Kornia's ``ImageRegistrator``: gradient descent on the difference of two images, a similarity between them."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812  (the usual name in torch code)
from kornia.geometry.conversions import denormalize_homography
from kornia.geometry.transform import ImageRegistrator

from torchsphere.benchmark.baselines.baseline import Baseline, Progress
from torchsphere.benchmark.baselines.ecc import rotation_angle
from torchsphere.benchmark.baselines.frame_loop import Pair, failure, follow, opened, result
from torchsphere.runtime.arrays import Array

#: Half the side of the crops as a share of the ball's radius (docs/constants.toml).
ROI = 0.95

#: Levels of the image pyramid (docs/constants.toml).
LEVELS = 2

#: Learning rate of Adam, in half sides of the crop and in degrees (docs/constants.toml).
RATE = 5e-3

#: Largest number of steps per level, and the change of the loss at which a level ends (docs/constants.toml).
ITERATIONS, TOLERANCE = 60, 1e-6

#: Largest deviation of a valid scale from 1; the ball's size is constant under parallel projection
#: (docs/constants.toml).
MAX_SCALE_ERROR = 0.1


def kornia_registrator(images: Any, circle: Any, *, progress: Progress | None = None) -> Baseline:
    """Follow the ball by the similarity that leaves the least squared difference; measures dx, dy and wz."""
    source, first = opened(images, circle)
    began = time.perf_counter()
    settings: dict[str, Any] = {
        "pyramid_levels": LEVELS,
        "lr": RATE,
        "num_iterations": ITERATIONS,
        "tolerance": TOLERANCE,
    }
    registrator: Any = ImageRegistrator("similarity", loss_fn=F.mse_loss, **settings)

    def measure(pair: Pair) -> tuple[Array, Array, str]:
        f, g = (torch.from_numpy(image)[None, None] for image in (pair.f, pair.g))
        low, high = f.min(), f.max()
        if not high > low:
            return failure("lost")
        with torch.enable_grad():
            found = registrator.register((f - low) / (high - low), (g - low) / (high - low)).detach()
        backward = denormalize_homography(found, pair.f.shape, pair.f.shape, align_corners=False)[0].double().numpy()
        if not abs(math.sqrt(abs(np.linalg.det(backward[:2, :2]))) - 1) < MAX_SCALE_ERROR:
            return failure("not_converged")
        forward = np.linalg.inv(backward)
        centre = forward[:2, :2] @ pair.centre_f + forward[:2, 2]
        return centre, np.array([np.nan, np.nan, rotation_angle(forward)]), "ok"

    measured = follow(source, first, measure, half=math.ceil(ROI * first.radius), progress=progress)
    return result(began, measured, "kornia ImageRegistrator", first, model="similarity", roi=ROI, **settings)
