"""A ball that comes nearer or goes away: its image grows or shrinks from frame to frame.

The rigid modes take a growth for motion, and a map of the ball has one radius. The trend of the limb's radius shows a
growth: its error does not add up over the frames. The texture, by the model `pinhole6` on a few pairs, must not
contradict it. Then the recording is measured with that model.
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
from torchsphere.detection import limb_fit
from torchsphere.geometry.camera import Camera
from torchsphere.recording.frame_source import Source
from torchsphere.tracking.record import Record

#: Most pairs and limbs that are looked at, and the fewest that show a growth (docs/constants.md).
MAX_LOOKS, MIN_LOOKS = 16, 5

#: Growth of the limb over its standard deviation that is significant, and that is looked at (docs/constants.md).
SIGNIFICANT_SD, SUSPECT_SD = 6.0, 3.0

#: Difference of texture and limb that is a contradiction, standard deviations (docs/constants.md).
CONTRADICTION_SD = 4.0

#: Systematic error of the growth by the texture, relative per frame (docs/constants.md).
SYSTEMATIC_GROWTH = 1.5e-4

#: Motion models that a growth spoils, and distance in radii of a camera without perspective (docs/constants.md).
RIGID_MODELS, FAR_RADII = ("rigid", "finite", "pinhole"), 1000.0

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Growth:
    """Relative growth of the ball's image per frame, its standard deviation, and the scatter over what was stated."""

    per_frame: float
    sd: float
    scatter: float = 1.0

    def is_beyond(self, limit_sd: float) -> bool:
        """Whether the growth is more than so many standard deviations."""
        return abs(self.per_frame) > limit_sd * self.sd


def is_growing(
    source: Source, measured: Record, ignore: Tensor | None, camera: Camera | None, options: Options
) -> bool:
    """Whether the limb, seen by the ``camera``, shows a growth that the texture does not contradict.

    ``options`` are those of `growing`.
    """
    limb = growth_of_limb(source, measured, ignore, camera)
    if limb is None or not limb.is_beyond(SIGNIFICANT_SD):
        return False
    texture = growth_of_texture(source, measured, ignore, options)
    if texture is None:
        return False
    return not Growth(limb.per_frame - texture.per_frame, float(np.hypot(limb.sd, texture.sd))).is_beyond(
        CONTRADICTION_SD
    )


def growing(options: Options, radius: float, image: Tensor) -> Options:
    """The options with the model `pinhole6`; without a camera, with one far away from images like ``image`` (h, w)."""
    height, width = image.shape
    far = Camera(focal_px=FAR_RADII * radius, principal_px=((width - 1) / 2, (height - 1) / 2))
    return dataclasses.replace(options, model="pinhole6", camera=options.camera or far)


def growth_of_texture(source: Source, measured: Record, ignore: Tensor | None, options: Options) -> Growth | None:
    """The growth by pairs that are spread over the recording; None where too few pairs show one."""
    ok = measured.status == "ok"
    second = _spread(np.flatnonzero(ok[1:] & ok[:-1] & np.isfinite(measured.increment).all(1)) + 1)
    if len(second) < MIN_LOOKS:
        return None
    images = [source.images(int(i) - 1, int(i) + 1) for i in second]
    f, g = torch.stack([pair[0] for pair in images]), torch.stack([pair[1] for pair in images])
    start = torch.from_numpy(measured.increment[second - 1]).to(f)
    found = correlate_pairs(f, g, _circles(measured, second - 1), start, ignore, options)
    good = found.status == "ok"
    if good.sum() < MIN_LOOKS:
        return None
    growth, sd = (np.asarray(v.double().cpu().numpy())[good] for v in (found.growth, found.sd_growth))
    # The scatter holds what the pairs' own standard deviations lack. A median has pi / 2 of the variance of a mean.
    middle = float(np.median(growth))
    scatter = max(1.4826 * float(np.median(np.abs(growth - middle))), float(np.median(sd)))
    return Growth(middle, float(np.hypot(1.2533 * scatter / np.sqrt(len(growth)), SYSTEMATIC_GROWTH)))


def growth_of_limb(source: Source, measured: Record, ignore: Tensor | None, camera: Camera | None) -> Growth | None:
    """The growth by the trend of the limb's radius; None where too few frames show a limb."""
    frames = _spread(np.flatnonzero(measured.status == "ok"))
    if len(frames) < MIN_LOOKS:
        return None
    circles = _circles(measured, frames)
    images = torch.cat([source.images(int(i), int(i) + 1) for i in frames])
    found = _trend(frames, *limb_fit.fit(images, circles, ignore=ignore, camera=camera))
    if found is not None and not found.is_beyond(SUSPECT_SD) and found.scatter < SUSPECT_SD:
        return found
    # Guesses must be right to about a px, which the circle of the first frame is not in the last one.
    fits = []
    last, ratio = circles[0], 1.0
    for i in range(len(frames)):
        guess = torch.cat((last[:2] + (circles[i] - circles[max(i - 1, 0)])[:2], last[2:] * ratio))
        fits.append(limb_fit.fit(images[i : i + 1], guess[None], ignore=ignore, camera=camera))
        fitted = fits[-1][0][0]
        if bool(fitted.isfinite().all()):
            ratio = float(fitted[2] / last[2]) if i else 1.0
            last = fitted
    return _trend(frames, *(torch.cat(parts) for parts in zip(*fits, strict=True)))


def _trend(frames: NDArray[np.int64], fitted: Tensor, covariance: Tensor) -> Growth | None:
    """Slope of the logarithm of the radii of circles (m, 3) with covariances (m, 3, 3); None where few are known."""
    radius, sd = fitted[:, 2].numpy(), covariance[:, 2, 2].clamp_min(0).sqrt().numpy()
    seen = np.isfinite(radius) & np.isfinite(sd) & (sd > 0)
    if seen.sum() < MIN_LOOKS:
        return None
    frames, radius, typical = frames[seen], np.log(radius[seen]), float(np.median(sd[seen] / radius[seen]))
    centred = frames - frames.mean()
    slope = float(centred @ radius / (centred @ centred))
    scatter = float(np.std(radius - radius.mean() - slope * centred, ddof=2))
    return Growth(slope, max(scatter, typical) / float(np.sqrt(centred @ centred)), scatter / typical)


def _spread(frames: NDArray[np.int64]) -> NDArray[np.int64]:
    """Up to `MAX_LOOKS` of the frames, evenly."""
    if not len(frames):
        return frames
    return frames[np.unique(np.linspace(0, len(frames) - 1, min(MAX_LOOKS, len(frames))).round().astype(int))]


def _circles(measured: Record, frames: NDArray[np.int64]) -> Tensor:
    """Circles (m, 3) of the record in these frames, float64."""
    return torch.from_numpy(np.column_stack((measured.position[frames], measured.size[frames])))
