"""`track`: from a recording to the ball's motion in px and rad.

Its phases are: initial circle -> follow from frame to frame -> absolute poses -> assemble.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchsphere.correlation.options import Options, options_for
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import interlacing
from torchsphere.recording.frame_source import Source
from torchsphere.runtime import threads
from torchsphere.settings.arrays import as_mask
from torchsphere.settings.limits import require_switch, require_within
from torchsphere.sphere_map.nearness import UNKNOWN_SD
from torchsphere.tracking import frame_memory, growth, limb_path
from torchsphere.tracking import in_place as place_of_ball
from torchsphere.tracking.drift import AbsoluteMotion, absolute_motion
from torchsphere.tracking.edge_leakage import adapt_options, background_contrast, leakage_share
from torchsphere.tracking.follow import Follower, Progress
from torchsphere.tracking.in_place import Limbs
from torchsphere.tracking.initial_circle import find_initial_circle, is_interlaced, shows_outline
from torchsphere.tracking.motion_warnings import motion_warnings
from torchsphere.tracking.proof import require_proof
from torchsphere.tracking.record import Record
from torchsphere.tracking.result import Track
from torchsphere.tracking.steady_error import sd_steady, texture_fineness

__all__ = ["Track", "track", "track_many"]

#: Where the warnings of a track go.
_LOG = logging.getLogger("torchsphere")

#: Change of the radius by the map, as a share of it, from which failed frames are tried again (docs/constants.md).
WRONG_RADIUS = 0.004

#: Share of the measured frames that a ball held in its place must keep (docs/constants.md).
MIN_KEPT_SHARE = 0.8


@dataclass(frozen=True)
class _Task:
    """The arguments of `track`, checked, and the exposure that the recording states."""

    source: Source
    circle: Any
    ignore: Tensor | None
    refine: bool
    in_place: bool
    telecentric: bool
    sphere_map: bool | None
    exposure: float | None
    stated_exposure: float | None
    progress: Progress | None


@dataclass(frozen=True)
class _Start:
    """Result of the first phase."""

    circle: Circle
    image: Tensor  # grey levels (h, w) of the circle's frame
    contrast: float  # of the background against the ball, see `background_contrast`
    options: Options  # adapted to the ball
    grows: bool = False  # whether the ball comes nearer or goes away, which nobody said
    interlaced: bool = False  # whether only the even rows are used, as the others show another instant


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
    dtype: torch.dtype = torch.float32,
    first_frame: int = 0,
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
        every textured ball in six frames or more. Where the images do not allow a map, nothing changes and ``settings``
        says why.
    exposure : float, optional
        Exposure over the time between frames, 0 to 1, by which a moving ball is smeared in each image: the map is
        smeared alike. By default it follows from the recording's ``exposure_s`` and ``frame_rate``, and where these are
        not known or the outlines contradict them (flashes), from the smear of the outline of a ball that moves by 2 px
        per frame or more.
    progress : callable, optional
        Called as ``progress(done, total)`` with numbers of frames; once more from 0 while a map of the ball is made.
    dtype : torch.dtype
        ``torch.float32`` or ``torch.float64``.
    first_frame : int
        Number of the first image in the whole recording, by which the warnings name frames.
    log : bool
        Hand each of `Track.warnings` to the logger ``torchsphere``, too, at the level WARNING.
    **options
        Fields of `torchsphere.correlation.options.Options`: ``model``, ``camera``, ``roi``, ``pre_blur`` ... With a
        camera and no model, the model is `pinhole`.

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
    if exposure is not None:
        require_within("exposure", exposure, (0.0, 1.0))
    settings = options_for(track, options)
    if telecentric and settings.camera is not None:
        raise ValueError("telecentric: a camera with a focal length or a distance is not telecentric; give one of both")
    source = Source.open(recording, device, dtype)
    mask = None if ignore is None else as_mask(ignore, source.images(0, 1))
    stated = _stated_exposure(recording)
    task = _Task(source, circle, mask, refine, in_place, telecentric, sphere_map, exposure, stated, progress)

    start = _initial_circle(task, settings, options)
    if is_interlaced(source, start.circle):
        task = dataclasses.replace(task, source=source.changed(interlacing.of_even_rows))
        start = dataclasses.replace(_initial_circle(task, settings, options), interlaced=True)
    found = _measured_in_place(task, start) if in_place else _measured(task, start)
    if circle is None:
        require_proof(found)
    found = dataclasses.replace(found, warnings=motion_warnings(task.source, found, first_frame, "roi" in options))
    if log:
        for sentence in found.warnings:
            _LOG.warning("%s", sentence)
    return found


def _stated_exposure(recording: Any) -> float | None:
    """Exposure over the time between frames as the recording states it; None where it does not."""
    exposure, rate = (getattr(recording, name, None) for name in ("exposure_s", "frame_rate"))
    return None if exposure is None or rate is None else min(max(exposure * rate, 0.0), 1.0)


def _measured(task: _Task, start: _Start) -> Track:
    """Phases 2 to 4; a ball that turns in its place is recognised and measured again as such."""
    start, measured, motion = _motion(task, start)
    free = _assemble(task, start, measured, motion)
    # What neither turns nor leaves its place needs no look at its outline.
    limbs = _limbs(task, start) if place_of_ball.may_turn_in_place(motion) else None
    if limbs is None or not place_of_ball.turns_in_place(motion, limbs):
        return free
    held = _measured_in_place(dataclasses.replace(task, in_place=True), start, limbs)
    # A frame more or less that fails is chance; a ball that flies fails in most.
    return held if (held.status == "ok").sum() >= MIN_KEPT_SHARE * (free.status == "ok").sum() else free


def _measured_in_place(task: _Task, start: _Start, limbs: Limbs | None = None) -> Track:
    """Phases 2 to 4 for a ball in its place; with ``limbs`` it was recognised, and nobody said so."""
    recognised = limbs is not None
    limbs = limbs or _limbs(task, start)
    begun = dataclasses.replace(start, circle=place_of_ball.circle_in_place(start.circle, limbs))
    begun, measured, motion = _motion(task, begun)
    motion, drift = place_of_ball.held(motion)
    track = _assemble(task, begun, measured, motion)
    if limbs is not None and limbs.stay:
        # A motion too slow for the limbs to show is an error that all steps share.
        unseen = place_of_ball.sd_unseen_step(limbs)
        track = dataclasses.replace(track, sd_steady=np.hypot(track.sd_steady, [*unseen, 0, 0, 0]))
    place = {
        "recognised": recognised,
        "steps_sum_px": drift.tolist(),
        "first_radius_px": start.circle.radius,
        "limbs": None if limbs is None else len(limbs.frames),
        "limbs_stay": limbs is not None and limbs.stay,
        "limbs_radius_px": None if limbs is None else float(limbs.circle[2]),
        "limbs_sd_px": None if limbs is None else limbs.sd.tolist(),
    }
    return dataclasses.replace(track, settings=track.settings | {"place": place})


def _limbs(task: _Task, start: _Start) -> Limbs | None:
    return place_of_ball.fit_limbs(task.source, start.circle, task.ignore, start.options.camera)


def _motion(task: _Task, start: _Start) -> tuple[_Start, Record, AbsoluteMotion]:
    """Phases 2 and 3, and the start that they had at last."""
    start, measured = _follow_as_it_grows(task, start)
    motion = _absolute_motion(task, start, measured)
    if (motion.is_refused or motion.lacks_frames) and not task.in_place:
        measured, motion = _moved_to_limbs(task, start, measured, motion)
    change = abs(motion.circle.radius - start.circle.radius)
    if change > WRONG_RADIUS * start.circle.radius and bool((measured.status != "ok").any()):
        # Frames failed with a radius that the map has corrected since.
        begun = dataclasses.replace(start, circle=dataclasses.replace(motion.circle, frame=start.circle.frame))
        again = _follow(task, begun)
        if (again.status == "ok").sum() > (measured.status == "ok").sum():
            start, measured = begun, again
            motion = _absolute_motion(task, start, measured)
    return start, measured, motion


def _moved_to_limbs(
    task: _Task, start: _Start, measured: Record, motion: AbsoluteMotion
) -> tuple[Record, AbsoluteMotion]:
    """Phases 2 and 3 on a path that follows the limbs, where the ``measured`` one has slipped."""
    limbs = limb_path.fit_limbs(task.source, measured, task.ignore, start.options.camera)
    if not limbs.have_slipped():
        return measured, motion
    moved = limb_path.along_limbs(task.source, measured, limbs, task.ignore, start.options, resized=False)
    again = _absolute_motion(task, start, moved)
    # An object in front of the ball moves its limbs, too: then the map shows no more frames than before.
    is_better = motion.is_refused or again.about_map.get("frames", 0) > motion.about_map["frames"]
    return (moved, again) if is_better else (measured, motion)


def _initial_circle(task: _Task, settings: Options, given: dict[str, Any]) -> _Start:
    """Phase 1: find or check the circle, and adapt the options to the ball; options that were ``given`` stay."""
    circle, settings = find_initial_circle(task.source, task.circle, task.ignore, task.refine, settings)
    image = task.source.images(circle.frame, circle.frame + 1)[0]
    contrast = background_contrast(image, circle, task.ignore)
    return _Start(circle, image, contrast, adapt_options(settings, given, circle.radius, contrast))


def _follow_as_it_grows(task: _Task, start: _Start) -> tuple[_Start, Record]:
    """Phase 2, and the start with the model that it had at last: a ball whose image grows is followed again."""
    measured = _follow(task, start)
    if task.in_place or start.grows or start.options.model not in growth.RIGID_MODELS:
        return start, measured
    camera = start.options.camera
    if not growth.may_grow(limb_path.fit_limbs(task.source, measured, task.ignore, camera)):
        return start, measured
    options = growth.growing(start.options, start.circle.radius, start.image)
    growing = dataclasses.replace(start, options=options, grows=True)
    followed = _follow(task, growing)
    limbs = limb_path.fit_limbs(task.source, followed, task.ignore, camera)
    if not growth.limbs_follow(limbs, followed):
        return start, measured
    return growing, limb_path.along_limbs(task.source, followed, limbs, task.ignore, options, resized=True)


def _follow(task: _Task, start: _Start) -> Record:
    """Phase 2: the motion from frame to frame."""
    first, options = start.circle, start.options
    follower = Follower(task.source, first, task.ignore, options, progress=task.progress, in_place=task.in_place)
    measured = follower.run(task.source.count)
    is_confirmed = measured.is_confirmed(first.frame)
    if task.circle is not None and not is_confirmed and not shows_outline(task.source, first, options):
        # Neither its own image nor any other supports the given circle.
        measured = measured.without(first.frame)
    return measured.without_rotation() if options.model == "translation" else measured


def _absolute_motion(task: _Task, start: _Start, measured: Record) -> AbsoluteMotion:
    """Phase 3: the poses on a map of the ball where a map is made, else the sum of the increments."""
    fineness = texture_fineness(start.image, start.circle, task.ignore)
    asked, options = task.sphere_map, start.options
    return absolute_motion(
        task.source,
        measured,
        start.circle,
        task.ignore,
        asked,
        options,
        fineness,
        telecentric=task.telecentric,
        exposure=task.exposure,
        stated=task.stated_exposure,
        progress=task.progress,
    )


def _assemble(task: _Task, start: _Start, measured: Record, motion: AbsoluteMotion) -> Track:
    """Phase 4: the track, its steady error and its settings."""
    radius, on_map = motion.circle.radius, motion.about_map["used"]
    memory = frame_memory.noise_memory(task.source, motion.position, radius, task.ignore)
    leakage = leakage_share(start.contrast, radius, start.options)
    steps = int(np.isfinite(measured.increment[:, 0]).sum())
    return Track(
        position=motion.position,
        increment=motion.increment,
        covariance=frame_memory.widened(motion.increment, motion.covariance, memory) if memory else motion.covariance,
        orientation=motion.orientation,
        zncc=measured.zncc,
        iterations=measured.iterations,
        status=measured.status,
        radius=measured.size * (radius / start.circle.radius),
        sd_growth=measured.sd_growth,
        sd_steady=sd_steady(
            motion.increment,
            radius,
            texture_fineness(start.image, motion.circle, task.ignore),
            on_map=on_map,
            uneven_light=int(measured.uneven_light.sum()) / max(steps, 1),
            leakage=leakage,
            sd_nearness=_sd_nearness(task, start, motion),
        ),
        circle=motion.circle,
        settings=dataclasses.asdict(start.options)
        | {
            "circle_given": task.circle is not None,
            "circle_refined": task.circle is None or task.refine,
            "in_place": task.in_place,
            "place": None,
            "telecentric": task.telecentric,
            "grows": start.grows,
            "interlaced": start.interlaced,
            "noise_memory": memory,
            "sphere_map": motion.about_map,
            "repeated_frames": measured.repeated,
            "leaked": leakage,
            "device": str(task.source.device),
            "dtype": str(task.source.dtype).removeprefix("torch."),
        },
    )


def _sd_nearness(task: _Task, start: _Start, motion: AbsoluteMotion) -> float:
    """Standard deviation of the ball's radius over the camera's distance."""
    if task.telecentric or (start.options.camera is not None and not start.grows):
        return 0.0
    return float(motion.about_map.get("sd_radius_over_distance", UNKNOWN_SD))


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
