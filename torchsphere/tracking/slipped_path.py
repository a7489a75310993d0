"""The path of the ball by its limbs: their errors do not add up over the frames, as those of steps between images do.

A region beside the ball makes wrong steps, which lead farther away from it: so a path that has slipped is moved to the
limbs, and its pairs are measured again.
"""

from __future__ import annotations

import copy

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.correlation import frame_status
from torchsphere.correlation.correlate import correlate_pairs
from torchsphere.correlation.result import Correlation
from torchsphere.detection.limbs import MAX_FRAMES, Limbs, fit_along_path
from torchsphere.recording.frame_range import spread
from torchsphere.runtime import steps
from torchsphere.runtime.arrays import Array
from torchsphere.tracking.record import Record
from torchsphere.tracking.start import Start
from torchsphere.tracking.task import Task

#: Fewest limbs that show a path, and the last ones of it (docs/constants.toml).
MIN_LOOKS, LAST_LOOKS = 5, 3

#: Degree of the slow difference between limbs and path, and pairs that are measured at a time (docs/constants.toml).
PATH_DEGREE, BATCH = 3, 16

#: Distance of the limbs from a path that has slipped, standard deviations and px (docs/constants.toml).
SLIPPED_SD, SLIPPED_PX = 4.0, 0.5

#: Distance of the limbs from positions that no map shows, px, from which they are not the ball's: a ball that is found
#: again is so to half a px (docs/constants.toml).
BESIDE_PX = 1.0

#: Share of the limbs of successive frames beside the path from which these frames were measured beside the ball.
MOSTLY = 0.5


def limbs_along(task: Task, start: Start, measured: Record) -> Limbs:
    """Limbs of the ball in some frames of a record, looked for where its path is: the guesses."""
    frames = spread(np.flatnonzero(measured.is_ok), MAX_FRAMES)
    path = np.column_stack((measured.position[frames], measured.size[frames]))
    if not len(frames):
        return Limbs(frames, path, path, path)
    steps.tell("comparing the path of the ball with its outlines in %d frames", len(frames))
    return fit_along_path(task.source.images_of(frames), frames, path, task.ignore, start.options.camera)


def have_slipped(limbs: Limbs) -> bool:
    """Whether the last limbs all lie beside the path: what slips goes on slipping."""
    return len(limbs.frames) >= MIN_LOOKS and bool(_lie_beside_path(limbs)[-LAST_LOOKS:].all())


def slipped_from(limbs: Limbs) -> int:
    """The first frame of a path that has slipped: that after the last limb on the path."""
    on_path = limbs.frames[~_lie_beside_path(limbs)]
    return int(on_path[-1]) + 1 if len(on_path) else 0


def runs_beside(limbs: Limbs, position: Array, wanted: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """True (n,) for runs of ``wanted`` frames (n,) most of whose limbs lie beside the ``position`` (n, 2)."""
    starts = np.flatnonzero(np.diff(wanted.astype(int), prepend=0) == 1)
    ends = np.flatnonzero(np.diff(wanted.astype(int), append=0) == -1) + 1
    found, beside = np.zeros_like(wanted), _lie_beside(limbs, position[limbs.frames], BESIDE_PX)
    for start, end in zip(starts, ends, strict=True):
        looked = (limbs.frames >= start) & (limbs.frames < end)
        found[start:end] = looked.any() and beside[looked].mean() > MOSTLY
    return found


def _lie_beside_path(limbs: Limbs) -> NDArray[np.bool_]:
    return _lie_beside(limbs, limbs.guesses[:, :2], SLIPPED_PX)


def _lie_beside(limbs: Limbs, places: Array, least_px: float) -> NDArray[np.bool_]:
    """True (m,) for limbs beside the ``places`` (m, 2) by so many px and more than their own errors."""
    off = np.abs(limbs.circles[:, :2] - places)
    return np.asarray((off > np.maximum(SLIPPED_SD * limbs.sd[:, :2], least_px)).any(1))


def along_limbs(task: Task, start: Start, measured: Record, limbs: Limbs, *, resized: bool) -> Record:
    """The record on circles that follow the ``limbs``, their sizes too where ``resized``, its pairs measured anew.

    A pair that fails there was measured beside the ball: its frame keeps the position alone.
    """
    circles, path = limbs.circles, limbs.guesses
    apart = np.column_stack((circles[:, :2] - path[:, :2], np.log(circles[:, 2] / path[:, 2])))
    fit = np.polynomial.Polynomial.fit
    every, count = np.arange(task.source.count), task.source.count
    off = np.column_stack([fit(limbs.frames, v, PATH_DEGREE, domain=[0, count])(every) for v in apart.T])
    held = copy.deepcopy(measured)
    held.position[:] = measured.position + off[:, :2]
    if resized:
        held.size[:] = measured.size * np.exp(off[:, 2])
    second = np.flatnonzero(measured.is_ok[1:] & np.isfinite(measured.increment).all(1)) + 1
    for rows in np.array_split(second, max(1, round(len(second) / BATCH))):
        found = _correlate(task, start, held, rows)
        # Pairs that fail are NaN.
        held.increment[rows - 1] = found.q.double().cpu().numpy()
        held.covariance[rows - 1] = found.covariance.double().cpu().numpy()
        held.sd_growth[rows - 1] = found.sd_growth.double().cpu().numpy()
        held.rotation[rows] = held.increment[rows - 1, 2:]
        held.status[rows] = frame_status.without(held.status[rows], found.status != frame_status.OK)
    return held


def _correlate(task: Task, start: Start, measured: Record, second: NDArray[np.int64]) -> Correlation:
    """Pairs of each of the frames ``second`` with the frame before, from the circles of the record."""
    first = second - 1
    f, g = task.source.images_of(first), task.source.images_of(second)
    circles = torch.from_numpy(np.column_stack((measured.position[first], measured.size[first])))
    guess = torch.from_numpy(measured.increment[first]).to(f)
    return correlate_pairs(f, g, circles, guess, task.ignore, start.options)
