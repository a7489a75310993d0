"""Whether a map of the ball is made, and what it showed or why there is none."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: Smallest number of frames for a map.
MIN_FRAMES = 6

#: Models of a rigid motion at a constant distance, which a map replaces.
MAP_MODELS = ("rigid", "finite", "pinhole")

#: Residual variance within the disc, in variances of the noise, from which the map is refused (docs/constants.toml).
MAX_MISFIT = 4.0

#: Blur of the outline beyond that of the optics, px, from which the map is refused: a blur by an object in front
#: (docs/constants.toml).
MAX_EDGE_BLUR_PX = 2.0

#: Largest correction of the radius by the map, as a share of the radius (docs/constants.toml).
MAX_RADIUS_CHANGE = 0.05


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
    open_share: float = 0.0  # exposure over the time between frames
    residual_over_noise: float = 1.0
    widened: float = 1.0  # largest factor in the steps' errors by what neighbouring pixels share
    radius_off_outline_px: float = 0.0  # error of the radius by what the outline tells
    radius_over_distance: float = 0.0  # of the camera: its nearness
    sd_radius_over_distance: float = 0.0


def not_needed(
    asked: bool | None, model: str, position: NDArray[np.float64], rotation: NDArray[np.float64]
) -> NoMap | None:
    """Why no map is made of frames with these positions (n, 2) and rotations (n, 3), NaN where unknown; else None.

    A map that was ``asked`` for is needed.
    """
    placed = int(np.isfinite(position[:, 0]).sum())
    if asked is False:
        return NoMap(Why.NOT_ASKED, "it was not asked for", is_needed=False)
    if model not in MAP_MODELS:
        sentence = f"a map of the ball takes a rigid motion at a constant distance, which {model!r} is not"
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


#: Poses that do not settle, and equations that are singular.
NOT_SETTLED = NoMap(Why.NOT_SETTLED, "the adjustment of the ball's map and poses did not converge")
NO_SOLUTION = NoMap(Why.NO_SOLUTION, "the equations of the map have no solution")
