"""Whether a map of the ball is made, refused, and used for a frame; what it showed, or why there is none."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from torchsphere.runtime.arrays import Array

if TYPE_CHECKING:  # a report reads what was decided, without the library that measures
    from torch import Tensor

Rows = NDArray[np.bool_]

#: Smallest number of frames for a map.
MIN_FRAMES = 6

#: Models of a rigid motion at a distance that changes, and all of a rigid motion, which a map replaces.
GROWING_MODELS = ("pinhole6",)
MAP_MODELS = ("rigid", "finite", "pinhole", *GROWING_MODELS)

#: Residual variance within the disc, in variances of the noise, from which the map is refused (docs/constants.toml).
MAX_MISFIT = 4.0

#: Blur of the outline beyond that of the optics, px, from which the map is refused: a blur by an object in front
#: (docs/constants.toml).
MAX_EDGE_BLUR_PX = 2.0

#: Largest correction of the radius by the map, as a share of the radius (docs/constants.toml).
MAX_RADIUS_CHANGE = 0.05

#: Squared difference of a step on the map and by a pair of images in uneven light, in their variances, from which one
#: of both is wrong (docs/constants.toml).
MAX_DISAGREEMENT = 12.5

#: Misfit of a frame on the map, in the median of all frames, from which the map is wrong there (docs/constants.toml).
SHADED_MISFIT = 1.5

#: Largest misfit of a frame on the map, and largest move by its registration, radii (docs/constants.toml).
MAX_FRAME_MISFIT, MAX_MOVE = 2.0, 0.1

#: Share of the known frames that are on the map of a ball whose path has not slipped (docs/constants.toml).
MIN_ON_MAP = 0.9

#: Begins the reason for a map that is not needed.
NOT_NEEDED = "not needed: "


class Why(enum.Enum):
    """Why there is no map."""

    UNKNOWN = enum.auto()
    NOT_ASKED = enum.auto()
    MODEL = enum.auto()
    NO_ROTATION = enum.auto()
    FEW_FRAMES = enum.auto()
    NO_SOLUTION = enum.auto()
    NOT_SETTLED = enum.auto()
    MISFIT = enum.auto()
    BLURRED_OUTLINE = enum.auto()
    RADIUS = enum.auto()


@dataclass(frozen=True)
class NoMap:
    """A map that is not needed, or that the images did not allow."""

    why: Why
    sentence: str
    is_needed: bool = True

    @property
    def reason(self) -> str:
        """The sentence, and whether it matters."""
        return self.sentence if self.is_needed else NOT_NEEDED + self.sentence


@dataclass(frozen=True)
class MadeMap:
    """What all images on a map share."""

    keyframes: int = 0
    frames: int = 0  # on the map
    edge_blur_px: float = 0.0  # blur of the outline by the optics
    edge_bend: float = 0.0  # of the outline by the tone curve: see `rays.bent`
    open_share: float = 0.0  # exposure over the time between frames
    falloff: float = 0.0  # of the ball's brightness to the image's corner, a share; 0 where none is seen
    residual_over_noise: float = 1.0
    widened: float = 1.0  # largest factor in the steps' errors by what neighbouring pixels share
    radius_off_outline_px: float = 0.0  # error of the radius by what the outline tells
    radius_over_distance: float = 0.0  # of the camera: its nearness
    sd_radius_over_distance: float = 0.0
    # The lens as the images show it: radial distortion in the image's corner, a share of the distance from its middle,
    # and width of the pixels over their height; with this middle, px.
    lens_distortion: float = 0.0
    sd_lens_distortion: float = 0.0
    pixel_ratio: float = 1.0
    sd_pixel_ratio: float = 0.0
    lens_middle_px: tuple[float, float] = (0.0, 0.0)

    @property
    def has_lens(self) -> bool:
        """Whether the images show a lens that bends, or pixels that are not square."""
        return bool(self.lens_distortion) or self.pixel_ratio != 1

    @property
    def sd_scale(self) -> float:
        """Relative standard deviation of lengths by that of the lens, at most: in the image's corner."""
        return math.hypot(3 * self.sd_lens_distortion, 0.5 * self.sd_pixel_ratio)


def not_needed(asked: bool | None, model: str, position: Array, rotation: Array) -> NoMap | None:
    """Why no map is made of frames with these positions (n, 2) and rotations (n, 3), NaN where unknown; else None.

    A map that was ``asked`` for is needed.
    """
    placed = int(np.isfinite(position[:, 0]).sum())
    if asked is False:
        return NoMap(Why.NOT_ASKED, "it was not asked for", is_needed=False)
    if model not in MAP_MODELS:
        sentence = f"a map of the ball takes a rigid motion, which {model!r} is not"
        return NoMap(Why.MODEL, sentence, is_needed=bool(asked))
    if not np.isfinite(rotation).any():
        return NoMap(Why.NO_ROTATION, "no rotation was measured, so no map of the ball can be made", bool(asked))
    if placed < MIN_FRAMES:
        sentence = f"a map of the ball needs {MIN_FRAMES} frames with a known pose; there are {placed}"
        return NoMap(Why.FEW_FRAMES, sentence, is_needed=bool(asked))
    return None


def few_poses(known: int) -> NoMap | None:
    """Why so many frames with a ``known`` pose make no map; None where they do."""
    if known >= MIN_FRAMES:
        return None
    sentence = f"a map of the ball needs {MIN_FRAMES} frames with a known pose, and this recording has {known}"
    return NoMap(Why.FEW_FRAMES, sentence)


def refused_as_unsettled(has_settled: bool) -> NoMap | None:
    """Why a map is refused whose poses, or camera's distance, have not settled; None if it is accepted."""
    if has_settled:
        return None
    return NoMap(Why.NOT_SETTLED, "the adjustment of the ball's map and poses did not converge")


def refusal(radius: float, given_radius: float, edge_blur: float, optics_px: float, misfit: float) -> NoMap | None:
    """Why a map that has settled is refused; None if it is accepted.

    ``misfit`` is the variance of the residual over that of the noise; radii and blurs are in px.
    """
    if misfit > MAX_MISFIT:
        sentence = (
            f"the residual on a map of the ball is {misfit**0.5:.1f} times the noise: perspective, moving light, or "
            "not a sphere"
        )
        return NoMap(Why.MISFIT, sentence)
    if edge_blur > optics_px + MAX_EDGE_BLUR_PX:
        sentence = f"the outline is blurred by {edge_blur:.1f} px on the map: something hides or shades the outline"
        return NoMap(Why.BLURRED_OUTLINE, sentence)
    if abs(radius - given_radius) > MAX_RADIUS_CHANGE * given_radius:
        return NoMap(Why.RADIUS, f"the map needs a radius of {radius:.1f} px instead of {given_radius:.1f} px")
    return None


def is_on_map(converged: Tensor, move_radii: Tensor, misfit: Tensor) -> Tensor:
    """Whether the poses (k,) that a registration found are used: it converged, near its start, and explains the image.

    ``misfit`` is the mean square of an image's weighted residual.
    """
    return converged & (move_radii < MAX_MOVE) & (misfit < MAX_FRAME_MISFIT)


def lacks_frames(known: Rows, on_map: Rows) -> bool:
    """Whether a map does not show a notable part of the frames (n,) whose position is ``known``."""
    return bool(on_map.sum() < MIN_ON_MAP * known.sum())


def shaded_frames(
    step_difference: Array, step_covariance: Array, is_comparable: Rows, frame_misfit: Array, on_map: Rows
) -> Rows:
    """Frames (n,) in which an object near the ball changes the light so that the map errs: its poses are not used.

    A step on the map contradicts the step between the images, which allow for such light, and the map explains the
    frames around it less well than the others. ``step_difference`` (n - 1, 5) and its ``step_covariance`` (n - 1, 5, 5)
    count where ``is_comparable`` (n - 1,); ``frame_misfit`` (n,) where ``on_map`` (n,).
    """
    difference = np.where(is_comparable[:, None], step_difference, 0.0)
    variance = np.where(is_comparable[:, None, None], step_covariance, np.eye(5))
    squares = (difference * np.linalg.solve(variance, difference[..., None])[..., 0]).sum(1)
    unexplained = on_map & (frame_misfit > SHADED_MISFIT * np.median(frame_misfit[on_map]))
    # Numbers of the runs of such frames.
    run = np.cumsum(np.diff(unexplained, prepend=False))
    contradicted = np.flatnonzero(squares > MAX_DISAGREEMENT)
    ends = np.concatenate((contradicted, contradicted + 1))
    return np.asarray(unexplained & np.isin(run, run[ends[unexplained[ends]]]))


#: Equations that are singular.
NO_SOLUTION = NoMap(Why.NO_SOLUTION, "the equations of the map have no solution")
