"""Poses that rest on the steps from frame to frame, whose errors add up, as no map of the ball holds them."""

from __future__ import annotations

import numpy as np

from torchsphere.errors.evidence import Evidence
from torchsphere.motion.track import Track
from torchsphere.sphere_map.decision import NoMap

#: Least median turn of a ball that turns in place, deg per frame (docs/constants.toml).
MIN_TURN_DEG = 1.0


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
    """Whether the ball turns fast and moves by less than two radii and a third of the way that its surface turns."""
    turn = np.linalg.norm(track.increment[:, 2:], axis=1)
    known = track.position[np.isfinite(track.position[:, 0])]
    reach = float(np.ptp(known, axis=0).max()) if len(known) else np.inf
    surface = np.nansum(turn) * track.circle.radius
    is_fast = bool(np.isfinite(turn).any()) and float(np.nanmedian(turn)) > np.radians(MIN_TURN_DEG)
    return is_fast and reach < 2 * track.circle.radius and surface > 3 * reach
