"""Positions under perspective, moved into the plane at the ball's depth in the first frame, where a px is one length.

An orthographic view has one scale everywhere. A nearby camera shows an approaching ball at a growing scale, and a
distorting lens has another scale at every place, also one that the images showed. Before px become m, each projected
centre is therefore moved to where a camera without distortion would see the ball at its first depth.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from torchsphere.geometry.camera import Camera, undistorted, view_of
from torchsphere.motion.track import Track
from torchsphere.runtime.arrays import Array
from torchsphere.sphere_map.decision import MadeMap, NoMap

#: Half the distance of the points of the central differences that give the local scale, px (docs/constants.toml).
DIFFERENCE_PX = 0.5


def in_depth_plane(track: Track) -> Track:
    """The track with positions and steps in the plane of the first depth; unchanged without a camera or a lens.

    The uncertainty of the ball's size enters the steps' covariance, because it moves a ball beside the optical axis.
    """
    view = PlaneView.of(track.settings, track.findings.map)
    if view is None:
        return track
    magnification = track.radius / track.circle.radius
    position = view.position(track.position, magnification)
    scale = _local_scale(track.position, magnification, view)[1:]
    increment, covariance = track.increment.copy(), track.covariance.copy()
    measured = np.isfinite(increment[:, :1])
    increment[:, :2] = np.where(measured, np.diff(position, axis=0), np.nan)
    covariance[:, :2, :] = scale @ covariance[:, :2, :]
    covariance[:, :, :2] = covariance[:, :, :2] @ np.swapaxes(scale, 1, 2)
    if view.camera is not None:
        size_error = (position[1:] - np.asarray(view.camera.principal_px)) * np.nan_to_num(track.sd_growth)[:, None]
        covariance[:, :2, :2] += size_error[:, :, None] * size_error[:, None, :]
    return dataclasses.replace(track, position=position, increment=increment, covariance=covariance)


@dataclass(frozen=True)
class PlaneView:
    """The camera that was given, or assumed, and the lens that the images showed; one of both may be missing."""

    camera: Camera | None
    lens: MadeMap | None

    @classmethod
    def of(cls, settings: Mapping[str, Any], made: MadeMap | NoMap) -> PlaneView | None:
        """From the settings of a track and its map; None for an orthographic view."""
        camera = Camera.of_settings(settings)
        lens = made if isinstance(made, MadeMap) and made.has_lens else None
        if camera is None and lens is None:
            return None
        return cls(camera, lens)

    def position(self, position: Array, magnification: Array) -> Array:
        """Projected centres (n, 2), px, without distortion and at the first ``magnification`` (n,)."""
        straight = position if self.lens is None else _straightened(position, self.lens)
        if self.camera is None:
            return straight
        view = view_of(self.camera, torch.from_numpy(straight), torch.zeros(1, dtype=torch.float64))
        focal = view.focal[:, None]
        rays = undistorted(view.centre / focal, view.distortion)
        return np.asarray(self.camera.principal_px) + (focal * rays).numpy() / magnification[:, None]


def _straightened(position: Array, lens: MadeMap) -> Array:
    """Places (n, 2), px, without the distortion of a ``lens`` that the images showed, on square pixels."""
    middle = np.asarray(lens.lens_middle_px)
    # In units of the distance from the middle to the corner.
    corner = float(np.linalg.norm(middle))
    square = (position - middle) * lens.pixel_ratio ** np.array([0.5, -0.5]) / corner
    coefficients = torch.tensor([lens.lens_distortion, 0.0, 0.0], dtype=torch.float64)
    return np.asarray(middle + corner * undistorted(torch.from_numpy(square), coefficients).numpy())


def _local_scale(position: Array, magnification: Array, view: PlaneView) -> Array:
    """Derivative (n, 2, 2) of `PlaneView.position` with respect to the position."""
    columns = []
    for axis in np.eye(2):
        right, left = (view.position(position + sign * axis, magnification) for sign in (DIFFERENCE_PX, -DIFFERENCE_PX))
        columns.append((right - left) / (2 * DIFFERENCE_PX))
    return np.stack(columns, -1)
