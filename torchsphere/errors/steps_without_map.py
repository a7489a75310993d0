"""Poses that rest on the steps from frame to frame, whose errors add up, as no map of the ball holds them."""

from __future__ import annotations

import numpy as np

from torchsphere.errors.evidence import Evidence
from torchsphere.motion.track import Track
from torchsphere.runtime.arrays import Array
from torchsphere.sphere_map.decision import NoMap

#: Least median turn of a ball that turns in place, deg per frame (docs/constants.toml).
MIN_TURN_DEG = 1.0

#: Least way of the ball's surface over the extent of its path, for a ball that turns in place (docs/constants.toml).
MIN_SURFACE_WAY = 3.0


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """Whether poses without a map of the ball may drift."""
    known, found = track.findings, []
    if not known.is_on_map and not track.settings["in_place"] and _turns_in_place(track):
        found.append(
            "The ball turns fast and hardly moves; if it cannot leave its place, give `in_place` to avoid drift."
        )
    if isinstance(known.map, NoMap) and known.map.is_needed:
        found.append(f"Poses rest on the frame-to-frame steps, whose errors add up: {known.map.sentence}.")
    return found


def _turns_in_place(track: Track) -> bool:
    """Whether the ball turns fast, moves by less than two radii, and its surface by far more."""
    turn = np.linalg.norm(track.increment[:, 2:], axis=1)
    is_fast = bool(np.isfinite(turn).any()) and float(np.nanmedian(turn)) > np.radians(MIN_TURN_DEG)
    extent, is_surface = extent_beside_surface(track.position, track.increment, track.circle.radius)
    return is_fast and extent < 2 * track.circle.radius and is_surface


def extent_beside_surface(position: Array, increment: Array, radius: float) -> tuple[float, bool]:
    """Extent of the path ``position`` (n, 2), px, and whether the ball's surface moves so much further than the ball.

    Then the path may be an error. ``increment`` (n - 1, 5), px and rad.
    """
    known = position[np.isfinite(position[:, 0])]
    extent = float(np.ptp(known, axis=0).max()) if len(known) else np.inf
    way = radius * float(np.nansum(np.linalg.norm(increment[:, 2:], axis=1)))
    return extent, way > MIN_SURFACE_WAY * extent
