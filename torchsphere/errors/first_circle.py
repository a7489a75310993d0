"""The circle at the start: whether the image shows the ball's outline there, and how well that is known."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import torch

from torchsphere.detection.ball_or_not import MAX_CIRCLE_ERROR, given_circle_warning, refined_circle_warning
from torchsphere.errors.evidence import Evidence
from torchsphere.motion.track import Track
from torchsphere.runtime.warning_levels import note, severe
from torchsphere.sphere_map.radius_error import RADIUS_ERROR_PER_TURN, turn_out_of_plane

#: Where a person sees the circle.
_IN_PREVIEW = "with 'torchsphere info INPUT --preview FILE.png'"


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """Whether the image shows the ball's outline at the circle."""
    found, circle = [], track.circle
    if track.findings.untried_frames:
        found.append(
            severe(
                f"Nothing confirms the circle at {circle.text(1)} px: the frames right after it hardly "
                f"show the same, so those after them were not tried ({track.findings.untried_frames} in all)."
            )
        )
    if math.isnan(circle.sd_radius):
        found.append(note("The circle was given without an uncertainty: no standard deviation includes its error."))
    is_unchecked = math.isnan(circle.sd_radius) or _is_given_to_a_ball_that_hardly_turns(track)
    if is_unchecked and track.settings["camera"] is None:
        doubt = given_circle_warning(evidence.image.float().cpu(), circle)
        found += [severe(doubt)] if doubt else []
    choice = dataclasses.replace(circle, frame=track.first_frame + circle.frame).choice(_IN_PREVIEW)
    found += [choice] if choice else []
    given = bool(track.settings["circle_given"])
    if track.settings["circle_refined"] and circle.doubt and (given or not track.findings.proves_ball):
        found.append(severe(refined_circle_warning(circle) if given else circle.warning(_IN_PREVIEW)))
    return found


def _is_given_to_a_ball_that_hardly_turns(track: Track) -> bool:
    """Whether the map leaves the radius of a given circle as it was, since the ball turns too little to tell it."""
    settings = track.settings
    if not settings["circle_given"] or settings["circle_refined"] or not track.findings.is_on_map:
        return False
    known = track.orientation[np.isfinite(track.orientation[:, 0, 0])]
    turn = turn_out_of_plane(torch.from_numpy(known))
    return turn * MAX_CIRCLE_ERROR * track.circle.radius < RADIUS_ERROR_PER_TURN
