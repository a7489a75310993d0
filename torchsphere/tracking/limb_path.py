"""The path of the ball by its limbs: their errors do not add up over the frames, as those of steps between images do.

A region beside the ball makes wrong steps, which lead farther away from it: so a path that has slipped is moved to the
limbs, and its pairs are measured again.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.correlation.correlate import correlate_pairs
from torchsphere.correlation.options import Options
from torchsphere.correlation.result import Correlation
from torchsphere.detection import blurred_limb, limb_fit
from torchsphere.geometry.camera import Camera
from torchsphere.recording.frame_source import Source
from torchsphere.runtime import steps
from torchsphere.tracking.record import Record

#: Most limbs that are looked at, the fewest that show a path, and the last ones of it (docs/constants.toml).
MAX_LOOKS, MIN_LOOKS, LAST_LOOKS = 16, 5, 3

#: Distance from its guess up to which a limb is sure to be found, px (docs/constants.toml).
IN_SIGHT_PX = 1.0

#: Degree of the slow difference between limbs and path, and pairs that are measured at a time (docs/constants.toml).
PATH_DEGREE, BATCH = 3, 16

#: Distance of the limbs from a path that has slipped, standard deviations and px (docs/constants.toml).
SLIPPED_SD, SLIPPED_PX = 4.0, 0.5

#: Distance of the limbs from positions that no map shows, px, from which they are not the ball's: a ball that is found
#: again is so to half a px (docs/constants.toml).
BESIDE_PX = 1.0

#: Share of the limbs of successive frames beside the path from which these frames were measured beside the ball.
MOSTLY = 0.5

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Limbs:
    """Limbs of m frames along a path, only those that were found."""

    frames: NDArray[np.int64]  # (m,)
    circles: Array  # (m, 3), px
    sd: Array  # (m, 3), px
    path: Array  # circles (m, 3) of the path, px

    def rows(self, kept: NDArray[np.bool_]) -> Limbs:
        """The limbs of the ``kept`` rows."""
        return Limbs(self.frames[kept], self.circles[kept], self.sd[kept], self.path[kept])

    def have_slipped(self) -> bool:
        """Whether the last limbs all lie beside the path: what slips goes on slipping."""
        return len(self.frames) >= MIN_LOOKS and bool(self._lie_beside_path()[-LAST_LOOKS:].all())

    def slipped_from(self) -> int:
        """The first frame of a path that has slipped: that after the last limb on the path."""
        on_path = self.frames[~self._lie_beside_path()]
        return int(on_path[-1]) + 1 if len(on_path) else 0

    def runs_beside(self, position: Array, wanted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """True (n,) for runs of ``wanted`` frames (n,) most of whose limbs lie beside the ``position`` (n, 2)."""
        starts = np.flatnonzero(np.diff(wanted.astype(int), prepend=0) == 1)
        ends = np.flatnonzero(np.diff(wanted.astype(int), append=0) == -1) + 1
        found, beside = np.zeros_like(wanted), self._lie_beside(position[self.frames], BESIDE_PX)
        for start, end in zip(starts, ends, strict=True):
            looked = (self.frames >= start) & (self.frames < end)
            found[start:end] = looked.any() and beside[looked].mean() > MOSTLY
        return found

    def _lie_beside_path(self) -> NDArray[np.bool_]:
        return self._lie_beside(self.path[:, :2], SLIPPED_PX)

    def _lie_beside(self, places: Array, least_px: float) -> NDArray[np.bool_]:
        """True (m,) for limbs beside the ``places`` (m, 2) by so many px and more than their own errors."""
        off = np.abs(self.circles[:, :2] - places)
        return np.asarray((off > np.maximum(SLIPPED_SD * self.sd[:, :2], least_px)).any(1))


def fit_limbs(source: Source, measured: Record, ignore: Tensor | None, camera: Camera | None) -> Limbs:
    """Limbs of the ball in up to `MAX_LOOKS` frames of a record, looked for where the path is.

    Where they are farther from it than a limb's fit can see, each is looked for where the path ends up by the last.
    """
    ok = np.flatnonzero(measured.status == "ok")
    frames = ok[np.unique(np.linspace(0, len(ok) - 1, min(MAX_LOOKS, len(ok))).round().astype(int))] if len(ok) else ok
    path = np.column_stack((measured.position[frames], measured.size[frames]))
    if not len(frames):
        return Limbs(frames, path, path, path)
    steps.tell("comparing the path of the ball with its outlines in %d frames", len(frames))
    images = torch.cat([source.images(frame, frame + 1) for frame in frames.tolist()])
    guesses = torch.from_numpy(path)
    circles, sd = _as_arrays(*limb_fit.fit(images, guesses, ignore=ignore, camera=camera))
    if not (np.abs(circles - path) < IN_SIGHT_PX).all():
        # The limb of a blurred image seems to lie outside.
        blurred = blurred_limb.fit_if_blurred(images, guesses, ignore=ignore, camera=camera)
        circles, sd = _as_arrays(*blurred[:2]) if blurred else _one_by_one(images, path, ignore, camera)
    found: NDArray[np.bool_] = np.asarray((np.isfinite(circles) & np.isfinite(sd) & (sd > 0)).all(1))
    return Limbs(frames, circles, sd, path).rows(found)


def _one_by_one(images: Tensor, path: Array, ignore: Tensor | None, camera: Camera | None) -> tuple[Array, Array]:
    """Circles (m, 3) and their sd, each looked for where the ``path`` (m, 3) ends up by the last one found."""
    circles, sd = np.empty_like(path), np.empty_like(path)
    shift, ratio = np.zeros(2), 1.0
    for k in range(len(images)):
        guess = np.append(path[k, :2] + shift, path[k, 2] * ratio)
        fitted = limb_fit.fit(images[k : k + 1], torch.from_numpy(guess[None]), ignore=ignore, camera=camera)
        circles[k], sd[k] = (rows[0] for rows in _as_arrays(*fitted))
        if np.isfinite(circles[k]).all():
            shift, ratio = circles[k, :2] - path[k, :2], circles[k, 2] / path[k, 2]
    return circles, sd


def _as_arrays(fitted: Tensor, covariance: Tensor) -> tuple[Array, Array]:
    """Circles (m, 3) and their sd, px; NaN where no limb was found."""
    return fitted.numpy(), covariance.diagonal(dim1=1, dim2=2).clamp_min(0).sqrt().numpy()


def along_limbs(
    source: Source, measured: Record, limbs: Limbs, ignore: Tensor | None, options: Options, *, resized: bool
) -> Record:
    """The record on circles that follow the ``limbs``, their sizes too where ``resized``, its pairs measured anew.

    A pair that fails there was measured beside the ball: its frame keeps the position alone.
    """
    apart = np.column_stack((limbs.circles[:, :2] - limbs.path[:, :2], np.log(limbs.circles[:, 2] / limbs.path[:, 2])))
    fit = np.polynomial.Polynomial.fit
    every = np.arange(source.count)
    off = np.column_stack([fit(limbs.frames, v, PATH_DEGREE, domain=[0, source.count])(every) for v in apart.T])
    held = dataclasses.replace(
        measured,
        position=measured.position + off[:, :2],
        size=measured.size * np.exp(off[:, 2]) if resized else measured.size,
        increment=measured.increment.copy(),
        covariance=measured.covariance.copy(),
        rotation=measured.rotation.copy(),
        status=measured.status.copy(),
        sd_growth=measured.sd_growth.copy(),
    )
    second = np.flatnonzero((measured.status == "ok")[1:] & np.isfinite(measured.increment).all(1)) + 1
    for rows in np.array_split(second, max(1, round(len(second) / BATCH))):
        found = _correlate(source, held, rows, ignore, options)
        # Pairs that fail are NaN.
        held.increment[rows - 1] = found.q.double().cpu().numpy()
        held.covariance[rows - 1] = found.covariance.double().cpu().numpy()
        held.sd_growth[rows - 1] = found.sd_growth.double().cpu().numpy()
        held.rotation[rows] = held.increment[rows - 1, 2:]
        held.status[rows[found.status != "ok"]] = "lost"
    return held


def _correlate(
    source: Source, measured: Record, second: NDArray[np.int64], ignore: Tensor | None, options: Options
) -> Correlation:
    """Pairs of each of the frames ``second`` with the frame before, from the circles of the record."""
    images = [source.images(int(i) - 1, int(i) + 1) for i in second]
    f, g = torch.stack([pair[0] for pair in images]), torch.stack([pair[1] for pair in images])
    first = second - 1
    circles = torch.from_numpy(np.column_stack((measured.position[first], measured.size[first])))
    return correlate_pairs(f, g, circles, torch.from_numpy(measured.increment[first]).to(f), ignore, options)
