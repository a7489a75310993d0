"""The share of the time between frames in which the shutter is open, from the smear of the ball's outline."""

from __future__ import annotations

from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.detection import blurred_limb
from torchsphere.geometry.camera import Camera
from torchsphere.geometry.circle import Circle
from torchsphere.recording.frame_source import Source

#: Most frames whose outlines are fitted together (docs/constants.md).
FRAMES = 6

#: Largest change of the motion of such a frame, as a share of the motion (docs/constants.md).
MOST_BEND = 0.2

#: Share by the outlines over the stated one below which the stated one is wrong (docs/constants.md).
CONTRADICTED = 0.5

#: Room that the fit of a blurred outline needs around the ball, px (docs/constants.md).
ROOM_PX = 12.0


def open_share(
    source: Source,
    position: NDArray[np.float64],
    circle: Circle,
    ignore: Tensor | None = None,
    camera: Camera | None = None,
    stated: float | None = None,
) -> float:
    """Exposure over the time between frames, 0 to 1; 0 where no outline is smeared by `blurred_limb.SMEARED_PX`.

    ``position`` (n, 2) of the ball in all frames, px, NaN where it is not known. The share that a file has ``stated``
    counts unless the outlines contradict it: under flashes the light is shorter than the exposure.
    """
    frames, motion = _moving(position, circle.radius, source.images(0, 1).shape[1:])
    longest = float(np.linalg.norm(motion, axis=1).max(initial=0.0))
    if stated is not None and stated * longest < blurred_limb.SMEARED_PX:
        return stated
    if not len(frames):
        return 0.0
    found = _by_outlines(source, frames, motion, position, circle.radius, ignore, camera)
    return stated if stated is not None and found > CONTRADICTED * stated else found


def _by_outlines(
    source: Source,
    frames: NDArray[np.int64],
    motion: NDArray[np.float64],
    position: NDArray[np.float64],
    radius: float,
    ignore: Tensor | None,
    camera: Camera | None,
) -> float:
    """The share by the outlines in these ``frames`` (k,), in ``motion`` (k, 2); 0 where they are sharp."""
    images = torch.cat([source.images(i, i + 1) for i in frames.tolist()])
    guess = torch.from_numpy(np.column_stack((position[frames], np.full(len(frames), radius))))
    fit = partial(blurred_limb.fit, images, motion=torch.from_numpy(motion), ignore=ignore, camera=camera)
    try:
        # A few rounds tell sharp images.
        near, _, blur = fit(guess, rounds=blurred_limb.TRIAL_ROUNDS)
        if blur.smear_px >= blurred_limb.SMEARED_PX:
            _, _, blur = fit(near)
    except torch.linalg.LinAlgError:  # type: ignore[attr-defined]
        return 0.0
    return blur.exposure if blur.smear_px >= blurred_limb.SMEARED_PX else 0.0


def _moving(
    position: NDArray[np.float64], radius: float, shape: tuple[int, ...]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Numbers (k,) of up to `FRAMES` frames that show the whole of a moving ball, and its motion (k, 2) there, px."""
    motion = np.full_like(position, np.nan)
    motion[1:-1] = 0.5 * (position[2:] - position[:-2])
    room = radius + ROOM_PX
    inside = ((position > room) & (position < np.array(shape[::-1]) - 1 - room)).all(1)
    # At an impact the outline is smeared along two ways.
    bend = np.full(len(position), np.inf)
    bend[1:-1] = np.linalg.norm(position[2:] - 2 * position[1:-1] + position[:-2], axis=1)
    speed = np.linalg.norm(motion, axis=1)
    chosen = np.flatnonzero(inside & (speed >= blurred_limb.LEAST_MOTION_PX) & (bend < MOST_BEND * speed))
    chosen = chosen[np.unique(np.linspace(0, len(chosen) - 1, min(len(chosen), FRAMES)).astype(np.int64))]
    return chosen, motion[chosen]
