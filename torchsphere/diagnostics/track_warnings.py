"""What a reader of a result has to know before trusting its numbers, in sentences for the summary's warnings."""

from __future__ import annotations

import math

import numpy as np
import torch

from torchsphere.detection.detect import confirm, refined
from torchsphere.diagnostics.camera_shake import shaken
from torchsphere.diagnostics.missing_frames import skipped
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.estimation.measurements import joined
from torchsphere.estimation.savitzky_golay import runs
from torchsphere.recording import Recording
from torchsphere.request import Request
from torchsphere.results import writer
from torchsphere.settings.limits import implausible, option
from torchsphere.tracking import edge_leakage
from torchsphere.tracking.steady_error import ROTATION_PER_STEP
from torchsphere.tracking.track import Track

#: Standard deviations from its median beyond which an acceleration is none of a flight.
PUSHED = 6.0

#: Gaps that a sentence names.
NAMED = 5


def cautions(
    request: Request, recording: Recording, tracked: Track, frame_rate: float | None, start: int
) -> tuple[str, ...]:
    """Sentences that a reader of the result has to know."""
    return (
        # What the file lacks and the user gave is nothing to know of.
        *(note for note in recording.notes if request.fps is None or "no frame rate" not in note),
        *_of_frames(request, tracked, start),
        *_of_rate(request, recording, frame_rate),
        *_of_circle(recording, tracked, start),
        *_of_scale(request, tracked),
        *_of_map(request, tracked),
        *_of_leak(request, tracked),
        *_of_camera(recording, tracked, start),
        *_of_model(request),
    )


def too_short(tracked: Track, motion: Kinematics | None) -> tuple[str, ...]:
    """A sentence where polynomials take more frames than were measured in a row anywhere: their rates are all NaN."""
    if motion is None or "window_frames" not in motion.about:
        return ()
    window, method = motion.about["window_frames"], motion.about["method"]
    for what, group in (("velocities, accelerations and spins are", 0), ("spins are", 1)):
        # A motion that was not measured at all is told elsewhere.
        longest = max((stop - start for start, stop in runs(joined(tracked)[:, group])), default=window)
        if longest >= window:
            continue
        fits = longest - 1 + longest % 2
        advice = [f"--window {fits} or less"] if method == "savitzky-golay" and fits > motion.about["order"] else []
        if "instead_of_smoother" not in motion.about:
            advice.append("--method smoother")
        return (
            f"The method {method} takes {window} frames measured in a row, and there are {longest} at most, so that "
            f"{what} empty{'; give ' if advice else ''}{', or '.join(advice)}.",
        )
    return ()


def flattened(motion: Kinematics | None) -> tuple[str, ...]:
    """A sentence where polynomials are laid through a motion that may be faster than they."""
    if motion is None or "window_frames" not in motion.about or not np.isfinite(motion.acceleration_m_s2).any():
        return ()
    off = np.abs(motion.acceleration_m_s2 - np.nanmedian(motion.acceleration_m_s2, axis=0))
    if not (off > PUSHED * motion.sd_acceleration_m_s2).any():
        return ()
    return (
        f"The standard deviations of the method {motion.about['method']} do not hold what its polynomials over "
        f"{motion.about['window_frames']} frames flatten: of accelerations faster than "
        f"{motion.about['bandwidth_Hz']['acceleration']:.3g} Hz, as in a contact, peaks come out too small and edges "
        "too wide.",
    )


def _of_frames(request: Request, tracked: Track, start: int) -> list[str]:
    """Frames that were not measured, that repeat others, or that are missing."""
    found, n = [], len(tracked.status)
    # What the model does not measure has a sentence of its own.
    good = ("ok", "weak_texture") if request.model == "translation" else ("ok",)
    bad = n - int(np.isin(tracked.status, good).sum())
    if bad:
        counts = ", ".join(f"{count} {name}" for name, count in writer.status_counts(tracked).items())
        found.append(f"{bad} of {n} frames were not fully measured: {counts}.")
    repeated = tracked.settings["repeated_frames"]
    if repeated:
        numbers = ", ".join(str(start + i) for i in repeated)
        found.append(
            f"Frames that repeat the image before them bit for bit while the ball moves, not measured: {numbers}."
        )
    gaps = skipped(tracked)
    if gaps:
        numbers = ", ".join(f"{count} before frame {start + i}" for i, count in gaps[:NAMED])
        found.append(
            f"Images seem to be missing, as the ball moves and turns a whole number of times as far in one step as "
            f"around it: {numbers}{', ...' if len(gaps) > NAMED else ''}. Times, velocities and forces are wrong "
            "there; measure what lies between with --frames."
        )
    return found


def _of_rate(request: Request, recording: Recording, frame_rate: float | None) -> list[str]:
    """A frame rate that is not known, or that the file contradicts; and a scale that is not known."""
    found = []
    if frame_rate is None:
        found.append("The frame rate is not known, so there are no times and no kinematics; give --fps.")
    elif recording.frame_rate is not None and request.fps is not None and request.fps != recording.frame_rate:
        found.append(f"The file states {recording.frame_rate:g} frames/s; {request.fps:g} was given and used.")
    if request.diameter_mm is None and request.mm_per_px is None:
        found.append("No scale was given, so there are no kinematics; give --diameter-mm or --mm-per-px.")
    return found


def _of_circle(recording: Recording, tracked: Track, start: int) -> list[str]:
    """Whether the circle is the ball's outline, by what the image shows."""
    found = []
    if math.isnan(tracked.circle.sd_radius):
        found.append("The circle was given without an uncertainty; what it adds to the results' is not included.")
        found += _confirmed(recording, tracked, start)
    if tracked.settings["circle_refined"] and tracked.circle.doubt:
        in_preview = "with 'torchsphere info INPUT --preview FILE.png'"
        was_given = tracked.settings["circle_given"]
        found.append(refined(tracked.circle) if was_given else tracked.circle.warning(in_preview))
    return found


def _of_scale(request: Request, tracked: Track) -> list[str]:
    """A scale or a mass that may have been meant in another unit, and an uncertainty that is not known."""
    if request.diameter_mm is not None:
        given = f"{option('diameter_mm')} {request.diameter_mm:g}"
        return [*implausible(request.diameter_mm, request.mass_g, given)]
    if request.mm_per_px is None:
        return []
    given = f"{option('mm_per_px')} {request.mm_per_px:g}"
    return [
        "The scale was given and taken as exact; its uncertainty is not included.",
        *implausible(2 * tracked.circle.radius * request.mm_per_px, request.mass_g, given),
    ]


def _of_map(request: Request, tracked: Track) -> list[str]:
    """What a map of the ball would have done."""
    about_map, found = tracked.settings["sphere_map"], []
    if not about_map["used"] and not request.in_place and _turns_in_place(tracked):
        found.append(
            "The ball turns fast and hardly moves; if it cannot leave its place, say --in-place against drift."
        )
    if not about_map["used"] and request.map != "off" and not about_map["reason"].startswith("not needed"):
        found.append(f"Poses rest on the frame-to-frame steps, whose errors add up: {about_map['reason']}.")
    return found


def _of_leak(request: Request, tracked: Track) -> list[str]:
    """What is behind the ball and leaks into its region of interest."""
    share, radius = tracked.settings["leaked"], tracked.circle.radius
    turns = bool(np.isfinite(tracked.increment[:, 2:]).any())
    if share < edge_leakage.NOTABLE or tracked.settings["sphere_map"]["used"] or not turns:
        return []
    smaller = (
        f"leave --roi out, or give {edge_leakage.roi_without_leakage(radius):g}"
        if request.roi is not None
        else "film the ball larger"
    )
    return [
        "The ball is much brighter or darker than what is behind it, and that reaches over the outline of so small a "
        f"ball into the region of interest: rotations about x and y may be {100 * ROTATION_PER_STEP * share:.0f} % too "
        f"large, which their standard deviations hold; {smaller}."
    ]


def _of_camera(recording: Recording, tracked: Track, start: int) -> list[str]:
    """Whether the camera was shaken."""
    found = shaken(recording, tracked, start)
    if found is None:
        return []
    size = f"{found.px:.1f} px" if found.px < 1 else "a px or more"
    return [
        f"What is behind the ball has moved by {size} in frame {start + found.frame}: the camera was shaken or moved, "
        "or a target that fills the image. Positions, velocities and forces are those in the image, with that motion "
        "in them; mount the camera apart from what is hit, or take the frames before it moves with --frames."
    ]


def _of_model(request: Request) -> list[str]:
    if request.model == "published":
        return ["The published modes are no rigid rotation: they bias translation and rotation; see the README."]
    if request.model == "translation":
        return [
            "The translation model takes any rotation of the ball for translation and measures none: rotation and spin "
            "are left empty, and frames are weak_texture at best. Give --model rigid to have them."
        ]
    return []


def _confirmed(recording: Recording, tracked: Track, start: int) -> list[str]:
    """Whether the images show a ball where its circle was given."""
    if tracked.settings["camera"] is not None:
        return []
    frame = start + tracked.circle.frame
    doubt = confirm(torch.as_tensor(recording.images(frame, frame + 1)[0]).float(), tracked.circle)
    return [doubt] if doubt else []


def _turns_in_place(tracked: Track) -> bool:
    """Whether the ball turns by more than it moves: more than 1 deg per frame, less than two radii in all."""
    turn = np.linalg.norm(tracked.increment[:, 2:], axis=1)
    known = tracked.position[np.isfinite(tracked.position[:, 0])]
    reach = float(np.ptp(known, axis=0).max()) if len(known) else np.inf
    swept = np.nansum(turn) * tracked.circle.radius
    fast = bool(np.isfinite(turn).any()) and float(np.nanmedian(turn)) > np.radians(1.0)
    return fast and reach < 2 * tracked.circle.radius and swept > 3 * reach
