"""Kornia's ``ImageRegistrator``: gradient descent on the difference of two images, a similarity between them."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F  # noqa: N812  (torch's own custom)
from kornia.geometry.conversions import denormalize_homography
from kornia.geometry.transform import ImageRegistrator

from torchsphere.benchmark.baselines.baseline import Baseline, Progress
from torchsphere.benchmark.baselines.ecc import rotation_angle
from torchsphere.benchmark.baselines.stepwise import NO_ROTATION, NOWHERE, Array, Pair, follow, opened, result

#: A ball's size does not change under parallel projection: a scale farther from 1 is a descent gone astray.
MAX_SCALE_ERROR = 0.1


def kornia_registrator(
    images: Any,
    circle: Any,
    *,
    roi: float = 0.95,
    levels: int = 2,
    rate: float = 5e-3,
    iterations: int = 60,
    tolerance: float = 1e-6,
    progress: Progress | None = None,
) -> Baseline:
    """Follow the ball by the similarity that leaves the least squared difference; measures dx, dy and wz.

    The settings are the best of those measured (6 pairs each on a ball of 50 px, with and without rotation):

    - mean squared difference: without rotation a bias of 0.009 px and a standard deviation of 0.016 (dy); Kornia's
      default, the absolute difference, as much, with more bias in a rotation.
    - Kornia's own rate, iterations and tolerance (1e-3, 100, 1e-4) stop before the rotation is there: wz is 89 % too
      low at 0.2 deg. ``tolerance`` 1e-5 halves the time and triples the scatter of dx; 200 iterations at 2e-3
      give 0.009 and 0.018 px for five times the time.
    - ``roi`` 0.95, half the side of the square crop: 0.65, the square inside the ball, has the larger bias in a
      rotation (0.36 against 0.27 px at 0.5 deg).
    - ``levels`` 2: what is left to find is half a px, and a few px in the first pair.

    Parameters
    ----------
    images, circle, progress
        As in `Tracker`.
    roi : float
        Half the side of the crops as a fraction of the ball's radius.
    levels : int
        Levels of the pyramid of images.
    rate : float
        Learning rate of Adam, in half sides of the crop and in degrees.
    iterations : int
        Most steps per level.
    tolerance : float
        Change of the loss at which a level ends; grey levels go from 0 to 1.
    """
    source, first = opened(images, circle)
    began = time.perf_counter()
    settings: dict[str, Any] = {
        "pyramid_levels": levels,
        "lr": rate,
        "num_iterations": iterations,
        "tolerance": tolerance,
    }
    registrator: Any = ImageRegistrator("similarity", loss_fn=F.mse_loss, **settings)

    def measure(pair: Pair) -> tuple[Array, Array, str]:
        f, g = (torch.from_numpy(image)[None, None] for image in (pair.f, pair.g))
        low, high = f.min(), f.max()
        if not high > low:
            return NOWHERE, NO_ROTATION, "lost"
        with torch.enable_grad():
            found = registrator.register((f - low) / (high - low), (g - low) / (high - low)).detach()
        back = denormalize_homography(found, pair.f.shape, pair.f.shape, align_corners=False)[0].double().numpy()
        if not abs(math.sqrt(abs(np.linalg.det(back[:2, :2]))) - 1) < MAX_SCALE_ERROR:
            return NOWHERE, NO_ROTATION, "not_converged"
        forth = np.linalg.inv(back)
        centre = forth[:2, :2] @ pair.centre_f + forth[:2, 2]
        return centre, np.array([np.nan, np.nan, rotation_angle(forth)]), "ok"

    measured = follow(source, first, measure, half=math.ceil(roi * first.radius), progress=progress)
    return result(began, measured, "kornia ImageRegistrator", first, model="similarity", roi=roi, **settings)
