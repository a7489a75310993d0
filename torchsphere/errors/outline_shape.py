"""Outlines that are ellipses of fixed axes along the image's: pixels that are not square, which no file states.

A near camera stretches outlines away from the middle of the image, a motion during the exposure along the path. What
these may do is subtracted. A body that is no sphere shows other axes as it turns, and outlines that a background or a
codec spoils differ from frame to frame.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.detection import limb_ellipse
from torchsphere.detection.blurred_limb import SMEARED_PX
from torchsphere.errors.evidence import Evidence
from torchsphere.geometry.camera import Camera
from torchsphere.motion.findings import Findings
from torchsphere.motion.track import Track
from torchsphere.recording.frame_range import spread
from torchsphere.recording.frame_source import Source
from torchsphere.runtime.arrays import Array
from torchsphere.runtime.warning_levels import severe
from torchsphere.sphere_map.decision import MadeMap, NoMap

#: Outlines that are fitted, the fewest that show fixed axes, and the share of them that have to agree.
MOST_LOOKS, FEWEST_LOOKS, AGREEING = 6, 4, 0.8

#: Least coefficient of an ellipse that is said: its axes differ by twice as much (docs/constants.toml).
LEAST = 0.0125

#: Standard deviations of an outline within which outlines agree, and from which they are no circles; and share of the
#: coefficient within which they agree, too.
AGREEING_SD, SIGNIFICANT_SD, AGREEING_SHARE = 3.0, 4.0, 0.25

#: Coefficient by a smear along the path, over the smear in radii (docs/constants.toml).
BY_SMEAR = 0.25

#: Nearness of a camera of which nothing is known, radius over distance: five radii away.
NEAREST = 0.2

#: Room that a fit needs around the ball, radii.
ROOM = 1.3


@dataclass(frozen=True)
class Allowed:
    """What may stretch an outline, at most."""

    nearness: float  # radius over the camera's distance
    open_share: float  # exposure over the time between frames
    smear_px: float  # motion during the exposure

    @classmethod
    def of(
        cls,
        camera: Camera | None,
        radius: float,
        made: MadeMap | NoMap,
        sd_nearness: float,
        stated: float | None,
    ) -> Allowed:
        """By the camera or else what the map found; by the exposure that was ``stated``, or else that of the map."""
        known = made if isinstance(made, MadeMap) else MadeMap()
        if camera is not None and camera.focal_px is not None:
            nearness = radius / camera.focal_px
        else:
            nearness = known.radius_over_distance + 2 * sd_nearness
            nearness = nearness if known is made or sd_nearness == 0 else max(nearness, NEAREST)
        share = stated if stated is not None else known.open_share or 1.0
        # The map would have found more.
        return cls(nearness, share, SMEARED_PX if known is made and not known.open_share else math.inf)


def axis_ratio(source: Source, position: Array, radius: float, ignore: Tensor | None, allowed: Allowed) -> float | None:
    """Width over height of the outlines where they are ellipses of fixed axes; None where they may be circles.

    ``position`` (n, 2) is the ball's centre in each image, px, NaN where unknown.
    """
    size = np.array(source.images(0, 1).shape[-2:][::-1])
    frames = _whole_balls(position, radius, size)
    if len(frames) < FEWEST_LOOKS:
        return None
    images = source.images_of(frames)
    circles = torch.from_numpy(np.column_stack((position[frames], np.full(len(frames), radius))))
    found, sd = (values[:, 0].numpy() for values in limb_ellipse.fit(images, circles, ignore))
    known = np.isfinite(found)
    if known.sum() < FEWEST_LOOKS:
        return None
    found, sd, frames = found[known], sd[known], frames[known]
    shape, typical = float(np.median(found)), float(np.median(sd))
    agree = np.abs(found - shape) <= np.maximum(AGREEING_SD * sd, AGREEING_SHARE * abs(shape))
    sign = np.sign(shape)
    off = (position[frames] - 0.5 * (size - 1)) / radius
    by_view = _by_view(sign * found, sign * (off[:, 0] ** 2 - off[:, 1] ** 2), typical, allowed.nearness)
    smear = float(np.median(sign * _step_along(source, position, frames))) * allowed.open_share
    by_smear = BY_SMEAR / radius * min(max(smear, 0.0), allowed.smear_px)
    if agree.mean() < AGREEING or abs(shape) - by_view - by_smear < max(LEAST, SIGNIFICANT_SD * typical):
        return None
    return (1 + shape) / (1 - shape)


def _whole_balls(position: Array, radius: float, size: NDArray[np.int64]) -> NDArray[np.int64]:
    """Numbers (m,) of up to `MOST_LOOKS` frames that show the whole ball in images of that ``size`` (w, h)."""
    frames = np.flatnonzero(((position > ROOM * radius) & (position < size - 1 - ROOM * radius)).all(1))
    return spread(frames, MOST_LOOKS)


def _step_along(source: Source, position: Array, frames: NDArray[np.int64]) -> Array:
    """Steps (m,) around the ``frames`` along the image's axes: positive along x, negative along y, px per interval."""
    x, y = source.steps_around(position, frames).T
    along: Array = (x**2 - y**2) / np.maximum(np.hypot(x, y), 1e-9)
    return along


def _by_view(found: Array, off: Array, sd: float, nearness: float) -> float:
    """What a near camera may give of the coefficients ``found`` (m,), which are positive.

    An outline at an angle b from the optical axis is longer by 1 / cos b along the way from the middle of the image:
    the coefficient is a quarter of the square of the ``nearness`` times what is ``off`` (m,), squared radii. How the
    coefficients change along the path tells the nearness, too.
    """
    about = off - off.mean()
    square = float(about @ about)
    slope = float(about @ found) / square if square > 0 else 0.0
    most = max(slope + 2 * sd / np.sqrt(square), 0.0) if square > 0 else np.inf
    return float(min(0.25 * nearness**2, most) * max(off.mean(), 0.0))


def detect(track: Track, evidence: Evidence) -> Findings:
    """The axes of outlines that are ellipses."""
    found, radius = track.findings, track.circle.radius
    if isinstance(found.map, MadeMap) and found.map.has_lens:
        # The map holds what the outlines show.
        return found
    near = found.sd_radius_over_distance
    allowed = Allowed.of(evidence.options.camera, radius, found.map, near, stated=evidence.exposure)
    ratio = axis_ratio(evidence.source, track.position, radius, evidence.ignore, allowed)
    return dataclasses.replace(found, axis_ratio=ratio)


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """Outlines of fixed axes, which pixels that are not square give."""
    wide = track.findings.axis_ratio
    if wide is None:
        return []
    # The outline of wide pixels is narrow.
    percent, aspect = 100 * (max(wide, 1 / wide) - 1), 1 / wide
    longer = "wider than high" if wide > 1 else "higher than wide"
    return [
        severe(
            f"The outline of the ball is no circle: it is {percent:.1f} % {longer} all along its path, as pixels of "
            f"about {aspect:.3g}:1 (width to height) show a sphere. Positions, speeds and rotations are wrong by as "
            "much. If the pixels are not square, give `pixel_aspect` with the ratio that camera or software state "
            f"(about {aspect:.3g}); else the ball is no sphere."
        )
    ]
