"""Warnings on the numbers of a track and its kinematics, in sentences for the summary."""

from __future__ import annotations

import numpy as np

from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.estimation.measurements import measured_increments
from torchsphere.estimation.savitzky_golay import runs
from torchsphere.motion.track import Track
from torchsphere.recording import Recording
from torchsphere.recording.facts import doubt_notes
from torchsphere.request import Request
from torchsphere.runtime.warning_levels import Warned, note, severe
from torchsphere.settings.limits import unit_warnings

#: Deviation of an acceleration from its median that no flight has, in standard deviations (docs/constants.toml).
MAX_FLIGHT_SD = 6.0


def track_warnings(request: Request, recording: Recording, track: Track, frame_rate: float | None) -> tuple[str, ...]:
    """Warnings of a track, and those on its calibration."""
    return (
        # A given frame rate replaces that of the file.
        *_of_file(recording, request),
        *track.warnings,
        *_calibration_warnings(request, recording, frame_rate),
        *_scale_warnings(request, track),
    )


def _of_file(recording: Recording, request: Request) -> list[str]:
    """What the file states of itself; a doubt, and what its reader warns of, is more than a remark."""
    texts = [text for text in recording.notes if request.fps is None or "no frame rate" not in text]
    doubts = doubt_notes(recording.doubt)
    return [text if text in doubts or isinstance(text, Warned) else note(text) for text in texts]


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
        advice = [f"`window` = {fits} or less"] if method == "savitzky-golay" and fits > motion.about["order"] else []
        advice.append("`method` = smoother")
        return (
            f"The method {method} takes {window} frames measured in a row, and there are {longest} at most, so that "
            f"{quantities} empty; give {', or '.join(advice)}.",
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


def _calibration_warnings(request: Request, recording: Recording, frame_rate: float | None) -> list[str]:
    """A frame rate that is not known or contradicts the file, and a scale that is not known."""
    sentences = []
    if frame_rate is None:
        sentences.append(note("The frame rate is not known, so there are no times and no kinematics; give `fps`."))
    elif recording.frame_rate is not None and request.fps is not None and request.fps != recording.frame_rate:
        sentences.append(
            note(f"The file states {recording.frame_rate:g} frames/s; {request.fps:g} was given and used.")
        )
    if request.diameter_mm is None and request.mm_per_px is None:
        sentences.append(note("No scale was given, so there are no kinematics; give `diameter_mm` or `mm_per_px`."))
    return sentences


def _scale_warnings(request: Request, track: Track) -> list[str]:
    """A scale or a mass that may have been meant in another unit, and an uncertainty that is not known."""
    if request.diameter_mm is not None:
        given = f"`diameter_mm` = {request.diameter_mm:g}"
        return [severe(text) for text in unit_warnings(request.diameter_mm, request.mass_g, given)]
    if request.mm_per_px is None:
        return []
    given = f"`mm_per_px` = {request.mm_per_px:g}"
    return [
        note("The scale was given and taken as exact; its uncertainty is not included."),
        *map(severe, unit_warnings(2 * track.circle.radius * request.mm_per_px, request.mass_g, given)),
    ]
