"""A ball that comes nearer or goes away: its image grows or shrinks from frame to frame.

The rigid modes take a growth for motion, and a map of the ball has one radius. The trend of the limb's radius shows a
growth: its error does not add up over the frames. The rigid modes put a ball that grows fast beside its limb, so that
the radii scatter. In both cases the recording is measured with the model `pinhole6`, and the growth is believed if
limbs and sizes along the new path agree.
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
from torchsphere.detection import limb_fit
from torchsphere.geometry.camera import Camera
from torchsphere.recording.frame_source import Source
from torchsphere.tracking.record import Record

#: Most pairs and limbs that are looked at, and the fewest that show a growth (docs/constants.md).
MAX_LOOKS, MIN_LOOKS = 16, 5

#: Growth over its standard deviation that is significant (docs/constants.md).
SIGNIFICANT_SD = 6.0

#: Relative scatter of the limbs' radii from which they may lie beside the ball (docs/constants.md).
SUSPECT_SCATTER = 0.01

#: Ratio up to which the growths by limbs and by pairs, whose errors add up, are the same (docs/constants.md).
SAME_GROWTH = 2.0

#: Motion models that a growth spoils, and distance in radii of a camera without perspective (docs/constants.md).
RIGID_MODELS, FAR_RADII = ("rigid", "finite", "pinhole"), 1000.0

#: Degree of the slow difference between limbs and path, and pairs that are measured at a time (docs/constants.md).
PATH_DEGREE, BATCH = 3, 16

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Growth:
    """Relative growth of the ball's image per frame, and its standard deviation."""

    per_frame: float
    sd: float
    scatter: float  # of the radii about the trend, relative

    def is_beyond(self, limit_sd: float) -> bool:
        """Whether the growth is more than so many standard deviations."""
        return abs(self.per_frame) > limit_sd * self.sd


def may_grow(source: Source, measured: Record, ignore: Tensor | None, camera: Camera | None) -> bool:
    """Whether the limbs along the path grow, or scatter as if they lay beside the ball.

    That it grows is known only after `limbs_follow`.
    """
    limb = growth_of_limb(source, measured, ignore, camera)
    return limb is not None and (limb.is_beyond(SIGNIFICANT_SD) or limb.scatter > SUSPECT_SCATTER)


def limbs_follow(source: Source, measured: Record, ignore: Tensor | None, camera: Camera | None) -> bool:
    """Whether the limbs grow significantly, and as the sizes in a record ``measured`` by the options of `growing`."""
    limb, followed = growth_of_limb(source, measured, ignore, camera), _growth_of_sizes(measured)
    if limb is None or followed is None or not limb.is_beyond(SIGNIFICANT_SD):
        return False
    return 1 / SAME_GROWTH < followed / limb.per_frame < SAME_GROWTH


def growing(options: Options, radius: float, image: Tensor) -> Options:
    """The options with the model `pinhole6`; without a camera, with one far away from images like ``image`` (h, w)."""
    height, width = image.shape
    far = Camera(focal_px=FAR_RADII * radius, principal_px=((width - 1) / 2, (height - 1) / 2))
    return dataclasses.replace(options, model="pinhole6", camera=options.camera or far)


def along_limbs(
    source: Source, measured: Record, ignore: Tensor | None, camera: Camera | None, options: Options
) -> Record:
    """The record on circles whose errors do not add up: its path follows the limbs, and its pairs are measured on it.

    A pair's growth errs by a few percent of itself, which adds up in the sizes; a wrong size makes wrong steps.
    """
    frames, fitted, _ = _limbs(source, measured, ignore, camera)
    seen = np.isfinite(fitted).all(1)
    frames, fitted, path = frames[seen], fitted[seen], _circles(measured, frames[seen]).numpy()
    all_frames = np.arange(source.count)
    apart = np.column_stack((fitted[:, :2] - path[:, :2], np.log(fitted[:, 2] / path[:, 2])))
    slow = np.polynomial.Polynomial.fit
    off = np.column_stack(
        [slow(frames, column, PATH_DEGREE, domain=[0, source.count])(all_frames) for column in apart.T]
    )
    held = dataclasses.replace(
        measured,
        position=measured.position + off[:, :2],
        size=measured.size * np.exp(off[:, 2]),
        increment=measured.increment.copy(),
        covariance=measured.covariance.copy(),
        sd_growth=measured.sd_growth.copy(),
    )
    second = np.flatnonzero((measured.status == "ok")[1:] & np.isfinite(measured.increment).all(1)) + 1
    for rows in np.array_split(second, max(1, round(len(second) / BATCH))):
        found = _pairs(source, held, rows, ignore, options)
        good = found.status == "ok"
        row = rows[good] - 1
        held.increment[row] = found.q.double().cpu().numpy()[good]
        held.covariance[row] = found.covariance.double().cpu().numpy()[good]
        held.sd_growth[row] = found.sd_growth.double().cpu().numpy()[good]
    return held


def _pairs(
    source: Source, measured: Record, second: NDArray[np.int64], ignore: Tensor | None, options: Options
) -> Correlation:
    """Pairs of each of the frames ``second`` with the frame before, from the circles of the record."""
    images = [source.images(int(i) - 1, int(i) + 1) for i in second]
    f, g = torch.stack([pair[0] for pair in images]), torch.stack([pair[1] for pair in images])
    start = torch.from_numpy(measured.increment[second - 1]).to(f)
    return correlate_pairs(f, g, _circles(measured, second - 1), start, ignore, options)


def growth_of_limb(source: Source, measured: Record, ignore: Tensor | None, camera: Camera | None) -> Growth | None:
    """The growth by the trend of the limb's radius along the path; None where too few frames show a limb."""
    frames, fitted, sd = _limbs(source, measured, ignore, camera)
    radius, sd = fitted[:, 2], sd
    seen = np.isfinite(radius) & np.isfinite(sd) & (sd > 0)
    if seen.sum() < MIN_LOOKS:
        return None
    frames, radius, typical = frames[seen], np.log(radius[seen]), float(np.median(sd[seen] / radius[seen]))
    centred = frames - frames.mean()
    slope = float(centred @ radius / (centred @ centred))
    scatter = float(np.std(radius - radius.mean() - slope * centred, ddof=2))
    return Growth(slope, max(scatter, typical) / float(np.sqrt(centred @ centred)), scatter)


def _limbs(
    source: Source, measured: Record, ignore: Tensor | None, camera: Camera | None
) -> tuple[NDArray[np.int64], Array, Array]:
    """Frames (m,) along the path, the limb in each, (m, 3) px, and the standard deviation of its radius; perhaps NaN."""
    frames = _spread(np.flatnonzero(measured.status == "ok"))
    if not len(frames):
        return frames, np.empty((0, 3)), np.empty(0)
    images = torch.cat([source.images(int(i), int(i) + 1) for i in frames])
    fitted, covariance = limb_fit.fit(images, _circles(measured, frames), ignore=ignore, camera=camera)
    return frames, fitted.numpy(), covariance[:, 2, 2].clamp_min(0).sqrt().numpy()


def _growth_of_sizes(measured: Record) -> float | None:
    """Relative growth per frame of the sizes in a record; None where too few frames are measured."""
    frames = np.flatnonzero(measured.status == "ok")
    if len(frames) < MIN_LOOKS:
        return None
    return float(np.polyfit(frames, np.log(measured.size[frames]), 1)[0])


def _spread(frames: NDArray[np.int64]) -> NDArray[np.int64]:
    """Up to `MAX_LOOKS` of the frames, evenly."""
    if not len(frames):
        return frames
    return frames[np.unique(np.linspace(0, len(frames) - 1, min(MAX_LOOKS, len(frames))).round().astype(int))]


def _circles(measured: Record, frames: NDArray[np.int64]) -> Tensor:
    """Circles (m, 3) of the record in these frames, float64."""
    return torch.from_numpy(np.column_stack((measured.position[frames], measured.size[frames])))
