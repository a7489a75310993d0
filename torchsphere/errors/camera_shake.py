"""Shake of the camera, measured on the still background: a hit that moves the camera seems to move the ball as well.

Square subsets of the images outside the ball are compared with those of the first image, each by one Gauss-Newton step
with gain and offset free. The median of their displacements is the shake: a target or a hand in a part of the image
does not change the median.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.errors.evidence import Evidence
from torchsphere.imaging import interpolation
from torchsphere.motion.findings import CameraShake, Findings
from torchsphere.motion.track import Track
from torchsphere.recording.frame_range import spread
from torchsphere.recording.frame_source import Source
from torchsphere.runtime.arrays import Array
from torchsphere.runtime.warning_levels import severe

#: Side of a subset, px; the most subsets that are compared, and the fewest that show a shake (docs/constants.toml).
SUBSET_PX, MAX_SUBSETS, MIN_SUBSETS = 32, 32, 6

#: Most images that are compared with the first image (docs/constants.toml).
IMAGES = 12

#: Least distance of a subset from the ball's outline, px (docs/constants.toml).
CLEARANCE_PX = 6.0

#: Blur of the subsets, px, and width of the border that lacks neighbours for the blur, px (docs/constants.toml).
BLUR_PX, BLUR_BORDER = 1.0, 4

#: Standard deviation of a displacement from which the subset's texture is too weak, px (docs/constants.toml).
MAX_SD_PX = 0.05

#: Least shake that is reported, px (docs/constants.toml).
MIN_SHAKE_PX = 0.1

#: Least ratio of the median to its standard deviation, and to the spread of the subsets (docs/constants.toml).
MIN_OVER_MEDIAN_SD, MIN_OVER_SPREAD = 6.0, 2.0


def camera_shake(source: Source, track: Track) -> CameraShake | None:
    """The largest displacement of the background since the first tracked image; None if it stands still."""
    known = np.flatnonzero(np.isfinite(track.position[:, 0]))
    if len(known) < 2:
        return None
    first, compared = int(known[0]), spread(known[1:], IMAGES)

    def image(frame: int) -> Array:
        return source.images(frame, frame + 1)[0].double().cpu().numpy()

    reference = image(first)
    corners = _corners(reference.shape, track, np.append(first, compared))
    if len(corners) < MIN_SUBSETS:
        return None
    subsets = _blurred_subsets(reference, corners)
    shakes = [
        CameraShake(
            _common_displacement(_displacements(subsets, _blurred_subsets(image(int(frame)), corners))), int(frame)
        )
        for frame in compared
    ]
    largest = max(shakes, key=lambda shake: (shake.px, shake.frame))
    return largest if largest.px >= MIN_SHAKE_PX else None


def _corners(shape: tuple[int, ...], track: Track, frames: NDArray[np.int64]) -> NDArray[np.int64]:
    """First row and column (s, 2) of subsets that are clear of the ball in all ``frames``, evenly spread."""
    rows, columns = (np.arange(0, size - SUBSET_PX + 1, SUBSET_PX) for size in shape)
    corners = np.stack(np.meshgrid(rows, columns, indexing="ij"), -1).reshape(-1, 2)
    # The point of each subset nearest to the ball's centre, as (x, y).
    centres = track.position[frames][:, None]
    low = corners[None, :, ::-1]
    distance = np.clip(centres, low, low + SUBSET_PX - 1) - centres
    is_clear = (np.hypot(distance[..., 0], distance[..., 1]) > track.circle.radius + CLEARANCE_PX).all(0)
    return spread(corners[is_clear], MAX_SUBSETS)


def _blurred_subsets(image: Array, corners: NDArray[np.int64]) -> Array:
    """Blurred subsets (s, m, m) of an image, without their borders."""
    offsets = np.arange(SUBSET_PX)
    subsets = image[corners[:, :1, None] + offsets[:, None], corners[:, 1:, None] + offsets]
    inner = slice(BLUR_BORDER, -BLUR_BORDER)
    return interpolation.blur(torch.from_numpy(subsets), BLUR_PX).numpy()[:, inner, inner]


def _displacements(reference: Array, subsets: Array) -> Array:
    """Displacements (k, 2) as (x, y), px, of subsets (s, m, m) from the reference's; weak textures are left out."""
    down, right = np.gradient(reference, axis=(1, 2))
    jacobian = np.stack((right, down, reference, np.ones_like(reference)), -1).reshape(len(reference), -1, 4)
    normal = jacobian.swapaxes(1, 2) @ jacobian
    size = np.sqrt(np.diagonal(normal, axis1=1, axis2=2)).clip(1e-9)
    scaled = normal / size[:, :, None] / size[:, None] + 1e-9 * np.eye(4)
    inverse = np.linalg.inv(scaled) / size[:, :, None] / size[:, None]
    change = (subsets - reference).reshape(len(reference), -1)
    solution = inverse @ (jacobian.swapaxes(1, 2) @ change[..., None])
    residual = change - (jacobian @ solution)[..., 0]
    sd = np.sqrt(np.diagonal(inverse, axis1=1, axis2=2)[:, :2] * residual.var(1)[:, None])
    return np.asarray(-solution[(sd < MAX_SD_PX).all(1), :2, 0])


def _common_displacement(displacements: Array) -> float:
    """Length of the subsets' common displacement, px; 0 if they (k, 2) do not move together or are too few."""
    if len(displacements) < MIN_SUBSETS:
        return 0.0
    median = np.median(displacements, axis=0)
    scatter = 1.4826 * float(np.median(np.hypot(*(displacements - median).T)))
    size = float(np.hypot(*median))
    is_significant = size > MIN_OVER_MEDIAN_SD * scatter / np.sqrt(len(displacements))
    return size if is_significant and size > MIN_OVER_SPREAD * scatter else 0.0


def detect(track: Track, evidence: Evidence) -> Findings:
    """By how much the background moves, and in which frame most."""
    return dataclasses.replace(track.findings, shake=camera_shake(evidence.source, track))


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """Whether the camera was shaken."""
    shake = track.findings.shake
    if shake is None:
        return []
    size = f"{shake.px:.1f} px" if shake.px < 1 else "a px or more"
    return [
        severe(
            f"The background has moved by {size} in frame {track.first_frame + shake.frame}: the camera was shaken or "
            "moved, or a target that fills the image. Positions, velocities and forces are those in the image, with "
            "that motion in them; mount the camera apart from the target, or take the frames before it moves with "
            "`frames`."
        )
    ]
