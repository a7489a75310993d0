"""What is measured again, and what is kept: one loop with one score.

A hypothesis is a start or a record that differs from the best one so far: the ball turns in its place, the path follows
the limbs, frames beside the ball are none, the radius is that of the map. Each is measured by the same steps - follow,
place on a map - and that one is kept which explains more of the images. Whether the ball comes nearer is found before,
as it decides by which model pairs are measured at all (`growth`).
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchsphere.detection.limbs import Limbs
from torchsphere.errors.steady_error import texture_fineness
from torchsphere.runtime.steps import LOG
from torchsphere.sphere_map.decision import MadeMap
from torchsphere.tracking import growth, in_place, slipped_path
from torchsphere.tracking.absolute_motion import AbsoluteMotion, absolute_motion
from torchsphere.tracking.first_pass import follow
from torchsphere.tracking.growth import Followed, follow_as_it_grows
from torchsphere.tracking.in_place import MIN_KEPT_SHARE, CommonLimb
from torchsphere.tracking.record import Record
from torchsphere.tracking.start import Start
from torchsphere.tracking.task import Task

#: Maps that a recording may take: two hypotheses besides the first (docs/constants.toml).
MAX_MAPS = 3

#: Change of the radius by the map, as a share of it, from which failed frames are tried again (docs/constants.toml).
WRONG_RADIUS = 0.004


@dataclass(frozen=True)
class Place:
    """A ball that is held in its place."""

    limb: CommonLimb | None  # of many frames; None where too few show one
    first_radius_px: float  # before the limb gave its own
    is_recognised: bool  # from the images: nobody said that it stays
    is_limbs_radius_used: bool


@dataclass(frozen=True)
class Hypothesis:
    """What may explain more of the images than the best result so far."""

    task: Task
    start: Start
    place: Place | None = None
    record: Record | None = None  # measured already, along the limbs or in part; else the ball is followed anew
    is_along_limbs: bool = False
    kept_from: float = 1.0  # it must score more than this share of the best
    is_certain: bool = False  # what contradicts the images goes, whatever else they show

    def beats(self, score: int, best: int) -> bool:
        """Whether a ``score``, or the largest one possible, is enough against the ``best``."""
        return self.is_certain or score > self.kept_from * best


@dataclass(frozen=True)
class Outcome:
    """A hypothesis that was measured: what it shows of the images."""

    task: Task
    start: Start
    record: Record
    motion: AbsoluteMotion
    place: Place | None = None
    is_along_limbs: bool = False
    known_limbs: Limbs | None = None

    @functools.cached_property
    def limbs(self) -> Limbs:
        """The limbs along the path."""
        return self.known_limbs or slipped_path.limbs_along(self.task, self.start, self.record)

    @property
    def outline_scatter(self) -> float:
        """Relative scatter of the outlines' radii where a map was refused: outlines of a ball agree with each other."""
        if not self.motion.is_refused or self.place is not None or slipped_path.have_slipped(self.limbs):
            return 0.0
        return growth.scatter_of_limbs(self.limbs)

    @functools.cached_property
    def has_slipped(self) -> bool:
        """Whether the path lies beside its limbs at last, and too few of its frames are on a map."""
        is_doubtful = self.motion.is_refused or self.motion.lacks_frames
        return is_doubtful and self.place is None and not self.is_along_limbs and slipped_path.have_slipped(self.limbs)

    @functools.cached_property
    def beside(self) -> NDArray[np.bool_]:
        """Frames (n,) that lie beside the ball by their limbs, and that no map shows.

        A path that was lost may have been found again beside the ball, and slips on.
        """
        position, on_map = self.motion.position, self.motion.on_map
        nowhere, unproven = np.zeros_like(on_map), np.isfinite(position[:, 0]) & ~on_map
        if self.place is not None or not unproven.any():
            return nowhere
        if isinstance(self.motion.map, MadeMap):
            limbs = slipped_path.limbs_along(self.task, self.start, self.record.without(~unproven))
            return slipped_path.runs_beside(limbs, position, unproven)
        if self.has_slipped:
            nowhere[slipped_path.slipped_from(self.limbs) :] = True
        return nowhere

    @functools.cached_property
    def score(self) -> int:
        """How much of the images it explains: frames that were measured and not beside the ball, and those on a map."""
        on_map = self.motion.on_map
        return int((on_map | (self.record.is_ok & ~self.beside)).sum() + on_map.sum())

    def without_frames_beside(self) -> Outcome:
        """The outcome without frames beside the ball that are left where no further map was made."""
        if not self.beside.any():
            return self
        record, motion = self.record.without(self.beside), self.motion.only(~self.beside)
        return dataclasses.replace(self, record=record, motion=motion)


#: Looks at the best outcome, and suggests what may be better.
Proposal = Callable[[Outcome], Hypothesis | None]


def best_outcome(task: Task, start: Start) -> Outcome:
    """What explains most of the images, among the first hypothesis and those that its result suggests."""
    place = None
    if task.in_place:
        start, place = _held(task, start, in_place.common_limb(task, start), is_recognised=False)
    best = _placed(Hypothesis(task, start, place), follow_as_it_grows(task, start))
    untried, maps = list(PROPOSALS), 1
    while maps < MAX_MAPS and (hypothesis := _next_hypothesis(untried, best)):
        followed = _followed(hypothesis)
        # A record that could not win with all of its frames on a map needs none.
        if hypothesis.beats(2 * int(followed.record.is_ok.sum()), best.score):
            found, maps = _placed(hypothesis, followed), maps + 1
            best = found if hypothesis.beats(found.score, best.score) else best
    return best.without_frames_beside()


def _next_hypothesis(untried: list[Proposal], best: Outcome) -> Hypothesis | None:
    """The first that the best result suggests; its proposal is taken from the ``untried`` ones."""
    for propose in untried:
        hypothesis = propose(best)
        if hypothesis is not None:
            untried.remove(propose)
            return hypothesis
    return None


def _turning_in_place(best: Outcome) -> Hypothesis | None:
    """A ball that turns without leaving its place: a wrong radius or a near camera makes a path of the rotation."""
    if best.place is not None:
        return None
    limb = in_place.limb_of_turning(best.motion, lambda: in_place.common_limb(best.task, best.start))
    if limb is None:
        return None
    task = dataclasses.replace(best.task, in_place=True)
    start, place = _held(task, best.start, limb, is_recognised=True)
    # A frame more or less that fails is chance; a ball that flies fails in most.
    return Hypothesis(task, start, place, kept_from=MIN_KEPT_SHARE)


def _along_limbs(best: Outcome) -> Hypothesis | None:
    """The path on the limbs: only there a path that has slipped may be the ball's."""
    if not best.has_slipped:
        return None
    moved = slipped_path.along_limbs(best.task, best.start, best.record, best.limbs, resized=False)
    return Hypothesis(best.task, best.start, record=moved, is_along_limbs=True)


def _without_frames_beside(best: Outcome) -> Hypothesis | None:
    """The record without what lies beside the ball; the map is made anew, as keyframes may be among it."""
    if not best.beside.any():
        return None
    return Hypothesis(best.task, best.start, best.place, best.record.without(best.beside), is_certain=True)


def _radius_of_map(best: Outcome) -> Hypothesis | None:
    """The radius that the map has corrected, where frames failed with another."""
    radius = best.start.circle.radius
    is_wrong = abs(best.motion.circle.radius - radius) > WRONG_RADIUS * radius
    if not is_wrong or best.record.is_ok.all():
        return None
    return Hypothesis(best.task, best.start.at(best.motion.circle), best.place)


#: What may be tried, each once: the first that the best result suggests comes first.
PROPOSALS: tuple[Proposal, ...] = (
    _turning_in_place,
    _along_limbs,
    _without_frames_beside,
    _radius_of_map,
)


def _held(task: Task, start: Start, limb: CommonLimb | None, *, is_recognised: bool) -> tuple[Start, Place]:
    """The start of a ball that is held in its place, by the limb of many frames."""
    circle, first = in_place.circle_in_place(start.circle, limb), start.circle.radius
    return dataclasses.replace(start, circle=circle), Place(limb, first, is_recognised, circle.radius != first)


def _followed(hypothesis: Hypothesis) -> Followed:
    """The motion from frame to frame of a hypothesis."""
    start, record = hypothesis.start, hypothesis.record
    return Followed(start, follow(hypothesis.task, start) if record is None else record)


def _placed(hypothesis: Hypothesis, followed: Followed) -> Outcome:
    """The outcome of a hypothesis, with the poses on a map of the ball where one is made."""
    task, (start, record, limbs) = hypothesis.task, followed
    LOG.info("followed: %d of %d frames are ok", int(record.is_ok.sum()), len(record.status))
    fineness = texture_fineness(start.image, start.circle, task.ignore)
    motion = absolute_motion(task, record, start.circle, start.options, fineness, start.known_camera)
    if hypothesis.is_along_limbs and isinstance(motion.map, MadeMap):
        # Where a path has slipped, only the map shows that the rest of it is the ball's.
        record, motion = record.without(~motion.on_map), motion.only(motion.on_map)
    return Outcome(task, start, record, motion, hypothesis.place, hypothesis.is_along_limbs, limbs)
