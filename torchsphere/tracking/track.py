"""`track`: from a recording to the ball's motion in px and rad."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import torch

from torchsphere.correlation.options import options_for
from torchsphere.detection.ball_or_not import lacking_proof, require_proof
from torchsphere.errors import ledger
from torchsphere.motion.track import Track
from torchsphere.recording.facts import Facts
from torchsphere.recording.frame_source import Source
from torchsphere.runtime import steps, threads, warning_levels
from torchsphere.settings.arrays import as_mask
from torchsphere.settings.limits import require_switch
from torchsphere.tracking import arguments, phases
from torchsphere.tracking.follow import Progress, Watch
from torchsphere.tracking.task import Task

__all__ = ["Track", "track", "track_many"]


@threads.single_threaded_torch()
def track(
    recording: Any,
    circle: Any = None,
    *,
    ignore: Any = None,
    device: str | torch.device | None = None,
    refine: bool = False,
    in_place: bool = False,
    telecentric: bool = False,
    sphere_map: bool | None = None,
    exposure: float | None = None,
    progress: Progress | None = None,
    watch: Watch | None = None,
    dtype: torch.dtype = torch.float32,
    first_frame: int = 0,
    frames: tuple[int | None, int | None] | slice | None = None,
    frame_rate: float | None = None,
    diameter_m: float | None = None,
    m_per_px: float | None = None,
    mass_kg: float | None = None,
    pixel_aspect: float | None = None,
    bayer: str | None = None,
    map: str | None = None,  # noqa: A002  (the name of the command line)
    log: bool = True,
    **options: Any,
) -> Track:
    """Follow the ball through a recording.

    Parameters
    ----------
    recording : Recording or array_like
        Images (n, h, w), NumPy or torch, or a `Recording`, which is read as needed.
    circle : tuple of float or Circle, optional
        Outline (x, y, radius) of the ball in the first image, px. It is taken as given unless a map of the ball
        corrects it. A `Circle` with a camera is the projected centre and the radius at its depth, as in
        `Track.circle`. By default the ball is found in the first image that shows the whole of it, and the images
        before are "lost".
    ignore : array_like, optional
        (h, w), True where the images are not to be used.
    device : str or torch.device, optional
        Where to compute; by default where the images are, or the CPU.
    refine : bool
        Fit a given circle to the image's edges first.
    in_place : bool
        The ball turns without leaving its place (in a bearing, on an air cushion): one position holds for the whole
        recording, and the rotations are the likeliest at that position. A ball whose outline stays while the steps
        add up to a path is recognised and held so by itself; `Track.warnings` says so.
    telecentric : bool
        The lens sees the ball from the same side wherever it is, as if from infinitely far away. Without this and
        without a ``camera``, a step sideways and a turn look alike as far as the camera's distance is not known: the
        map finds the distance of a ball that turns, and ``sd_steady`` holds what is not known of it.
    sphere_map : bool, optional
        Take every pose from a map of the ball's texture, which is made from the recording itself, the outline
        included: no drift, and about twice the precision of steps from frame to frame. By default a map is made of
        every textured ball in six frames or more. Where the images do not allow a map, nothing changes and ``findings``
        says why.
    exposure : float, optional
        Exposure over the time between frames, 0 to 1, by which a moving ball is smeared in each image: the map is
        smeared alike. By default it follows from the recording's ``exposure_s`` and ``frame_rate``, and where these are
        not known or the outlines contradict them (flashes), from the smear of the outline of a ball that moves by 2 px
        per frame or more.
    progress : callable, optional
        Called as ``progress(done, total)`` with numbers of frames; once more from 0 while a map of the ball is made.
    watch : callable, optional
        Called as ``watch(record, done)`` while the ball is followed, with a `torchsphere.tracking.record.Record` whose
        first ``done`` frames are filled. An exception of ``progress`` or ``watch`` ends the measurement.
    dtype : torch.dtype
        ``torch.float32`` or ``torch.float64``.
    first_frame : int
        Number of the first image in the whole recording, by which the warnings name frames and times count.
    frames : tuple of int or slice, optional
        Measure frames A to B - 1 only, by (A, B), as ``--frames A:B``; `circle` is then the outline in frame A.
    frame_rate, diameter_m, m_per_px, mass_kg : float, optional
        Frames per second, the ball's diameter or the size of a pixel, m, and its mass, kg. They are carried by
        `Track.calibration` to `kinematics` and `impact`. By default the frame rate is the recording's.
    pixel_aspect : float, optional
        Width of a pixel over its height, where the images have other than square pixels. They are measured as a player
        shows them, enlarged to square pixels: circle, mask, camera and positions are in these. By default as a
        recording states it.
    bayer : str, optional
        Colours of the 2 x 2 pixels of a raw colour mosaic, row by row: "RGGB", "BGGR", "GRBG" or "GBRG". The green
        pixels are measured.
    map : str, optional
        "auto", "on" or "off", as ``--map``: another name for `sphere_map` None, True or False.
    log : bool
        Hand each of `Track.warnings` to the logger ``torchsphere``, too, at the level WARNING.
    **options
        Fields of `torchsphere.correlation.options.Options`: ``model``, ``camera``, ``roi``, ``pre_blur`` ... With a
        camera and no model, the model is `pinhole`. Also names of the command line: ``fps``, ``diameter_mm``,
        ``mm_per_px``, ``mass_g``, ``shutter_us`` for the exposure, and ``focal_px``, ``distance_mm``,
        ``principal_px``, ``distortion`` for the camera.

    Returns
    -------
    Track

    Raises
    ------
    ValueError
        If there are fewer than two images, no ball is found or nothing proves it to be one, the circle does not fit
        the image, or an option is out of its range.
    TypeError
        If there is no such option.
    """
    require_switch("refine", refine)
    require_switch("in_place", in_place)
    require_switch("telecentric", telecentric)
    require_switch("sphere_map", sphere_map, "True, False or None")
    sphere_map = arguments.sphere_map(sphere_map, map)
    own = {"frame_rate": frame_rate, "diameter_m": diameter_m, "m_per_px": m_per_px, "mass_kg": mass_kg}
    calibration, notes = arguments.calibration(recording, own, options)
    options = arguments.with_camera(options, calibration.diameter_m)
    exposure = arguments.given_exposure(exposure, options.pop("shutter_us", None), calibration.frame_rate)
    settings = options_for(track, options)
    if telecentric and settings.camera is not None:
        raise ValueError("telecentric: a camera with a focal length or a distance is not telecentric; give one of both")
    stated = _stated_exposure(recording)
    device = getattr(recording, "device", None) if device is None else device
    recording = arguments.as_shown(recording, pixel_aspect, bayer)
    part, start = arguments.part_of(recording, frames)
    source = Source.open(part, device, dtype).standardised()
    first_image = source.images(0, 1)
    facts = Facts.of(recording, (len(recording), *first_image.shape[-2:]))
    mask = None if ignore is None else as_mask(ignore, first_image)
    task = Task(source, circle, mask, refine, in_place, telecentric, sphere_map, exposure, stated)
    task = dataclasses.replace(task, progress=progress, watch=watch)
    with arguments.doubts_told(recording):
        found, evidence = phases.run(task, settings, options)
        steps.tell("checking the result against the images")
        known: dict[str, Any] = {"calibration": calibration, "first_frame": first_frame + start, "facts": facts}
        found = dataclasses.replace(found, times=getattr(part, "times", None), **known)
        found = ledger.applied(found, evidence)
        if circle is None:
            _require_ball(found)
    found = dataclasses.replace(found, warnings=(*ledger.sentences(found, evidence), *notes))
    if log:
        warning_levels.log(found.warnings)
    return found


def _require_ball(found: Track) -> None:
    """Raise ValueError if nothing proves the circle that was found to be a ball."""
    known = found.findings
    lack = lacking_proof(
        found.circle,
        is_proven=known.proves_ball,
        outline_scatter=known.outline_scatter,
        untried_frames=known.untried_frames,
    )
    require_proof(found.circle, lack)


def _stated_exposure(recording: Any) -> float | None:
    """Exposure over the time between frames as the recording states it; None where it does not."""
    exposure, rate = (getattr(recording, name, None) for name in ("exposure_s", "frame_rate"))
    return None if exposure is None or rate is None else min(max(exposure * rate, 0.0), 1.0)


def track_many(
    recordings: Sequence[Any], circles: Sequence[Any] | None = None, **settings: Any
) -> list[Track | Exception]:
    """`track` for several recordings, one after the other; one that fails does not end the rest.

    Parameters
    ----------
    recordings : sequence
        Each as for `track`.
    circles : sequence, optional
        One for each recording, as for `track`; by default they are found.
    **settings
        Arguments of `track`, the same for all recordings.

    Returns
    -------
    list of Track or Exception
        In the order of the recordings; in place of a track the error that `track` raised.

    Raises
    ------
    ValueError
        If there is not one circle per recording.
    """
    given = [None] * len(recordings) if circles is None else list(circles)
    if len(given) != len(recordings):
        raise ValueError(f"circles: expected one for each of {len(recordings)} recordings, got {len(given)}")
    tracks: list[Track | Exception] = []
    for recording, circle in zip(recordings, given, strict=True):
        try:
            tracks.append(track(recording, circle, **settings))
        except Exception as error:
            tracks.append(error)
    return tracks
