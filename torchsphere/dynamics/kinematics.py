"""Velocity, acceleration, spin and force of a track, and its mean motion, with uncertainty.

The source is a smoother (`estimation.rts`) by default, or local polynomials; `si_units` converts the units.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from torchsphere.dynamics.depth_motion import depth, is_known
from torchsphere.dynamics.depth_plane import in_depth_plane
from torchsphere.dynamics.draws import Draws
from torchsphere.dynamics.scale import Scale, distance_error, scale
from torchsphere.dynamics.shared_errors import SharedErrors
from torchsphere.dynamics.si_units import FoundContact, Kinematics, in_si_units
from torchsphere.dynamics.units import Units
from torchsphere.estimation.measurements import measured_increments, poses
from torchsphere.estimation.rates import Motion, polynomials
from torchsphere.estimation.sections import smoothed
from torchsphere.motion.track import Track
from torchsphere.runtime import warning_levels
from torchsphere.runtime.arrays import Array
from torchsphere.settings.calibration import Calibration, implausible_units, with_option_names
from torchsphere.settings.choices import METHODS, ORDER, WINDOW
from torchsphere.settings.limits import as_float
from torchsphere.sphere_map.decision import MadeMap

__all__ = ["Draws", "FoundContact", "Kinematics", "kinematics", "kinematics_of_many", "mean_motion"]


def kinematics(
    track: Track,
    *,
    frame_rate: float | None = None,
    diameter_m: float | None = None,
    m_per_px: float | None = None,
    relative_sd_scale: float = 0.0,
    mass_kg: float | None = None,
    relative_sd_mass: float = 0.0,
    relative_sd_frame_rate: float = 0.0,
    lab_frame: bool = False,
    first_frame: int | None = None,
    times_s: Array | None = None,
    method: str = "smoother",
    window: int = WINDOW,
    order: int = ORDER,
    log: bool = True,
    **options: float | None,
) -> Kinematics:
    """Motion in SI units.

    What is not given is that of ``track.calibration``: the frame rate of the recording, and what `track` was given. So
    are standard deviations of 0, unless their quantity is given anew.
    What is given wins, and a contradiction is a warning.

    Parameters
    ----------
    track : Track
        Measured motion, px and frames; with a camera it is moved into the plane of the first depth.
    frame_rate : float, optional
        Frames per second.
    diameter_m, m_per_px : float, optional
        The ball's diameter or the size of a pixel, m; give one of them, here or to `track`.
    relative_sd_scale : float
        Relative standard deviation of that diameter or size.
    mass_kg : float, optional
        The ball's mass, for the force.
    relative_sd_mass, relative_sd_frame_rate : float
        Relative standard deviations of mass and frame rate, as 0.01 for 1 %. All frames share these errors.
    lab_frame : bool
        Results in the lab frame (y up, z towards the camera) instead of the camera frame.
    first_frame : int, optional
        Number of the track's first image in the recording, if only a part was tracked; by default as in the track.
    times_s : ndarray, optional
        Times of the track's frames (n,), s, if their intervals differ; by default those of `Track.times`.
    method : str
        "smoother", "savitzky-golay" or "differences".
    window, order : int
        Frames (odd) and order of the polynomials of Savitzky and Golay.
    log : bool
        Hand each of `Kinematics.warnings` that the track does not have to the logger ``torchsphere``, too, at the
        level WARNING.
    **options : float
        The same by the names of the command line: ``fps``, ``diameter_mm``, ``mm_per_px``, ``mass_g``,
        ``scale_sd_percent``, ``mass_sd_percent``, ``fps_sd_percent``.

    Returns
    -------
    Kinematics

    Raises
    ------
    ValueError
        If a number is not finite and positive, a relative standard deviation is not in [0, 1), both or neither of
        diameter and size of a pixel are given, no frame rate is known, the times do not rise, or the method is not
        known.

    Notes
    -----
    Velocity is increment over frame interval, force is mass times acceleration: sections 2.2 and 5 of the paper.
    """
    _check_track(track)
    known = _inputs(
        track,
        {
            "frame_rate": frame_rate,
            "diameter_m": diameter_m,
            "m_per_px": m_per_px,
            "mass_kg": mass_kg,
            "relative_sd_scale": relative_sd_scale,
            "relative_sd_mass": relative_sd_mass,
            "relative_sd_frame_rate": relative_sd_frame_rate,
        },
        options,
    )
    if first_frame is not None:
        track = replace(track, first_frame=first_frame)
    plane = in_depth_plane(track)
    times = _times(plane, known.frame_rate, track.first_frame, times_s)
    if method not in METHODS:
        raise ValueError(f"method = {method!r}: expected one of {', '.join(METHODS)}")

    def differentiate(moved: Track) -> Motion:
        return _smoothed(moved, times) if method == "smoother" else polynomials(moved, times, method, window, order)

    return _result(track, plane, differentiate(plane), times, known, differentiate, lab_frame=lab_frame, log=log)


def kinematics_of_many(
    tracks: Sequence[Track],
    *,
    frame_rate: float | None = None,
    diameter_m: float | None = None,
    m_per_px: float | None = None,
    relative_sd_scale: float = 0.0,
    mass_kg: float | None = None,
    relative_sd_mass: float = 0.0,
    relative_sd_frame_rate: float = 0.0,
    lab_frame: bool = False,
    log: bool = True,
    **options: float | None,
) -> list[Kinematics]:
    """Smoothed motion of recordings that share frame rate and calibration, all at once; arguments as `kinematics`.

    Raises
    ------
    ValueError
        As `kinematics`.
    """
    if isinstance(tracks, Track):
        raise ValueError("tracks: expected a sequence of tracks, got one Track; see torchsphere.kinematics")
    for track in tracks:
        _check_track(track)
    given = {
        "frame_rate": frame_rate,
        "diameter_m": diameter_m,
        "m_per_px": m_per_px,
        "mass_kg": mass_kg,
        "relative_sd_scale": relative_sd_scale,
        "relative_sd_mass": relative_sd_mass,
        "relative_sd_frame_rate": relative_sd_frame_rate,
    }
    if not tracks:
        return []
    known = [_inputs(track, given, options) for track in tracks]
    planes = [in_depth_plane(track) for track in tracks]
    times = [_times(track, each.frame_rate, track.first_frame, None) for track, each in zip(planes, known, strict=True)]
    motions = smoothed(planes, times)
    return [
        _result(track, plane, motion, moments, each, partial(_smoothed, times=moments), lab_frame=lab_frame, log=log)
        for track, plane, motion, moments, each in zip(tracks, planes, motions, times, known, strict=True)
    ]


@dataclass(frozen=True)
class _Inputs:
    """Checked numbers beside the track, and sentences on contradictions and units."""

    calibration: Calibration
    frame_rate: float
    scale: Scale
    warnings: tuple[str, ...]


def _inputs(track: Track, given: Mapping[str, Any], options: Mapping[str, Any]) -> _Inputs:
    """What was given, by the names of Python or of the command line, over what the track knows."""
    unset = {name: 0.0 for name in given if name.startswith("relative_sd_")}
    values = with_option_names("kinematics", given, options, unset)
    known, notes = track.calibration.overridden(Calibration(**values), "The track")
    if known.frame_rate is None:
        raise ValueError("frame_rate = None: the recording does not tell it; give the camera's, frames per second")
    pixel = _scale(track, known.diameter_m, known.m_per_px, known.relative_sd_scale)
    units = implausible_units(2 * track.circle.radius * pixel.m_per_px, known.mass_kg)
    return _Inputs(known, known.frame_rate, pixel, (*notes, *units))


def _smoothed(moved: Track, times: Array) -> Motion:
    return smoothed([moved], [times])[0]


def _result(
    track: Track,
    plane: Track,
    motion: Motion,
    times: Array,
    known: _Inputs,
    differentiate: Callable[[Track], Motion],
    *,
    lab_frame: bool,
    log: bool,
) -> Kinematics:
    """The motion in SI units; ``plane`` is the track in the plane of the first depth, ``times`` are in frames.

    ``differentiate`` gives the motion of a track as it gave that of the ``plane``.
    """
    given = known.calibration
    units = Units(known.scale, known.frame_rate, lab_frame, given.relative_sd_frame_rate)
    mass = given.mass_kg, given.relative_sd_mass
    found = in_si_units(plane, motion, times / known.frame_rate, units, *mass)
    if is_known(track):
        found = replace(found, depth=depth(plane, motion, times, units, *mass, differentiate))
    if log:
        warning_levels.log(sentence for sentence in known.warnings if sentence not in track.warnings)
    return replace(found, track=replace(track, calibration=known.calibration), warnings=known.warnings)


def _scale(track: Track, diameter_m: float | None, m_per_px: float | None, relative_sd: float) -> Scale:
    """Scale of a track, whose outline is larger the nearer the camera is, and another one where the lens bends."""
    by_distance = distance_error(track.findings.radius_over_distance, track.findings.sd_radius_over_distance)
    made = track.findings.map
    if isinstance(made, MadeMap):
        by_distance = math.hypot(by_distance, made.sd_scale)
    return scale(
        track.circle, diameter_m=diameter_m, m_per_px=m_per_px, relative_sd=relative_sd, sd_by_distance=by_distance
    )


def mean_motion(track: Track, motion: Kinematics | None) -> dict[str, Array]:
    """Means over the time of the measured steps and their standard deviations, for the summary; NaN if none was.

    ``increment_px_rad`` (5,); with ``motion`` also ``velocity_m_s`` (2,) and ``spin_rad_s`` (3,) in its axes, and
    ``out_of_plane_deg`` where the depth is known: see `Depth`. The standard deviations have the same names with
    ``sd_``.
    """
    step, sd = _mean_step(track, Scale(1.0, 0.0, "px"))
    means = {"increment_px_rad": step, "sd_increment_px_rad": sd}
    if motion is None:
        return means
    step, sd = _mean_step(in_depth_plane(track), motion.scale)
    units = Units(motion.scale, motion.frame_rate, motion.lab_frame, motion.relative_sd_frame_rate)
    velocity, spin = units.rates(step)
    sd_velocity, sd_spin = units.sd_rates(step, sd)
    means |= {"velocity_m_s": velocity, "sd_velocity_m_s": sd_velocity}
    if motion.depth is not None:
        angles, sds = motion.depth.out_of_plane_deg, motion.depth.sd_out_of_plane_deg
        means |= {"out_of_plane_deg": np.array(angles), "sd_out_of_plane_deg": np.array(sds)}
    return means | {"spin_rad_s": spin, "sd_spin_rad_s": sd_spin}


def _mean_step(track: Track, scale: Scale) -> tuple[Array, Array]:
    """Mean (5,) of the measured steps and its standard deviation, px and rad; ``scale`` gives the lengths' error.

    In a sum of successive steps the errors of the poses between the first and the last cancel. The errors of these two
    remain, the share of each step's error that stays in all later poses, and the errors that all steps share.
    """
    # Rotations of 0 without a standard deviation come from a model without rotations, not from a measurement.
    has_sd = np.isfinite(np.diagonal(track.covariance, axis1=1, axis2=2))
    valid = np.repeat(measured_increments(track), (2, 3), axis=1) & has_sd
    count = (valid * track.durations[:, None]).sum(0)
    divisor = np.where(count > 0, count, np.nan)
    mean = np.where(valid, track.increment, 0.0).sum(0) / divisor
    measured = poses([track], [np.arange(float(len(track.status)))])
    variance = np.diagonal(measured.covariance[0].numpy(), axis1=1, axis2=2)
    # A step adds the error of its second pose and subtracts that of its first: only the ends of a run remain.
    edge = np.zeros((1, valid.shape[1]), dtype=bool)
    before, after = np.concatenate((edge, valid)), np.concatenate((valid, edge))
    end_variance = np.where(before != after, variance, 0.0).sum(0)
    lasting_variance = np.where(valid, measured.drift_variance[0].numpy(), 0.0).sum(0)
    shared = SharedErrors.of(track, scale)
    own_sd = np.hypot(np.sqrt(end_variance + lasting_variance) / divisor, shared.steady)
    return mean, shared.total_sd(mean[None], own_sd[None])[0]


def _check_track(track: Any) -> None:
    """Raise ValueError unless it is a track: `track_many` returns errors among its tracks."""
    if not isinstance(track, Track):
        raise ValueError(f"track: expected what torchsphere.track returns, got {type(track).__name__}")
    if len(track.status) < 2:
        raise ValueError("track: one frame shows no motion; expected two frames or more")


def _times(track: Track, frame_rate: float, first_frame: int, times_s: Array | None) -> Array:
    """Times of the frames (n,), in frames."""
    n = len(track.status)
    if not math.isfinite(as_float(first_frame)):
        raise ValueError(f"first_frame = {first_frame!r}: expected the number of a frame")
    if times_s is None:
        return first_frame + np.arange(float(n)) if track.times is None else track.times
    try:
        times = np.asarray(times_s, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"times_s: expected {n} finite, rising times, one per frame, got {times_s!r}") from error
    if times.shape != (n,) or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise ValueError(f"times_s: expected {n} finite, rising times, one per frame, got an array {times.shape}")
    return times * frame_rate
