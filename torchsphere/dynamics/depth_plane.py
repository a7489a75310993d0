"""Positions under perspective, brought into the plane of the first frame's depth, where a px is one length.

An orthographic view has one scale everywhere. A camera near the ball shows a ball that comes closer at a larger scale,
and a distorting lens another one at every place: before px become m, the projected centres are put where a camera
without distortion would see them if the ball had kept its first distance.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.geometry.camera import Camera, undistorted, view_of
from torchsphere.tracking.track import Track

Array = NDArray[np.float64]

#: Step of the central differences that tell the local scale, px.
NUDGE_PX = 0.5


def in_plane(track: Track) -> Track:
    """The track with positions and steps as seen from the first distance by a lens without distortion.

    The uncertainty of the ball's size enters that of the steps, since it shifts a ball beside the optical axis.
    """
    if track.settings.get("camera") is None:
        return track
    camera = Camera(**track.settings["camera"])
    nearer = track.radius / track.circle.radius
    position = _levelled(track.position, nearer, camera)
    scale = _local_scale(track.position, nearer, camera)[1:]
    increment, covariance = track.increment.copy(), track.covariance.copy()
    measured = np.isfinite(increment[:, :1])
    increment[:, :2] = np.where(measured, np.diff(position, axis=0), np.nan)
    covariance[:, :2, :] = scale @ covariance[:, :2, :]
    covariance[:, :, :2] = covariance[:, :, :2] @ np.swapaxes(scale, 1, 2)
    beside = (position[1:] - np.asarray(camera.principal_px)) * np.nan_to_num(track.sd_growth)[:, None]
    covariance[:, :2, :2] += beside[:, :, None] * beside[:, None, :]
    return dataclasses.replace(track, position=position, increment=increment, covariance=covariance)


def _levelled(position: Array, nearer: Array, camera: Camera) -> Array:
    """Projected centres (n, 2), px, without distortion and without the change of scale ``nearer`` (n,)."""
    view = view_of(camera, torch.from_numpy(position), torch.zeros(1, dtype=torch.float64))
    focal = view.focal[:, None]
    rays = undistorted(view.centre / focal, view.distortion)
    return np.asarray(camera.principal_px) + (focal * rays).numpy() / nearer[:, None]


def _local_scale(position: Array, nearer: Array, camera: Camera) -> Array:
    """Derivative (n, 2, 2) of `_levelled` with respect to the position."""
    columns = []
    for axis in np.eye(2):
        ahead, behind = (_levelled(position + way * axis, nearer, camera) for way in (NUDGE_PX, -NUDGE_PX))
        columns.append((ahead - behind) / (2 * NUDGE_PX))
    return np.stack(columns, -1)
