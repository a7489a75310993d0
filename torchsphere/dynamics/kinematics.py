"""Velocity, acceleration, spin and force of a track, with uncertainty.

They come from a smoother by default (`rts`), or from local polynomials; `si_units` brings them to
SI units.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics import scale as camera
from torchsphere.dynamics.depth_plane import in_plane
from torchsphere.dynamics.shared_errors import ROTATION_PER_RADIUS
from torchsphere.dynamics.si_units import Draws, Kinematics, in_si
from torchsphere.estimation.rates import polynomials, smoothed
from torchsphere.settings.choices import METHODS, ORDER, WINDOW
from torchsphere.settings.limits import FRAME_RATES, number, positive
from torchsphere.tracking.track import Track

__all__ = ["METHODS", "ROTATION_PER_RADIUS", "Draws", "Kinematics", "kinematics", "kinematics_of_many"]

#: Frames up to which the smoother is run: it keeps 32 x 15 x 15 numbers per frame, 0.06 MB, three times that in
#: contact, and takes 1 to 4 ms with the search for the contact. A recording of an impact has some hundreds of them; a
#: longer one gets local polynomials, and says so.
SMOOTHED_UP_TO = 1500

Array = NDArray[np.float64]


def kinematics(
    track: Track,
    *,
    frame_rate: float,
    diameter_m: float | None = None,
    m_per_px: float | None = None,
    relative_sd_scale: float = 0.0,
    mass_kg: float | None = None,
    lab_frame: bool = False,
    first_frame: int = 0,
    times_s: Array | None = None,
    method: str = "smoother",
    window: int = WINDOW,
    order: int = ORDER,
) -> Kinematics:
    """Motion in SI units.

    Parameters
    ----------
    track : Track
        What was measured, px and frames; with a camera it is brought into the plane of the first depth.
    frame_rate : float
        Frames per second.
    diameter_m, m_per_px : float
        The ball's diameter, or the size of a pixel; one of both, m.
    relative_sd_scale : float
        Relative standard deviation of that diameter or size.
    mass_kg : float, optional
        The ball's mass, for the force.
    lab_frame : bool
        Results in the lab frame (y up, z towards the camera) instead of the camera frame.
    first_frame : int
        Number of the track's first image in the recording, where only a part was tracked.
    times_s : ndarray, optional
        Times of the track's frames (n,), s, where they are not even.
    method : str
        "smoother" (up to `SMOOTHED_UP_TO` frames, then as the next), "savitzky-golay" or "differences".
    window, order : int
        Frames (odd) and order of the polynomials of Savitzky and Golay.

    Returns
    -------
    Kinematics

    Raises
    ------
    ValueError
        If a number is not finite and positive, both or neither of diameter and size of a pixel are given, the times do
        not rise, or the method is not known.

    Notes
    -----
    Velocity is increment over frame interval, force is mass times acceleration: sections 2.2 and 5 of the paper.
    """
    scale, frame_rate, mass_kg = _calibrated(track, frame_rate, diameter_m, m_per_px, relative_sd_scale, mass_kg)
    track = in_plane(track)
    times = _times(track, frame_rate, first_frame, times_s)
    if method not in METHODS:
        raise ValueError(f"method = {method!r}: expected one of {', '.join(METHODS)}")
    if method == "smoother" and len(times) <= SMOOTHED_UP_TO:
        motion = smoothed([track], [times])[0]
    elif method == "smoother":
        motion = polynomials(track, times, "savitzky-golay", window, order)
        motion.about["instead_of_smoother"] = (
            f"the smoother is for recordings of up to {SMOOTHED_UP_TO} frames, this one has {len(times)}; "
            "take the frames around the impact alone"
        )
    else:
        motion = polynomials(track, times, method, window, order)
    return in_si(track, motion, times / frame_rate, scale, frame_rate, mass_kg, lab_frame)


def kinematics_of_many(
    tracks: Sequence[Track],
    *,
    frame_rate: float,
    diameter_m: float | None = None,
    m_per_px: float | None = None,
    relative_sd_scale: float = 0.0,
    mass_kg: float | None = None,
    lab_frame: bool = False,
) -> list[Kinematics]:
    """Smoothed motion of recordings that share frame rate and calibration, all at once; arguments as `kinematics`.

    Raises
    ------
    ValueError
        As `kinematics`.
    """
    if isinstance(tracks, Track):
        raise ValueError("tracks: expected a sequence of tracks, got one Track; see torchsphere.kinematics")
    given = (frame_rate, diameter_m, m_per_px, relative_sd_scale, mass_kg)
    calibrated = [_calibrated(track, *given) for track in tracks]
    tracks = [in_plane(track) for track in tracks]
    times = [_times(track, frame_rate, 0, None) for track in tracks]
    motions = smoothed(tracks, times) if tracks else []
    return [
        in_si(track, motion, moments / rate, scale, rate, mass, lab_frame)
        for track, motion, moments, (scale, rate, mass) in zip(tracks, motions, times, calibrated, strict=True)
    ]


def _calibrated(
    track: Track,
    frame_rate: float | None,
    diameter_m: float | None,
    m_per_px: float | None,
    relative_sd: float,
    mass_kg: float | None,
) -> tuple[camera.Scale, float, float | None]:
    """The scale, the frame rate and the mass, as numbers; ValueError where one of them cannot be."""
    found: Any = track
    if not isinstance(found, Track):
        raise ValueError(f"track: expected what torchsphere.track returns, got {type(found).__name__}")
    if frame_rate is None:
        # What `Recording.frame_rate` is where the file does not tell it.
        raise ValueError("frame_rate = None: the recording does not tell it; give the camera's, frames per second")
    rate = positive("frame_rate", frame_rate)
    mass = None if mass_kg is None else positive("mass_kg", mass_kg)
    if not FRAME_RATES[0] <= rate <= FRAME_RATES[1]:
        raise ValueError(
            f"frame_rate = {frame_rate!r}: expected {FRAME_RATES[0]:g} to {FRAME_RATES[1]:g} frames per second"
        )
    share = number(relative_sd)
    if not 0 <= share < 1:
        raise ValueError(f"relative_sd_scale = {relative_sd!r}: expected a share from 0 to below 1")
    exact = camera.scale(track.circle, diameter_m=diameter_m, m_per_px=m_per_px)
    if share == 0:
        return exact, rate, mass
    origin = exact.origin.replace(", taken as exact", "") + f", itself known to {100 * share:.2g} %"
    sd = math.hypot(exact.sd_m_per_px, exact.m_per_px * share)
    return camera.Scale(exact.m_per_px, sd, origin), rate, mass


def _times(track: Track, frame_rate: float, first_frame: int, times_s: Array | None) -> Array:
    """Times of the frames (n,), in frames."""
    n = len(track.status)
    if not math.isfinite(number(first_frame)):
        raise ValueError(f"first_frame = {first_frame!r}: expected the number of a frame")
    if times_s is None:
        return first_frame + np.arange(float(n))
    try:
        times = np.asarray(times_s, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"times_s: expected {n} finite, rising times, one per frame, got {times_s!r}") from error
    if times.shape != (n,) or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise ValueError(f"times_s: expected {n} finite, rising times, one per frame, got an array {times.shape}")
    return times * frame_rate
