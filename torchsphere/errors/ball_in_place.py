"""A ball that turns in its place: a motion too slow for its outlines to show, and steps that lead away from it."""

from __future__ import annotations

import dataclasses

import numpy as np

from torchsphere.detection.limbs import SIGNIFICANT_SD, STAY_SD
from torchsphere.errors.evidence import Evidence
from torchsphere.motion.findings import Place
from torchsphere.motion.track import Track
from torchsphere.runtime.warning_levels import note, severe

#: Least sum of the steps of a ball in its place that a warning reports, px (docs/constants.toml).
MIN_DRIFT_PX = 0.5


def widen(track: Track, evidence: Evidence) -> Track:
    """A motion that the limbs do not show is an error that all steps share."""
    return dataclasses.replace(track, sd_steady=np.hypot(track.sd_steady, [*evidence.unseen_step_px, 0, 0, 0]))


def sentences(track: Track, evidence: Evidence) -> list[str]:
    """What was done to a ball in its place, and what speaks against that."""
    place = track.findings.place
    return [] if place is None else [*_of_limbs(place), *_of_steps(track, place)]


def _of_limbs(place: Place) -> list[str]:
    """What the outlines of a ball in its place show."""
    found, limbs, radius, shown = [], place.limbs, place.first_radius_px, place.limbs_radius_px
    if place.recognised:
        within = STAY_SD * max(place.limbs_sd_px[:2])
        found.append(
            note(
                f"The ball turns without leaving its place: its outline stays within {within:.2f} px in {limbs} "
                "frames, and the steps that lead away from it are errors. All frames have one position; `in_place` "
                "says so beforehand."
            )
        )
    elif limbs is not None and not place.limbs_stay:
        found.append(
            severe(
                "The ball was said to stay in its place, but its outline moves: the positions and rotations are wrong "
                "if it does; leave `in_place` out."
            )
        )
    if place.limbs_radius_used:
        found.append(
            note(
                f"The outlines of {limbs} frames show a radius of {shown:.2f} px in place of the first {radius:.2f} "
                "px, and were used."
            )
        )
    return found


def _of_steps(track: Track, place: Place) -> list[str]:
    """Whether the steps lead away from the place by more than their errors."""
    drift, steps = np.array(place.steps_sum_px), np.isfinite(track.increment[:, 0])
    variances = np.diagonal(track.covariance, axis1=1, axis2=2)[:, :2]
    own = np.nan_to_num(np.nanmean(variances, axis=0)) if steps.any() else 0
    sd = np.hypot(track.sd_steady[:2] * steps.sum(), np.sqrt(own))
    if not (np.abs(drift) > np.maximum(SIGNIFICANT_SD * sd, MIN_DRIFT_PX)).any():
        return []
    by_limbs = f"; the outlines show {place.limbs_radius_px:.2f} px" if place.limbs_stay else ""
    return [
        severe(
            f"The ball was held in its place against steps that add up to {np.hypot(*drift):.1f} px. Likely "
            f"causes: a wrong radius (here {track.circle.radius:.2f} px{by_limbs}), a camera so near that its "
            "perspective matters (give `focal_px` or `distance_mm`), or a ball that does leave its place. The "
            "rotations are wrong, too, by more than they state."
        )
    ]
