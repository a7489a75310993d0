"""Positions under perspective, moved into the plane at the ball's depth in the first frame, where a px is one length.

An orthographic view has one scale everywhere. A nearby camera shows an approaching ball at a growing scale, and a
distorting lens has another scale at every place. Before px become m, each projected centre is therefore moved to where
a camera without distortion would see the ball at its first depth.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.geometry.camera import Camera, undistorted, view_of
from torchsphere.motion.track import Track

Array = NDArray[np.float64]

#: Half the distance of the points of the central differences that give the local scale, px (docs/constants.toml).
DIFFERENCE_PX = 0.5


def in_depth_plane(track: Track) -> Track:
    """The track with positions and steps in the plane of the first depth; unchanged without a camera.

    The uncertainty of the ball's size enters the steps' covariance, because it moves a ball beside the optical axis.
    """
    if track.settings.get("camera") is None:
        return track
    camera = Camera(**track.settings["camera"])
    magnification = track.radius / track.circle.radius
    position = plane_position(track.position, magnification, camera)
    scale = _local_scale(track.position, magnification, camera)[1:]
    increment, covariance = track.increment.copy(), track.covariance.copy()
    measured = np.isfinite(increment[:, :1])
    increment[:, :2] = np.where(measured, np.diff(position, axis=0), np.nan)
    covariance[:, :2, :] = scale @ covariance[:, :2, :]
    covariance[:, :, :2] = covariance[:, :, :2] @ np.swapaxes(scale, 1, 2)
    size_error = (position[1:] - np.asarray(camera.principal_px)) * np.nan_to_num(track.sd_growth)[:, None]
    covariance[:, :2, :2] += size_error[:, :, None] * size_error[:, None, :]
    return dataclasses.replace(track, position=position, increment=increment, covariance=covariance)


def plane_position(position: Array, magnification: Array, camera: Camera) -> Array:
    """Projected centres (n, 2), px, without distortion and at the first ``magnification`` (n,)."""
    view = view_of(camera, torch.from_numpy(position), torch.zeros(1, dtype=torch.float64))
    focal = view.focal[:, None]
    rays = undistorted(view.centre / focal, view.distortion)
    return np.asarray(camera.principal_px) + (focal * rays).numpy() / magnification[:, None]


def _local_scale(position: Array, magnification: Array, camera: Camera) -> Array:
    """Derivative (n, 2, 2) of `plane_position` with respect to the position."""
    columns = []
    for axis in np.eye(2):
        right, left = (
            plane_position(position + sign * axis, magnification, camera) for sign in (DIFFERENCE_PX, -DIFFERENCE_PX)
        )
        columns.append((right - left) / (2 * DIFFERENCE_PX))
    return np.stack(columns, -1)
