"""Warnings on the numbers of a track and its kinematics, in sentences for the summary."""

from __future__ import annotations

import math

import numpy as np
import torch

from torchsphere.detection.detect import given_circle_warning, refined_circle_warning
from torchsphere.diagnostics.camera_shake import camera_shake
from torchsphere.diagnostics.missing_frames import missing_frames
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.estimation.measurements import measured_increments
from torchsphere.estimation.savitzky_golay import runs
from torchsphere.recording import Recording
from torchsphere.request import Request
from torchsphere.results import writer
from torchsphere.settings.limits import option_name, unit_warnings
from torchsphere.tracking import edge_leakage
from torchsphere.tracking.steady_error import ROTATION_PER_STEP
from torchsphere.tracking.track import Track

#: Deviation of an acceleration from its median that no flight has, in standard deviations (docs/constants.md).
MAX_FLIGHT_SD = 6.0

#: Most gaps that a sentence names.
MAX_NAMED_GAPS = 5

#: Least median turn of a ball that turns in place, deg per frame (docs/constants.md).
MIN_TURN_DEG = 1.0


def track_warnings(
    request: Request, recording: Recording, track: Track, frame_rate: float | None, start: int
) -> tuple[str, ...]:
    """Warnings on a track; ``start`` is the number of its first frame in the recording."""
    return (
        # A given frame rate replaces that of the file.
        *(note for note in recording.notes if request.fps is None or "no frame rate" not in note),
        *_frame_warnings(request, track, start),
        *_calibration_warnings(request, recording, frame_rate),
        *_circle_warnings(recording, track, start),
        *_scale_warnings(request, track),
        *_map_warnings(request, track),
        *_leakage_warnings(request, track),
        *_shake_warnings(recording, track, start),
        *_model_warnings(request),
    )


def window_warnings(track: Track, motion: Kinematics | None) -> tuple[str, ...]:
    """A sentence if polynomials need more frames in a row than were measured anywhere: their rates are all NaN."""
    if motion is None or "window_frames" not in motion.about:
        return ()
    window, method = motion.about["window_frames"], motion.about["method"]
    for quantities, group in (("velocities, accelerations and spins are", 0), ("spins are", 1)):
        # Another sentence reports a motion that was not measured at all.
        longest = max((stop - start for start, stop in runs(measured_increments(track)[:, group])), default=window)
        if longest >= window:
            continue
        fits = longest - 1 + longest % 2
        advice = [f"--window {fits} or less"] if method == "savitzky-golay" and fits > motion.about["order"] else []
        if "instead_of_smoother" not in motion.about:
            advice.append("--method smoother")
        return (
            f"The method {method} takes {window} frames measured in a row, and there are {longest} at most, so that "
            f"{quantities} empty{'; give ' if advice else ''}{', or '.join(advice)}.",
        )
    return ()


def bandwidth_warnings(motion: Kinematics | None) -> tuple[str, ...]:
    """A sentence if the motion may be faster than the polynomials that were fitted to it."""
    if motion is None or "window_frames" not in motion.about or not np.isfinite(motion.acceleration_m_s2).any():
        return ()
    deviation = np.abs(motion.acceleration_m_s2 - np.nanmedian(motion.acceleration_m_s2, axis=0))
    if not (deviation > MAX_FLIGHT_SD * motion.sd_acceleration_m_s2).any():
        return ()
    return (
        f"The standard deviations of the method {motion.about['method']} do not hold what its polynomials over "
        f"{motion.about['window_frames']} frames flatten: peaks of accelerations faster than "
        f"{motion.about['bandwidth_Hz']['acceleration']:.3g} Hz, as in a contact, come out too small and their edges "
        "too wide.",
    )


def _frame_warnings(request: Request, track: Track, start: int) -> list[str]:
    """Frames that were not measured, that repeat others, or that are missing."""
    sentences, n = [], len(track.status)
    # `_model_warnings` reports that the translation model measures no rotation.
    good = ("ok", "weak_texture") if request.model == "translation" else ("ok",)
    bad = n - int(np.isin(track.status, good).sum())
    if bad:
        counts = ", ".join(f"{count} {name}" for name, count in writer.status_counts(track).items())
        sentences.append(f"{bad} of {n} frames were not fully measured: {counts}.")
    repeated = track.settings["repeated_frames"]
    if repeated:
        numbers = ", ".join(str(start + i) for i in repeated)
        sentences.append(
            f"Frames that repeat the image before them bit for bit while the ball moves, not measured: {numbers}."
        )
    gaps = missing_frames(track)
    if gaps:
        numbers = ", ".join(f"{count} before frame {start + i}" for i, count in gaps[:MAX_NAMED_GAPS])
        sentences.append(
            "Images seem to be missing, as the ball moves and turns a whole number of times as far in one step as in "
            f"the steps next to it: {numbers}{', ...' if len(gaps) > MAX_NAMED_GAPS else ''}. Times, velocities and "
            "forces are wrong there; measure the parts between with --frames."
        )
    return sentences


def _calibration_warnings(request: Request, recording: Recording, frame_rate: float | None) -> list[str]:
    """A frame rate that is not known or contradicts the file, and a scale that is not known."""
    sentences = []
    if frame_rate is None:
        sentences.append("The frame rate is not known, so there are no times and no kinematics; give --fps.")
    elif recording.frame_rate is not None and request.fps is not None and request.fps != recording.frame_rate:
        sentences.append(f"The file states {recording.frame_rate:g} frames/s; {request.fps:g} was given and used.")
    if request.diameter_mm is None and request.mm_per_px is None:
        sentences.append("No scale was given, so there are no kinematics; give --diameter-mm or --mm-per-px.")
    return sentences


def _circle_warnings(recording: Recording, track: Track, start: int) -> list[str]:
    """Whether the image shows the ball's outline at the circle."""
    sentences, circle = [], track.circle
    if math.isnan(circle.sd_radius):
        sentences.append("The circle was given without an uncertainty: no standard deviation includes its error.")
        if track.settings["camera"] is None:
            frame = start + circle.frame
            doubt = given_circle_warning(torch.as_tensor(recording.images(frame, frame + 1)[0]).float(), circle)
            sentences += [doubt] if doubt else []
    if track.settings["circle_refined"] and circle.doubt:
        in_preview = "with 'torchsphere info INPUT --preview FILE.png'"
        sentences.append(
            refined_circle_warning(circle) if track.settings["circle_given"] else circle.warning(in_preview)
        )
    return sentences


def _scale_warnings(request: Request, track: Track) -> list[str]:
    """A scale or a mass that may have been meant in another unit, and an uncertainty that is not known."""
    if request.diameter_mm is not None:
        given = f"{option_name('diameter_mm')} {request.diameter_mm:g}"
        return [*unit_warnings(request.diameter_mm, request.mass_g, given)]
    if request.mm_per_px is None:
        return []
    given = f"{option_name('mm_per_px')} {request.mm_per_px:g}"
    return [
        "The scale was given and taken as exact; its uncertainty is not included.",
        *unit_warnings(2 * track.circle.radius * request.mm_per_px, request.mass_g, given),
    ]


def _map_warnings(request: Request, track: Track) -> list[str]:
    """Whether poses without a map of the ball may drift."""
    sphere_map, sentences = track.settings["sphere_map"], []
    if not sphere_map["used"] and not request.in_place and _turns_in_place(track):
        sentences.append(
            "The ball turns fast and hardly moves; if it cannot leave its place, give --in-place to avoid drift."
        )
    if not sphere_map["used"] and request.map != "off" and not sphere_map["reason"].startswith("not needed"):
        sentences.append(f"Poses rest on the frame-to-frame steps, whose errors add up: {sphere_map['reason']}.")
    return sentences


def _turns_in_place(track: Track) -> bool:
    """Whether the ball turns fast and moves by less than two radii and a third of the way that its surface turns."""
    turn = np.linalg.norm(track.increment[:, 2:], axis=1)
    known = track.position[np.isfinite(track.position[:, 0])]
    reach = float(np.ptp(known, axis=0).max()) if len(known) else np.inf
    surface = np.nansum(turn) * track.circle.radius
    is_fast = bool(np.isfinite(turn).any()) and float(np.nanmedian(turn)) > np.radians(MIN_TURN_DEG)
    return is_fast and reach < 2 * track.circle.radius and surface > 3 * reach


def _leakage_warnings(request: Request, track: Track) -> list[str]:
    """Whether the background leaks into the region of interest."""
    share, radius = track.settings["leaked"], track.circle.radius
    turns = bool(np.isfinite(track.increment[:, 2:]).any())
    if share < edge_leakage.NOTABLE_SHARE or track.settings["sphere_map"]["used"] or not turns:
        return []
    advice = "film the ball larger"
    if request.roi is not None:
        advice = f"leave --roi out, or give {edge_leakage.roi_without_leakage(radius):g}"
    return [
        "The ball is much brighter or darker than the background, which reaches over the outline of so small a ball "
        f"into the region of interest: rotations about x and y may be {100 * ROTATION_PER_STEP * share:.0f} % too "
        f"large, which their standard deviations include; {advice}."
    ]


def _shake_warnings(recording: Recording, track: Track, start: int) -> list[str]:
    """Whether the camera was shaken."""
    shake = camera_shake(recording, track, start)
    if shake is None:
        return []
    size = f"{shake.px:.1f} px" if shake.px < 1 else "a px or more"
    return [
        f"The background has moved by {size} in frame {start + shake.frame}: the camera was shaken or moved, or a "
        "target that fills the image. Positions, velocities and forces are those in the image, with that motion in "
        "them; mount the camera apart from the target, or take the frames before it moves with --frames."
    ]


def _model_warnings(request: Request) -> list[str]:
    """What a model does not measure, or measures with a bias."""
    if request.model == "published":
        return ["The published modes are no rigid rotation: they bias translation and rotation; see the README."]
    if request.model == "translation":
        return [
            "The translation model takes any rotation of the ball for translation and measures none: rotation and spin "
            "are left empty, and frames are weak_texture at best. Give --model rigid to have them."
        ]
    return []
