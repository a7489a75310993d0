"""Estimate how much the optics and the exposure blur the images, by the outlines of the ball."""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.detection import blurred_limb
from torchsphere.geometry.camera import Camera
from torchsphere.geometry.circle import Circle
from torchsphere.recording.frame_source import Source
from torchsphere.sphere_map.exposure import Blur
from torchsphere.sphere_map.exposure_share import OUTLINES_SD

#: Most frames whose outlines are fitted together (docs/constants.toml).
FRAMES = 6

#: Largest change of the motion of such a frame, as a share of the motion (docs/constants.toml).
MOST_BEND = 0.2

#: Share by the outlines over the stated one below which the stated one is wrong (docs/constants.toml).
CONTRADICTED = 0.5

#: Room that the fit of a blurred outline needs around the ball, px (docs/constants.toml).
ROOM_PX = 6.0

#: Variance of the blur by the width of a pixel, px^2.
PIXEL_VARIANCE = 1 / 12


def estimate_blur(
    source: Source,
    position: NDArray[np.float64],
    circle: Circle,
    ignore: Tensor | None = None,
    camera: Camera | None = None,
    stated: float | None = None,
) -> Blur:
    """Blur by the outlines; 0 where they are sharp, and no exposure where none is smeared by `blurred_limb.SMEARED_PX`.

    ``position`` (n, 2) of the ball in all frames, px, NaN where it is not known. The share of the exposure that a file
    has ``stated`` is known where the outlines show it, and is where the map starts if they cannot. They may contradict
    it: under flashes the light is shorter than the exposure.
    """
    frames, motion = _in_view(position, circle.radius, source.images(0, 1).shape[1:])
    longest = float(np.linalg.norm(motion, axis=1).max(initial=0.0))
    may_be_smeared = longest >= blurred_limb.LEAST_MOTION_PX
    if stated is not None and stated * longest < blurred_limb.SMEARED_PX:
        may_be_smeared = False
    found = None
    if len(frames):
        images = source.images_of(frames)
        guess = torch.from_numpy(np.column_stack((position[frames], np.full(len(frames), circle.radius))))
        moves = torch.from_numpy(motion) if may_be_smeared else None
        found = blurred_limb.fit_as_needed(
            images, guess, motion=moves, ignore=ignore, camera=camera, is_elliptic=may_be_smeared
        )
    seen = found[2] if found else blurred_limb.LimbBlur(0.0, 0.0, 0.0)
    is_blurred = seen.variance >= blurred_limb.BLURRED_PX**2
    outline_px = math.sqrt(max(seen.variance - PIXEL_VARIANCE, 0.0))
    optics_px = outline_px if is_blurred else 0.0
    share = seen.exposure if seen.smear_px >= blurred_limb.SMEARED_PX else 0.0
    if stated is None:
        return Blur(optics_px, share, outline_px=outline_px)
    # A smear that is near the least that outlines show may be missed: the map tells it, from the stated share.
    would_show = math.exp(-OUTLINES_SD) * stated * longest >= blurred_limb.SMEARED_PX
    is_seen = share > CONTRADICTED * stated
    share = share if would_show and not is_seen else stated
    return Blur(optics_px, share, is_share_known=is_seen, outline_px=outline_px)


def _in_view(
    position: NDArray[np.float64], radius: float, shape: tuple[int, ...]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Numbers (k,) of up to `FRAMES` frames that show the whole ball, and its motion (k, 2) there, px.

    Frames of a ball that moves count first, as they show the smear of the exposure.
    """
    motion = np.full_like(position, np.nan)
    motion[1:-1] = 0.5 * (position[2:] - position[:-2])
    room = radius + ROOM_PX
    inside = ((position > room) & (position < np.array(shape[::-1]) - 1 - room)).all(1)
    # At an impact the outline is smeared along two ways.
    bend = np.full(len(position), np.inf)
    bend[1:-1] = np.linalg.norm(position[2:] - 2 * position[1:-1] + position[:-2], axis=1)
    speed = np.linalg.norm(motion, axis=1)
    moving = inside & (speed >= blurred_limb.LEAST_MOTION_PX) & (bend < MOST_BEND * speed)
    chosen = np.flatnonzero(moving if moving.any() else inside & (speed < blurred_limb.LEAST_MOTION_PX))
    chosen = chosen[np.unique(np.linspace(0, len(chosen) - 1, min(len(chosen), FRAMES)).astype(np.int64))]
    return chosen, motion[chosen]
