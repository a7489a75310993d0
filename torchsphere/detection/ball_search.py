"""Find the ball in a recording: candidates in some frames -> outline all round -> motion.

A circle is a ball if its outline is there all round (`outline_arcs`), and if it moves against what is still or its
texture turns (`ball_motion`). Where no frame shows such a circle, the best one is given with its doubt.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from torchsphere.detection.ball_motion import MAX_RADIUS_CHANGE, Disc, step_of_ball
from torchsphere.detection.candidates import MIN_PART, OTHER_SCORE, Candidate, candidates_in, others, within
from torchsphere.detection.detect import as_circle, as_values, at_limb
from torchsphere.detection.outline_arcs import Arcs
from torchsphere.detection.scene import Scene
from torchsphere.detection.silhouette import Images
from torchsphere.geometry.circle import Circle
from torchsphere.settings.limits import SettingError

#: Largest number of frames in which the ball is searched, and those of them at the start of the recording.
MAX_TRIES, HEAD = 40, 8

#: Outlines in doubt, of each kind, whose motion is looked at where no other moves as a ball.
MAX_DOUBTFUL = 4

#: Outlines of one size that are looked at: a thing on the wall is elsewhere in each image of a camera held by hand.
MAX_JUDGED = 4

#: Largest distance of an earlier outline of the ball from its path, radii (docs/constants.toml).
NEAR_PATH = 0.25

#: Reasons of a doubt.
NOT_ROUND = "its outline is not there all round"
NO_MOTION = "it neither moves against what surrounds it nor turns as a ball does"
ONE_FRAME = "one frame does not show whether it moves or turns"


@dataclass(frozen=True)
class _Outline:
    """A candidate with its circle at the limb."""

    candidate: Candidate
    among: list[Candidate]  # all of its frame
    circle: Circle
    arcs: Arcs

    @property
    def disc(self) -> Disc:
        """The disc whose motion is looked at."""
        circle = self.circle
        x, y, _ = self.candidate.fit.covariance[0].diagonal().tolist()
        variance = x + y if circle.sd_guessed else circle.sd_x**2 + circle.sd_y**2
        return Disc(as_values(circle), circle.frame, self.candidate.plain, variance)

    def is_like(self, other: _Outline) -> bool:
        """Whether both are one object, where it does not move."""
        return _are_alike(as_values(self.circle), as_values(other.circle))

    def has_size_of(self, other: _Outline) -> bool:
        """Whether both have one radius."""
        return abs(self.circle.radius / other.circle.radius - 1) < MAX_RADIUS_CHANGE


def _are_alike(one: Tensor, other: Tensor) -> bool:
    """Whether two circles (3,) are one to a small share of the radius."""
    return bool(((one - other).abs() < MAX_RADIUS_CHANGE * other[2]).all())


def find(images: Images, count: int, ignore: Tensor | None = None) -> Circle:
    """The circle of the ball in the first of ``count`` frames in which it is wholly in view; raises without one.

    Where nothing shows that a circle is a ball's, `Circle.unproven` says why. ``ignore`` (h, w): True where the images
    are not to be used.
    """
    scene = Scene.of(images, count, ignore)
    found = _Found([], [], [])
    tried: list[int] = []
    for frame in _frames_to_try(count):
        for outline in _outlines(scene, frame):
            if found.has(outline):
                continue
            kind = found.kind_of(outline)
            step = step_of_ball(scene, outline.disc) if kind is found.whole else None
            if step is not None:
                before = max((other for other in tried if other < frame), default=-1)
                return _with_others(scene, _first_view(scene, _on_path(kind, outline, step) or outline, step, before))
            kind.append(outline)
        tried.append(frame)
    ball = _rough_ball(scene, found.rough) or _turning_part(scene, found.partial)
    if ball is not None:
        return _with_others(scene, ball)
    still = NO_MOTION if count > 1 else ONE_FRAME
    for outlines, reason in ((found.whole, still), (found.rough, still), (found.partial, NOT_ROUND)):
        if outlines:
            best = max(outlines, key=lambda outline: outline.candidate.score)
            return dataclasses.replace(best.circle, unproven=reason)
    raise SettingError(_no_ball(count, ignore))


@dataclass(frozen=True)
class _Found:
    """Outlines that are not a ball's as far as is known; the lists are filled one by one."""

    whole: list[_Outline]  # all round
    rough: list[_Outline]  # all round, but small or not exact
    partial: list[_Outline]

    def kind_of(self, outline: _Outline) -> list[_Outline]:
        """The list for an outline."""
        if not outline.arcs.are_all_round:
            return self.partial
        return self.rough if outline.circle.doubt else self.whole

    def has(self, outline: _Outline) -> bool:
        """Whether an outline is one of those that do not move as a ball, or has the size of several."""
        alike = [other for other in self.whole if outline.has_size_of(other)]
        return len(alike) >= MAX_JUDGED or any(outline.is_like(other) for other in alike)


def find_in_image(image: Tensor, ignore: Tensor | None = None) -> Circle | None:
    """The circle in one ``image`` (h, w) that is most like a ball's outline; None without one."""
    scene = Scene(lambda start, stop: image[None][start:stop], 1, None, ignore)
    return next((outline.circle for outline in _outlines(scene, 0)), None)


def _outlines(scene: Scene, frame: int) -> list[_Outline]:
    """The outlines in a frame that may be the ball's, those first that are there on more arcs."""
    found: list[_Outline] = []
    candidates = candidates_in(scene, frame)
    for candidate in candidates:
        if not any(_are_alike(candidate.circle, other.candidate.circle) for other in found):
            circle = _circle(scene, candidate, frame)
            found.append(_Outline(candidate, candidates, circle, scene.arcs(frame, as_values(circle))))
    return sorted(found, key=lambda outline: (-outline.arcs.share, -outline.candidate.score))


def _circle(scene: Scene, candidate: Candidate, frame: int) -> Circle:
    """The circle of a candidate, at the limb of a speckled ball."""
    circle = as_circle(candidate.circle, candidate.fit.covariance[0], frame)
    if candidate.plain:
        return circle
    # In a view with a ghost of the ball the first fit may be off by more than the limb's fit reaches.
    near = at_limb(scene.views(frame), circle, scene.ignore)
    return near if near.sd_guessed else at_limb(scene.views(frame), near, scene.ignore)


def _with_others(scene: Scene, ball: _Outline) -> Circle:
    """The circle of the ``ball``, with other objects of its size in its frame."""
    return dataclasses.replace(ball.circle, others=others(scene, ball.circle.frame, ball.among, ball.candidate))


def _on_path(outlines: list[_Outline], ball: _Outline, step: Tensor) -> _Outline | None:
    """The first of some ``outlines`` that the ``ball`` had in earlier frames, by its ``step`` (2,) per frame, px."""
    centre, frame = as_values(ball.circle)[:2], ball.circle.frame
    for outline in outlines:
        apart = as_values(outline.circle)[:2] - (centre - (frame - outline.circle.frame) * step)
        is_near = float(apart.norm()) < NEAR_PATH * ball.circle.radius
        if outline.circle.frame < frame and outline.has_size_of(ball) and is_near:
            return outline
    return None


def _first_view(scene: Scene, ball: _Outline, step: Tensor, before: int) -> _Outline:
    """The ``ball`` in the first frame that shows the whole of it, by its ``step`` (2,) per frame, px.

    ``before`` is the last frame before it in which no outline is known to be the ball's.
    """
    while ball.circle.frame - before > 1:
        frame = (ball.circle.frame + before) // 2
        whole = (o for o in _outlines(scene, frame) if o.arcs.are_all_round and not o.circle.doubt)
        earlier = next((outline for outline in whole if outline.has_size_of(ball)), None)
        if earlier is None:
            before = frame
        else:
            ball = earlier
    # Where something else is more like a disc, the ball is not among the outlines that were found.
    while (earlier := _a_frame_before(scene, ball, step)) is not None:
        ball = earlier
    return ball


def _a_frame_before(scene: Scene, ball: _Outline, step: Tensor) -> _Outline | None:
    """The whole ball a frame before, about a ``step`` (2,), px, from where it is; None where it is not there."""
    frame = ball.circle.frame - 1
    if frame < 0 or ball.candidate.plain:
        return None
    x, y = (as_values(ball.circle)[:2] - step).tolist()
    circle = at_limb(scene.views(frame), dataclasses.replace(ball.circle, x=x, y=y, frame=frame), scene.ignore)
    found = dataclasses.replace(ball, circle=circle, arcs=scene.arcs(frame, as_values(circle)))
    # The ball is known: its outline need not be there on so many arcs again, but nothing may cover it.
    is_seen = found.arcs.share >= MIN_PART and found.arcs.are_uncovered
    is_whole = is_seen and within(as_values(circle), scene.image(frame).shape)
    return found if is_whole and not circle.doubt and found.has_size_of(ball) else None


def _rough_ball(scene: Scene, outlines: list[_Outline]) -> _Outline | None:
    """The first ball among outlines that are small or not exact; None without one."""
    best = max((outline.candidate.score for outline in outlines), default=0.0)
    likely = [outline for outline in outlines if outline.candidate.score > OTHER_SCORE * best]
    for outline in likely[:MAX_DOUBTFUL]:
        step = step_of_ball(scene, outline.disc)
        if step is not None:
            return _on_path(outlines, outline, step) or outline
    return None


def _turning_part(scene: Scene, outlines: list[_Outline]) -> _Outline | None:
    """A ball of which something hides a part in all frames, and whose texture turns; None without one."""
    likely = sorted(outlines, key=lambda outline: -outline.arcs.share)[:MAX_DOUBTFUL]
    return next((outline for outline in likely if step_of_ball(scene, outline.disc, hidden=True) is not None), None)


def _frames_to_try(count: int) -> list[int]:
    """The first frames one by one, then others: the middle, the middles of both halves, and so on."""
    if count <= MAX_TRIES:
        return list(range(count))
    rest = torch.linspace(HEAD, count - 1, MAX_TRIES - HEAD).round().long().tolist()
    # Numbers whose binary digits are reversed halve what is left.
    digits = (len(rest) - 1).bit_length()
    order = sorted(range(len(rest)), key=lambda i: f"{i:0{digits}b}"[::-1])
    return [*range(HEAD), *(rest[i] for i in order)]


def _no_ball(count: int, ignore: Tensor | None) -> str:
    """A sentence for a recording in which nothing is round."""
    ignored = 0.0 if ignore is None else 100 * float(ignore.double().mean())
    masked = f"; or correct `ignore`, which leaves out {ignored:.0f} % of the image: a mask is black where it is used"
    return (
        f"no ball was found in {count} frames: expected a round object that differs from its background, wholly in "
        "view in at least one frame; give its outline with `circle` as x, y, radius in px of the first frame to track"
        f"{masked if ignored else ''}"
    )
