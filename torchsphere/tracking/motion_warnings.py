"""Warnings on a track, in sentences that a reader of its numbers must know."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import torch

from torchsphere.detection.ball_or_not import MAX_CIRCLE_ERROR, given_circle_warning, refined_circle_warning
from torchsphere.recording.frame_source import Source
from torchsphere.runtime.warning_levels import by_level, note, severe
from torchsphere.sphere_map.decision import MadeMap, NoMap
from torchsphere.sphere_map.radius_error import RADIUS_ERROR_PER_TURN, turn_out_of_plane
from torchsphere.tracking import edge_leakage, raw_mosaic
from torchsphere.tracking.camera_shake import camera_shake
from torchsphere.tracking.frame_memory import lag_of
from torchsphere.tracking.in_place import MIN_DRIFT_PX, SIGNIFICANT_SD, STAY_SD
from torchsphere.tracking.missing_frames import missing_frames
from torchsphere.tracking.result import Track, status_counts
from torchsphere.tracking.steady_error import ROTATION_PER_STEP, sd_of_apparent_turn

#: Most gaps that a sentence names.
MAX_NAMED_GAPS = 5

#: Error of the map's radius by the outline, as a share of the radius, from which a sentence names it.
MAX_OFF_OUTLINE = 0.005

#: Least median turn of a ball that turns in place, deg per frame (docs/constants.toml).
MIN_TURN_DEG = 1.0


def motion_warnings(source: Source, track: Track, start: int, roi_given: bool) -> tuple[str, ...]:
    """Warnings on the ``track`` of the images of ``source``.

    The severe ones come first. ``start`` is the number of its first frame in the recording; ``roi_given`` says that the
    region of interest was given, not chosen.
    """
    return by_level(
        (
            *_frame_warnings(track, start),
            *_circle_warnings(source, track, start),
            *_place_warnings(track),
            *_map_warnings(track),
            *_growth_warnings(track),
            *_video_warnings(track),
            *_pixel_warnings(track),
            *_distance_warnings(track),
            *_leakage_warnings(track, roi_given),
            *_shake_warnings(source, track, start),
            *_model_warnings(track.settings["model"]),
        )
    )


def _frame_warnings(track: Track, start: int) -> list[str]:
    """Frames that were not measured, that repeat others, or that are missing."""
    sentences, n = [], len(track.status)
    # `_model_warnings` reports that the translation model measures no rotation.
    good = ("ok", "weak_texture") if track.settings["model"] == "translation" else ("ok",)
    bad = n - int(np.isin(track.status, good).sum())
    if bad:
        counts = ", ".join(f"{count} {name}" for name, count in status_counts(track).items())
        sentences.append(f"{bad} of {n} frames were not fully measured: {counts}.")
    repeated = track.findings.repeated_frames
    if repeated:
        numbers = ", ".join(str(start + i) for i in repeated)
        sentences.append(
            f"Frames that repeat the image before them bit for bit while the ball moves, not measured: {numbers}."
        )
    if track.findings.hidden:
        sentences.append(
            "In many frames with the whole ball in view it could not be measured, as where something stands in front "
            "of it: the standard deviations of the other frames are twice those of their noise. Look at the overlay."
        )
    gaps = missing_frames(track)
    if gaps:
        numbers = ", ".join(f"{count} before frame {start + i}" for i, count in gaps[:MAX_NAMED_GAPS])
        sentences.append(
            severe(
                "Images seem to be missing, as the ball moves and turns a whole number of times as far in one step as "
                f"in the steps next to it: {numbers}{', ...' if len(gaps) > MAX_NAMED_GAPS else ''}. Times, velocities "
                "and forces are wrong there; measure the parts between with `frames`."
            )
        )
    return sentences


def _growth_warnings(track: Track) -> list[str]:
    """A ball that comes nearer or goes away although no model was given for it."""
    known = np.flatnonzero(np.isfinite(track.position[:, 0]))
    if not track.findings.grows or len(known) < 2:
        return []
    first, last = known[0], known[-1]
    percent = 100 * ((track.radius[last] / track.radius[first]) ** (1 / (last - first)) - 1)
    grows, comes = ("grows", "comes nearer") if percent > 0 else ("shrinks", "goes away")
    return [
        note(
            f"The image of the ball {grows} by {abs(percent):.2g} % per frame, as of a ball that {comes}: it was "
            "measured with the model 'pinhole6', from frame to frame, without a map."
        )
    ]


def _video_warnings(track: Track) -> list[str]:
    """What the video does to the images."""
    sentences, memory = [], track.findings.noise_memory
    if track.findings.interlaced:
        sentences.append(
            note(
                "The video is interlaced: odd rows show the ball at another instant. The even rows alone were used; "
                "all times are theirs."
            )
        )
    if track.findings.mosaic:
        sentences.append(raw_mosaic.about(track.findings.mosaic, track.facts))
    if memory:
        sentences.append(
            f"Each image holds {100 * memory:.0f} % of the image beside it, by its noise, as after temporal noise "
            "reduction or a change of the frame rate: the ball is seen late or early by up to "
            f"{lag_of(memory):.1g} frames, and changes of its motion are smoothed. The standard deviations of the "
            "steps include this; the positions have this shift in time. Switch such processing off in camera and "
            "software."
        )
    if track.findings.coded:
        sentences.append(
            "Parts of the still background are the same to the last grey level from image to image, as after strong "
            "compression (H.264, MPEG-4), which draws the ball from parts of the images before, too. The standard "
            "deviations include this. Save recordings as the camera's own raw file, or without loss."
        )
    return sentences


def _pixel_warnings(track: Track) -> list[str]:
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


def _circle_warnings(source: Source, track: Track, start: int) -> list[str]:
    """Whether the image shows the ball's outline at the circle."""
    sentences, circle = [], track.circle
    if track.findings.untried_frames:
        sentences.append(
            severe(
                f"Nothing confirms the circle at {circle.text(1)} px: the frames right after it hardly "
                f"show the same, so the last {track.findings.untried_frames} frames were not tried."
            )
        )
    if math.isnan(circle.sd_radius):
        sentences.append(note("The circle was given without an uncertainty: no standard deviation includes its error."))
    is_unchecked = math.isnan(circle.sd_radius) or _is_given_to_a_ball_that_hardly_turns(track)
    if is_unchecked and track.settings["camera"] is None:
        image = source.images(circle.frame, circle.frame + 1)[0]
        doubt = given_circle_warning(image.float().cpu(), circle)
        sentences += [severe(doubt)] if doubt else []
    choice = dataclasses.replace(circle, frame=start + circle.frame).choice(
        "with 'torchsphere info INPUT --preview FILE.png'"
    )
    sentences += [choice] if choice else []
    if track.settings["circle_refined"] and circle.doubt:
        in_preview = "with 'torchsphere info INPUT --preview FILE.png'"
        given = bool(track.settings["circle_given"])
        sentences.append(severe(refined_circle_warning(circle) if given else circle.warning(in_preview)))
    return sentences


def _is_given_to_a_ball_that_hardly_turns(track: Track) -> bool:
    """Whether the map leaves the radius of a given circle as it was, since the ball turns too little to tell it."""
    settings = track.settings
    if not settings["circle_given"] or settings["circle_refined"] or not track.findings.is_on_map:
        return False
    known = track.orientation[np.isfinite(track.orientation[:, 0, 0])]
    turn = turn_out_of_plane(torch.from_numpy(known))
    return turn * MAX_CIRCLE_ERROR * track.circle.radius < RADIUS_ERROR_PER_TURN


def _place_warnings(track: Track) -> list[str]:
    """What was done to a ball in its place, and what speaks against that."""
    place, sentences = track.findings.place, []
    if place is None:
        return []
    radius, limbs, shown = place.first_radius_px, place.limbs, place.limbs_radius_px
    if place.recognised:
        within = STAY_SD * max(place.limbs_sd_px[:2])
        sentences.append(
            note(
                f"The ball turns without leaving its place: its outline stays within {within:.2f} px in {limbs} "
                "frames, and the steps that lead away from it are errors. All frames have one position; `in_place` "
                "says so beforehand."
            )
        )
    elif limbs is not None and not place.limbs_stay:
        sentences.append(
            severe(
                "The ball was said to stay in its place, but its outline moves: the positions and rotations are wrong "
                "if it does; leave `in_place` out."
            )
        )
    if place.limbs_stay and abs(shown - radius) > SIGNIFICANT_SD * place.limbs_sd_px[2]:
        sentences.append(
            note(
                f"The outlines of {limbs} frames show a radius of {shown:.2f} px in place of the first {radius:.2f} "
                "px, and were used."
            )
        )
    drift = np.array(place.steps_sum_px)
    steps = np.isfinite(track.increment[:, 0])
    own = (
        np.nan_to_num(np.nanmean(np.diagonal(track.covariance, axis1=1, axis2=2)[:, :2], axis=0)) if steps.any() else 0
    )
    sd = np.hypot(track.sd_steady[:2] * steps.sum(), np.sqrt(own))
    if (np.abs(drift) > np.maximum(SIGNIFICANT_SD * sd, MIN_DRIFT_PX)).any():
        by_limbs = f"; the outlines show {shown:.2f} px" if place.limbs_stay else ""
        sentences.append(
            severe(
                f"The ball was held in its place against steps that add up to {np.hypot(*drift):.1f} px. Likely "
                f"causes: a wrong radius (here {track.circle.radius:.2f} px{by_limbs}), a camera so near that its "
                "perspective matters (give `focal_px` or `distance_mm`), or a ball that does leave its place. The "
                "rotations are wrong, too, by more than they state."
            )
        )
    return sentences


def _map_warnings(track: Track) -> list[str]:
    """Whether poses without a map of the ball may drift."""
    found, sentences = track.findings, []
    if not found.is_on_map and not track.settings["in_place"] and _turns_in_place(track):
        sentences.append(
            "The ball turns fast and hardly moves; if it cannot leave its place, give `in_place` to avoid drift."
        )
    if isinstance(found.map, NoMap) and found.map.is_needed:
        sentences.append(f"Poses rest on the frame-to-frame steps, whose errors add up: {found.map.sentence}.")
    radius, sd = track.circle.radius, track.circle.sd_radius
    if isinstance(found.map, MadeMap) and found.map.radius_off_outline_px > MAX_OFF_OUTLINE * radius:
        sentences.append(
            severe(
                f"The radius on the map of the ball, {radius:.2f} px, may be {sd:.2g} px off: its outline shows "
                "another one, or does not tell it, and the ball hardly turns. Scale, speeds and rotations may be "
                f"wrong by {100 * sd / radius:.2g} %, which their errors include. Look at the circle in the preview, "
                "and give it with `circle`."
            )
        )
    return sentences


def _turns_in_place(track: Track) -> bool:
    """Whether the ball turns fast and moves by less than two radii and a third of the way that its surface turns."""
    turn = np.linalg.norm(track.increment[:, 2:], axis=1)
    known = track.position[np.isfinite(track.position[:, 0])]
    reach = float(np.ptp(known, axis=0).max()) if len(known) else np.inf
    surface = np.nansum(turn) * track.circle.radius
    is_fast = bool(np.isfinite(turn).any()) and float(np.nanmedian(turn)) > np.radians(MIN_TURN_DEG)
    return is_fast and reach < 2 * track.circle.radius and surface > 3 * reach


def _distance_warnings(track: Track) -> list[str]:
    """Whether turns are uncertain as the camera's distance is not known."""
    settings, turns = track.settings, track.covariance[:, [2, 3], [2, 3]]
    if settings["telecentric"] or settings["camera"] is not None or not np.isfinite(turns).any():
        return []
    sd = track.findings.sd_radius_over_distance
    apparent = float(np.degrees(sd_of_apparent_turn(track.increment, track.circle.radius, sd).max()))
    if apparent < np.degrees(np.sqrt(np.nanmedian(turns))):
        return []
    nearness = track.findings.radius_over_distance
    known = f"was found from the images alone ({1 / nearness:.0f} radii)" if nearness else "is not known"
    return [
        f"The camera's distance {known}, and a near ball is seen from another side as it moves sideways, and shows "
        f"its front larger: all turns may be off by the same {apparent:.2g} deg per frame, which their standard "
        "deviations include; give `distance_mm` with `diameter_mm`, or `focal_px`, or `telecentric` for such a lens."
    ]


def _leakage_warnings(track: Track, roi_given: bool) -> list[str]:
    """Whether the background leaks into the region of interest."""
    share, radius = track.findings.leaked, track.circle.radius
    turns = bool(np.isfinite(track.increment[:, 2:]).any())
    if share < edge_leakage.NOTABLE_SHARE or track.findings.is_on_map or not turns:
        return []
    advice = "film the ball larger"
    if roi_given:
        advice = f"leave `roi` out, or give {edge_leakage.roi_without_leakage(radius):g}"
    return [
        "The ball is much brighter or darker than the background, which reaches over the outline of so small a ball "
        f"into the region of interest: rotations about x and y may be {100 * ROTATION_PER_STEP * share:.0f} % too "
        f"large, which their standard deviations include; {advice}."
    ]


def _shake_warnings(source: Source, track: Track, start: int) -> list[str]:
    """Whether the camera was shaken."""
    shake = camera_shake(source, track)
    if shake is None:
        return []
    size = f"{shake.px:.1f} px" if shake.px < 1 else "a px or more"
    return [
        severe(
            f"The background has moved by {size} in frame {start + shake.frame}: the camera was shaken or moved, or a "
            "target that fills the image. Positions, velocities and forces are those in the image, with that motion in "
            "them; mount the camera apart from the target, or take the frames before it moves with `frames`."
        )
    ]


def _model_warnings(model: str) -> list[str]:
    """What a model does not measure, or measures with a bias."""
    if model == "published":
        return [severe("The published modes are no rigid rotation: they bias translation and rotation; see Methods.")]
    if model == "translation":
        return [
            "The translation model takes any rotation of the ball for translation and measures none: rotation and spin "
            "are left empty, and frames are weak_texture at best. Give `model` = rigid to have them."
        ]
    return []
