"""The phases of `track`: initial circle -> follow from frame to frame -> absolute poses -> assemble.

Some phases are run again: with another model, on another path or with another radius, where the images say so.
"""

from __future__ import annotations

import dataclasses
import logging
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from torch import Tensor

from torchsphere.correlation.frame_status import ALL_KNOWN, TRANSLATION_KNOWN
from torchsphere.correlation.options import Options
from torchsphere.detection.ball_or_not import needs_proof, require_ball, shows_outline
from torchsphere.errors.edge_leakage import adapt_options, background_contrast
from torchsphere.errors.evidence import Evidence
from torchsphere.errors.steady_error import texture_fineness
from torchsphere.geometry.circle import Circle
from torchsphere.imaging import interlacing
from torchsphere.imaging.colour_mosaic import without_mosaic
from torchsphere.motion.findings import Findings, Place
from torchsphere.motion.track import Track
from torchsphere.runtime import steps
from torchsphere.sphere_map.decision import MIN_FRAMES, MadeMap
from torchsphere.tracking import growth, slipped_path
from torchsphere.tracking import in_place as place_of_ball
from torchsphere.tracking.drift import AbsoluteMotion, absolute_motion
from torchsphere.tracking.follow import Follower
from torchsphere.tracking.in_place import CommonLimb
from torchsphere.tracking.initial_circle import find_initial_circle, is_interlaced
from torchsphere.tracking.record import Record
from torchsphere.tracking.task import Task

_LOG = logging.getLogger("torchsphere")

#: Change of the radius by the map, as a share of it, from which failed frames are tried again (docs/constants.toml).
WRONG_RADIUS = 0.004

#: Pairs by which a circle in doubt is tested, and share of these that must be measured (docs/constants.toml).
TRIAL_PAIRS, TRIAL_SHARE = 12, 0.25

#: Failed searches over rotations after which the rest of these pairs is tried without (docs/constants.toml).
TRIAL_SEARCHES = 2


@dataclass(frozen=True)
class _Start:
    """Result of the first phase."""

    circle: Circle
    image: Tensor  # grey levels (h, w) of the circle's frame
    contrast: float  # of the background against the ball, see `background_contrast`
    options: Options  # adapted to the ball
    given: frozenset[str] = frozenset()  # names of the options that were given, not adapted
    grows: bool = False  # whether the ball comes nearer or goes away, which nobody said
    interlaced: bool = False  # whether only the even rows are used, as the others show another instant
    mosaic: tuple[str, ...] = ()  # colour mosaics that the images may be, of which only the green pixels are used

    @property
    def is_camera_assumed(self) -> bool:
        """Whether the camera was not given: a ball that grows is followed with one that is far away."""
        return self.grows and "camera" not in self.given


class Assembled(NamedTuple):
    """A track without the errors of the ledger, and what these are found by."""

    track: Track
    evidence: Evidence


def run(task: Task, settings: Options, given: dict[str, Any]) -> Assembled:
    """All phases. Options that were ``given`` are not adapted to the ball."""
    source, mosaic = without_mosaic(task.source)
    task = dataclasses.replace(task, source=source)
    start = dataclasses.replace(_initial_circle(task, settings, given), mosaic=mosaic)
    if is_interlaced(task.source, start.circle):
        task = dataclasses.replace(task, source=task.source.changed(interlacing.of_even_rows))
        start = dataclasses.replace(_initial_circle(task, settings, given), mosaic=mosaic, interlaced=True)
    require_ball(start.circle)
    return _measured_in_place(task, start) if task.in_place else _measured(task, start)


def _measured(task: Task, start: _Start) -> Assembled:
    """Phases 2 to 4; a ball that turns in its place is recognised and measured again as such."""
    start, measured, motion = _motion(task, start)
    free = _assemble(task, start, measured, motion)
    limb = place_of_ball.limb_of_turning(motion, lambda: _common_limb(task, start))
    if limb is None:
        return free
    held = _measured_in_place(dataclasses.replace(task, in_place=True), start, limb)
    return held if place_of_ball.is_measured_as_well(held.track.status, free.track.status) else free


def _measured_in_place(task: Task, start: _Start, limb: CommonLimb | None = None) -> Assembled:
    """Phases 2 to 4 for a ball in its place; with a ``limb`` it was recognised, and nobody said so."""
    recognised = limb is not None
    limb = limb or _common_limb(task, start)
    begun = dataclasses.replace(start, circle=place_of_ball.circle_in_place(start.circle, limb))
    begun, measured, motion = _motion(task, begun)
    motion, drift = place_of_ball.held(motion)
    track, evidence = _assemble(task, begun, measured, motion)
    if limb is not None and limb.stays:
        evidence = dataclasses.replace(evidence, unseen_step_px=tuple(place_of_ball.sd_unseen_step(limb)))
    place = Place(
        recognised=recognised,
        steps_sum_px=(float(drift[0]), float(drift[1])),
        first_radius_px=start.circle.radius,
        limbs=None if limb is None else len(limb.frames),
        limbs_stay=limb is not None and limb.stays,
        limbs_radius_px=math.nan if limb is None else float(limb.circle[2]),
        limbs_sd_px=() if limb is None else tuple(limb.sd.tolist()),
    )
    track = dataclasses.replace(track, findings=dataclasses.replace(track.findings, place=place))
    return Assembled(track, evidence)


def _common_limb(task: Task, start: _Start) -> CommonLimb | None:
    return place_of_ball.common_limb(task.source, start.circle, task.ignore, start.options.camera)


def _motion(task: Task, start: _Start) -> tuple[_Start, Record, AbsoluteMotion]:
    """Phases 2 and 3, and the start that they had at last."""
    start, measured = _follow_as_it_grows(task, start)
    measured, motion = _placed(task, start, measured)
    change = abs(motion.circle.radius - start.circle.radius)
    if change > WRONG_RADIUS * start.circle.radius and not measured.is_ok.all():
        # Frames failed with a radius that the map has corrected since.
        begun = dataclasses.replace(start, circle=dataclasses.replace(motion.circle, frame=start.circle.frame))
        again = _follow(task, begun)
        if _measures_more(again, measured):
            again, placed = _placed(task, begun, again)
            # A path that slips again loses the frames that it had won.
            if _measures_more(again, measured):
                return begun, again, placed
    return start, measured, motion


def _measures_more(record: Record, other: Record) -> bool:
    """Whether a record has more frames that are "ok" than another."""
    return bool(record.is_ok.sum() > other.is_ok.sum())


def _placed(task: Task, start: _Start, measured: Record) -> tuple[Record, AbsoluteMotion]:
    """Phase 3, and the record, on the limbs where the ``measured`` path has slipped."""
    motion = _absolute_motion(task, start, measured)
    if task.in_place:
        return measured, motion
    if motion.is_refused or motion.lacks_frames:
        measured, motion = _moved_to_limbs(task, start, measured, motion)
    return _without_frames_beside(task, start, measured, motion)


def _moved_to_limbs(
    task: Task, start: _Start, measured: Record, motion: AbsoluteMotion
) -> tuple[Record, AbsoluteMotion]:
    """Phases 2 and 3 on a path that follows the limbs, where the ``measured`` one has slipped."""
    limbs = slipped_path.limbs_of(task.source, measured, task.ignore, start.options.camera)
    if not slipped_path.have_slipped(limbs):
        if motion.is_refused:
            # Outlines that contradict each other are not those of a ball: `ball_or_not.lacking_proof`.
            motion = dataclasses.replace(motion, outline_scatter=growth.scatter_of_limbs(limbs))
        return measured, motion
    moved = slipped_path.along_limbs(task.source, measured, limbs, task.ignore, start.options, resized=False)
    again = _absolute_motion(task, start, moved)
    # An object in front of the ball moves its limbs, too: then the map shows no more frames than before.
    if again.frames_on_map > motion.frames_on_map:
        # Where a path has slipped, only the map shows that the rest of it is the ball's.
        return moved.without(~again.on_map), again.on_map_alone()
    if not motion.is_refused:
        return measured, motion
    if np.isfinite(again.orientation[:, 0, 0]).sum() >= MIN_FRAMES:
        return moved, again
    kept = measured.without(slice(slipped_path.slipped_from(limbs), None))
    return kept, _absolute_motion(task, start, kept)


def _without_frames_beside(
    task: Task, start: _Start, measured: Record, motion: AbsoluteMotion
) -> tuple[Record, AbsoluteMotion]:
    """Phases 2 and 3 without frames that the map does not show and whose limbs lie beside their positions.

    A path that was lost may have been found again beside the ball, and slips on.
    """
    unproven = np.isfinite(motion.position[:, 0]) & ~motion.on_map
    if not (isinstance(motion.map, MadeMap) and unproven.any()):
        return measured, motion
    seen = measured.without(~unproven)
    limbs = slipped_path.limbs_of(task.source, seen, task.ignore, start.options.camera)
    beside = slipped_path.runs_beside(limbs, motion.position, unproven)
    if not beside.any():
        return measured, motion
    # The map is made anew: frames beside the ball may be among its keyframes.
    kept = measured.without(beside)
    return kept, _absolute_motion(task, start, kept)


def _initial_circle(task: Task, settings: Options, given: dict[str, Any]) -> _Start:
    """Phase 1: find or check the circle, and adapt the options to the ball; options that were ``given`` stay."""
    circle, settings = find_initial_circle(task.source, task.circle, task.ignore, task.refine, settings)
    image = task.source.images(circle.frame, circle.frame + 1)[0]
    contrast = background_contrast(image, circle, task.ignore)
    options = adapt_options(settings, given, circle.radius, contrast)
    return _Start(circle, image, contrast, options, frozenset(given))


def _follow_as_it_grows(task: Task, start: _Start) -> tuple[_Start, Record]:
    """Phase 2, and the start with the model that it had at last: a ball whose image grows is followed again."""
    measured = _follow(task, start)
    if task.in_place or start.grows or start.options.model not in growth.RIGID_MODELS:
        return start, measured
    camera, options = start.options.camera, growth.growing(start.options, start.circle.radius, start.image)
    growing = dataclasses.replace(start, options=options, grows=True)
    limbs = slipped_path.limbs_of(task.source, measured, task.ignore, camera)
    # Where hardly any frame was measured, a few pairs must show that the growth is why.
    is_hidden = growth.hides_growth(measured) and _failed_trial(task, growing) is None
    if not (is_hidden or growth.may_grow(limbs)):
        return start, measured
    followed = _follow(task, growing)
    limbs = slipped_path.limbs_of(task.source, followed, task.ignore, camera)
    if not growth.limbs_follow(limbs, followed):
        return start, measured
    return growing, slipped_path.along_limbs(task.source, followed, limbs, task.ignore, options, resized=True)


def _follow(task: Task, start: _Start) -> Record:
    """Phase 2: the motion from frame to frame."""
    first, options = start.circle, start.options
    is_seen = task.circle is None or shows_outline(start.image, first, options.camera)
    measured = None
    if first.doubt or not is_seen:
        steps.tell("testing the circle %s px, which its image leaves in doubt", first.text())
        measured = _failed_trial(task, start)
    if measured is None:
        _LOG.info("following the circle %s px of frame %d with the model %s", first.text(), first.frame, options.model)
        calls: dict[str, Any] = {"progress": task.progress, "watch": task.watch}
        follower = Follower(task.source, first, task.ignore, options, in_place=task.in_place, **calls)
        measured = follower.run(task.source.count)
    if not is_seen and not measured.is_confirmed(first.frame):
        # Neither its own image nor any other supports the given circle.
        measured = measured.without(first.frame)
    return measured.without_rotation() if options.model == "translation" else measured


def _failed_trial(task: Task, start: _Start) -> Record | None:
    """The record of a few pairs after a start in doubt, if hardly one of these was measured; else None.

    Each frame that fails takes a search: a circle that no image supports is not looked for in all of them.
    """
    first, count = start.circle, task.source.count
    stop = min(first.frame + 1 + TRIAL_PAIRS, count)
    follower = Follower(task.source, first, task.ignore, start.options, in_place=task.in_place, searches=TRIAL_SEARCHES)
    measured = follower.run(stop)
    tried = measured.status[first.frame + 1 : stop]
    # A map proves a circle that was found, and needs its texture; a lamp has an outline, too.
    needs_texture = task.circle is None and not task.in_place and needs_proof(first)
    if np.isin(tried, ALL_KNOWN if needs_texture else TRANSLATION_KNOWN).sum() >= TRIAL_SHARE * len(tried):
        return None
    return dataclasses.replace(measured, untried=count - stop)


def _absolute_motion(task: Task, start: _Start, measured: Record) -> AbsoluteMotion:
    """Phase 3: the poses on a map of the ball where a map is made, else the sum of the increments."""
    _LOG.info("followed: %d of %d frames are ok", int(measured.is_ok.sum()), len(measured.status))
    fineness = texture_fineness(start.image, start.circle, task.ignore)
    camera = None if start.is_camera_assumed else start.options.camera
    return absolute_motion(task, measured, start.circle, start.options, fineness, camera)


def _assemble(task: Task, start: _Start, measured: Record, motion: AbsoluteMotion) -> Assembled:
    """Phase 4: the track, and what its errors are found by."""
    grows = start.grows and not (isinstance(motion.map, MadeMap) and not growth.grows_on_map(motion.radius))
    track = Track(
        position=motion.position,
        increment=motion.increment,
        covariance=motion.covariance,
        orientation=motion.orientation,
        zncc=measured.zncc,
        iterations=measured.iterations,
        status=measured.status,
        radius=motion.radius,
        sd_growth=motion.sd_growth,
        sd_steady=np.zeros(5),
        circle=motion.circle,
        settings=dataclasses.asdict(start.options)
        | {
            "circle_given": task.circle is not None,
            "circle_refined": task.circle is None or task.refine,
            "in_place": task.in_place,
            "telecentric": task.telecentric,
            "device": str(task.source.device),
            "dtype": str(task.source.dtype).removeprefix("torch."),
        },
        findings=Findings(
            map=motion.map,
            grows=grows,
            camera_assumed=start.is_camera_assumed,
            interlaced=start.interlaced,
            mosaic=start.mosaic,
            repeated_frames=tuple(measured.repeated),
            untried_frames=measured.untried,
            outline_scatter=motion.outline_scatter,
        ),
    )
    evidence = Evidence(
        source=task.source,
        ignore=task.ignore,
        image=start.image,
        contrast=start.contrast,
        options=start.options,
        given=start.given,
        exposure=task.stated_exposure if task.exposure is None else task.exposure,
        position=motion.position,
        circle=motion.circle,
        on_map=motion.on_map,
        uneven_light=measured.uneven_share,
        residual_factors=motion.residual_factors,
    )
    return Assembled(track, evidence)
