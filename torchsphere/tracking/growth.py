"""A ball that comes nearer or goes away: its image grows or shrinks from frame to frame.

The rigid modes take a growth for motion. The course of the limb's radius shows a growth: its error does not add up over
the frames. The rigid modes put a ball that grows fast beside its limb, so that the radii scatter. In both cases the
recording is followed with the model `pinhole6`, and the growth is believed if limbs and sizes along the new path agree.
On the map of such a ball the radius in each image is an unknown.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from torchsphere.detection.limbs import Limbs
from torchsphere.geometry.camera import Camera
from torchsphere.runtime.arrays import Array
from torchsphere.sphere_map.decision import MadeMap, NoMap
from torchsphere.tracking.first_pass import failed_trial, follow
from torchsphere.tracking.record import Record
from torchsphere.tracking.slipped_path import MIN_LOOKS, along_limbs, limbs_along
from torchsphere.tracking.start import Start
from torchsphere.tracking.task import Task

#: Growth over its standard deviation that is significant (docs/constants.toml).
SIGNIFICANT_SD = 6.0

#: Degree of the course of the radius in time: one that an impact turns needs two (docs/constants.toml).
DEGREE = 3

#: Relative scatter of the limbs' radii from which they may lie beside the ball (docs/constants.toml).
SUSPECT_SCATTER = 0.01

#: Ratio up to which the growths by limbs and by pairs, whose errors add up, are the same (docs/constants.toml).
SAME_GROWTH = 2.0

#: Change of the radius on the map, relative, from which the ball does grow: what limbs took for a growth may have been
#: a lens (docs/constants.toml).
LEAST_GROWTH = 0.003

#: Motion models that a growth spoils.
RIGID_MODELS = ("rigid", "finite", "pinhole")

#: Distance of a camera without perspective, radii (docs/constants.toml).
FAR_RADII = 1000.0


@dataclass(frozen=True)
class Growth:
    """Course of the relative radius of the ball's image."""

    course: Array  # coefficients (d,) of polynomials in time that are normal to each other and to a constant
    sd: float  # standard deviation of each
    scatter: float  # of the radii about the course, relative

    @property
    def is_significant(self) -> bool:
        """Whether the growth is no chance."""
        return bool(np.abs(self.course).max() > SIGNIFICANT_SD * self.sd)


class Followed(NamedTuple):
    """A start, with the model that it had at last, its record, and the limbs along this if they were looked at."""

    start: Start
    record: Record
    limbs: Limbs | None = None


def follow_as_it_grows(task: Task, start: Start) -> Followed:
    """The ball from frame to frame; one whose limbs grow is followed again, with a model that lets it."""
    record = follow(task, start)
    if task.in_place or start.grows or start.options.model not in RIGID_MODELS:
        return Followed(start, record)
    limbs = limbs_along(task, start, record)
    growing = _growing(start)
    # Where hardly any frame was measured, a few pairs must show that the growth is why.
    is_hidden = _hides_growth(record) and failed_trial(task, growing) is None
    if not (is_hidden or _may_grow(limbs)):
        return Followed(start, record, limbs)
    again = follow(task, growing)
    grown = limbs_along(task, start, again)
    if not _limbs_follow(grown, again):
        return Followed(start, record, limbs)
    return Followed(growing, along_limbs(task, growing, again, grown, resized=True))


def _may_grow(limbs: Limbs) -> bool:
    """Whether the limbs along a path grow, or scatter as if they lay beside the ball.

    That it grows is known only after `_limbs_follow`.
    """
    limb = growth_of_limbs(limbs)
    return limb is not None and (limb.is_significant or limb.scatter > SUSPECT_SCATTER)


def _hides_growth(measured: Record) -> bool:
    """Whether so few frames were measured that no limbs can show a growth, which may be why they were not."""
    return int(measured.is_ok.sum()) < MIN_LOOKS <= len(measured.status)


def is_confirmed(radius: Array, made: MadeMap | NoMap) -> bool:
    """Whether the ball that was followed as one that grows does so by its map: ``radius`` (n,), NaN where unknown."""
    return not isinstance(made, MadeMap) or bool(np.nanmax(radius) / np.nanmin(radius) > 1 + LEAST_GROWTH)


def scatter_of_limbs(limbs: Limbs) -> float:
    """Relative scatter of the limbs' radii about their course; 0 where there are too few limbs."""
    found = growth_of_limbs(limbs)
    return 0.0 if found is None else found.scatter


def _limbs_follow(limbs: Limbs, measured: Record) -> bool:
    """Whether the limbs grow significantly, and as the sizes in a record ``measured`` by the options of `_growing`."""
    limb = growth_of_limbs(limbs)
    if limb is None or not limb.is_significant:
        return False
    by_pairs = _polynomials(limbs.frames).T @ np.log(measured.size[limbs.frames])
    return bool(1 / SAME_GROWTH < (by_pairs @ limb.course) / (limb.course @ limb.course) < SAME_GROWTH)


def _growing(start: Start) -> Start:
    """The start with the model `pinhole6`; without a camera, with one far away."""
    height, width = start.image.shape
    far = Camera(focal_px=FAR_RADII * start.circle.radius, principal_px=((width - 1) / 2, (height - 1) / 2))
    options = dataclasses.replace(start.options, model="pinhole6", camera=start.options.camera or far)
    return dataclasses.replace(start, options=options, grows=True)


def growth_of_limbs(limbs: Limbs) -> Growth | None:
    """The growth by the course of the limbs' radii; None where too few frames show a limb."""
    if len(limbs.frames) < MIN_LOOKS:
        return None
    radius, typical = np.log(limbs.circles[:, 2]), float(np.median(limbs.sd[:, 2] / limbs.circles[:, 2]))
    shapes = _polynomials(limbs.frames)
    course = shapes.T @ radius
    left = radius - radius.mean() - shapes @ course
    scatter = float(np.sqrt(left @ left / (len(left) - shapes.shape[1] - 1)))
    return Growth(course, max(scatter, typical), scatter)


def _polynomials(frames: NDArray[np.int64]) -> Array:
    """Polynomials (m, d) of the numbers of ``frames`` (m,), of length 1 and normal to each other and to a constant."""
    time = 2 * (frames - frames[0]) / (frames[-1] - frames[0]) - 1
    powers = np.vander(time, min(DEGREE, len(frames) - 2) + 1, increasing=True)
    return np.asarray(np.linalg.qr(powers)[0][:, 1:])
