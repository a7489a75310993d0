"""The ball's brightness over its place in the image: darker towards the corners, as by vignetting."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchsphere.sphere_map.ball import Poses

#: Fall of brightness that is no chance: in its standard deviations, and at least (docs/constants.toml).
SEEN_SD, LEAST_SEEN = 5.0, 0.12

#: Fewest images that tell a fall from brightness that changes at will.
MIN_IMAGES = 6


def falloff(poses: Poses, level: float, middle: Tensor) -> float:
    """Share by which a ball of that mean ``level`` would be darker in the image's corner; 0 where none is seen.

    The brightness of n images by their ``poses`` falls with the square of the distance from the ``middle`` (2,), px.
    Its scatter about this says what is chance: a lamp that flickers does not know where the ball is.
    """
    if len(poses) < MIN_IMAGES:
        return 0.0
    brightness = poses.gain + poses.offset / level
    distance = (poses.centre - middle).square().sum(1) / middle.square().sum()
    columns = torch.stack((torch.ones_like(distance), distance), 1)
    inverse = torch.linalg.pinv(columns.mT @ columns)
    even, slope = (inverse @ columns.mT @ brightness).tolist()
    variance = (brightness - even - slope * distance).square().sum() / (len(poses) - 2)
    sd = math.sqrt(float(variance * inverse[1, 1]))
    return -slope / even if -slope > max(SEEN_SD * sd, LEAST_SEEN * even) else 0.0
