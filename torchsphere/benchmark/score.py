"""Scores of one tracker on one suite: errors in which lost frames count, and the tracker's own statements on errors.

Four kinds of error, each a vector per frame: the step from the frame before (px, deg), and position and orientation
since frame 0 (px, deg). No error counts for more than a cap. A frame with a visible ball and no answer has an error of
the cap, so that a missing answer is never better than a wrong answer. Frame 0 is given and not scored.
docs/benchmark.md says the same for users.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from torchsphere.benchmark.folder import Truth
from torchsphere.benchmark.predictions import Prediction
from torchsphere.geometry.orientation import rotation_vectors
from torchsphere.runtime.arrays import Array

Mask = NDArray[np.bool_]

#: Largest error of a right position, px, and of a right orientation, deg (docs/constants.toml).
LIMIT_PX, LIMIT_DEG = 1.0, 2.0

#: Largest error that counts, and that of a lost frame, px and deg (docs/constants.toml).
CAP_PX, CAP_DEG = 5 * LIMIT_PX, 5 * LIMIT_DEG

#: Smallest share of the outline's area in view with which the ball counts as visible (docs/constants.toml).
MIN_VISIBLE = 0.3

#: Standard deviations on either side that hold 95 % of normal errors.
BAND = 1.96

#: The kinds of error in the order of `Score.kinds`: name, unit, cap.
KINDS = (("step", "px", CAP_PX), ("step", "deg", CAP_DEG), ("place", "px", CAP_PX), ("orientation", "deg", CAP_DEG))


@dataclass(frozen=True)
class Errors:
    """One kind of error over all scored frames."""

    mean: float  # of min(|e|, cap), a lost frame at the cap
    bias: float  # length of the mean error vector, each vector shortened to the cap; lost frames add to the length
    std: float  # root mean square distance from the mean error vector, a lost frame at a distance of the cap


@dataclass(frozen=True)
class Calibration:
    """Errors relative to stated standard deviations; NaN where none is stated."""

    ratio: float  # root mean square of error over standard deviation, bias included; 1 is right, more is overconfident
    within: float  # share of the errors within 1.96 standard deviations; 0.95 is right


@dataclass(frozen=True)
class Score:
    """The scores of one tracker on one suite."""

    points: float  # mean of the four mean errors, each over its cap: 0 is perfect, 1 is nothing measured
    kinds: tuple[Errors, Errors, Errors, Errors]  # in the order of `KINDS`; NaN for rotations that are not visible
    component_bias: Array  # mean (5,) of the errors of stated steps, px and deg
    component_std: Array  # standard deviation (5,) of the errors of stated steps
    drift_px: float  # growth of the position error per frame
    drift_deg: float  # growth of the orientation error per frame; NaN if no orientation is stated
    lost: float  # share of the frames without a reliable position
    lost_rotation: float  # share of the frames without a rotation; NaN if rotations are not measured or not visible
    silent: float  # share of all frames with a wrong position or orientation that the tracker does not doubt
    gone: int  # frames in which the ball is not visible
    gone_noticed: float  # share of these frames in which the tracker states no position
    calibration_px: Calibration  # of the steps
    calibration_deg: Calibration
    measures_rotation: bool
    ms_per_pair: float  # NaN if not stated
    frames: int  # in which the ball is visible, without frame 0


NO_ERRORS = Errors(math.nan, math.nan, math.nan)


def score(truth: Truth, prediction: Prediction) -> Score:
    """Score a prediction; ValueError if the numbers of frames differ, or if the ball is visible in frame 0 alone."""
    if len(prediction.position) != len(truth.position):
        raise ValueError(f"{len(prediction.position)} frames were predicted, but the truth has {len(truth.position)}")
    visible = truth.visible >= MIN_VISIBLE
    pairs, later, hidden = visible[1:] & visible[:-1], visible[1:], ~visible[1:]
    if not later.any():
        raise ValueError("the ball is in no frame but the first; nothing can be scored")
    step_px, step_deg, position, orientation = errors_of(truth, prediction)
    scored = (step_px[pairs], step_deg[pairs], position[later], orientation[later])
    kinds = [_summary(error, cap) for error, (_, _, cap) in zip(scored, KINDS, strict=True)]
    if not truth.shows_rotation:
        kinds[1] = kinds[3] = NO_ERRORS
    shares = [found.mean / cap for found, (_, _, cap) in zip(kinds, KINDS, strict=True)]
    no_position = (prediction.position_doubted | ~np.isfinite(prediction.position[:, 0]))[1:]
    no_rotation = prediction.rotation_doubted[1:] | ~np.isfinite(prediction.increment[:, 2:]).all(1)
    has_rotation = prediction.measures_rotation and truth.shows_rotation
    wrong_position = (np.linalg.norm(position, axis=1) > LIMIT_PX) & ~prediction.position_doubted[1:]
    wrong_orientation = (np.linalg.norm(orientation, axis=1) > LIMIT_DEG) & ~prediction.rotation_doubted[1:]
    steps = np.concatenate((step_px, step_deg), 1)[pairs]
    sd = prediction.sd_increment[pairs] * np.array([1, 1, *3 * [math.degrees(1)]])
    return Score(
        points=float(np.nanmean(shares)),
        kinds=(kinds[0], kinds[1], kinds[2], kinds[3]),
        component_bias=_by_component(steps, np.mean),
        component_std=_by_component(steps, np.std),
        drift_px=_drift(position, later),
        drift_deg=_drift(orientation, later) if truth.shows_rotation else math.nan,
        lost=float(no_position[later].mean()),
        lost_rotation=float(no_rotation[later].mean()) if has_rotation else math.nan,
        silent=float((wrong_position | wrong_orientation).mean()),
        gone=int(hidden.sum()),
        gone_noticed=float(no_position[hidden].mean()) if hidden.any() else math.nan,
        calibration_px=_calibration(steps[:, :2], sd[:, :2]),
        calibration_deg=_calibration(steps[:, 2:], sd[:, 2:]),
        measures_rotation=prediction.measures_rotation,
        ms_per_pair=prediction.ms_per_pair,
        frames=int(later.sum()),
    )


def errors_of(truth: Truth, prediction: Prediction) -> tuple[Array, Array, Array, Array]:
    """Errors of step, px and deg, position, px, and orientation, deg, each (n - 1, 2 or 3) for the frames from 1 on.

    The error of a rotation is the rotation vector from the true to the stated rotation. A step with some of its
    rotation components has the difference of these components.
    """
    rotation = rotation_vectors(truth.orientation[1:], truth.orientation[:-1])
    step = prediction.increment - np.concatenate((np.diff(truth.position, axis=0), rotation), 1)
    whole = np.isfinite(prediction.increment[:, 2:]).all(1)
    step[whole, 2:] = rotation_vectors(
        Rotation.from_rotvec(prediction.increment[whole, 2:]).as_matrix().reshape(-1, 3, 3),
        (truth.orientation[1:] @ truth.orientation[:-1].swapaxes(1, 2))[whole],
    )
    since_first = truth.orientation @ truth.orientation[0].T
    orientation = np.degrees(rotation_vectors(prediction.orientation[1:], since_first[1:]))
    return step[:, :2], np.degrees(step[:, 2:]), (prediction.position - truth.position)[1:], orientation


def _summary(error: Array, cap: float) -> Errors:
    """Mean, bias and standard deviation of errors (m, k), with lost frames (NaN) at the cap."""
    if not len(error):
        return NO_ERRORS
    stated = np.isfinite(error).all(1)
    length = np.where(stated, np.linalg.norm(error, axis=1), cap)
    capped = error[stated] * np.minimum(1, cap / np.maximum(length[stated], 1e-300))[:, None]
    lost = len(error) - len(capped)
    middle = capped.sum(0) / max(len(capped), 1)
    squares = np.square(capped - middle).sum() + lost * cap**2
    bias = (np.linalg.norm(capped.sum(0)) + lost * cap) / len(error)
    return Errors(float(np.minimum(length, cap).mean()), float(bias), math.sqrt(squares / len(error)))


def _by_component(error: Array, statistic: Callable[[Array], np.floating]) -> Array:
    """The statistic of each column (m,) without its NaN; NaN for an empty column."""
    columns = (column[np.isfinite(column)] for column in error.T)
    return np.array([float(statistic(column)) if len(column) else math.nan for column in columns])


def _drift(error: Array, visible: Mask) -> float:
    """Slope per frame of the line through 0 at frame 0 that fits the error vectors (n - 1, k) best; NaN without any."""
    known = visible & np.isfinite(error).all(1)
    frame = np.arange(1, len(error) + 1, dtype=np.float64)[known]
    return float(np.linalg.norm(frame @ error[known]) / (frame @ frame)) if len(frame) else math.nan


def _calibration(error: Array, sd: Array) -> Calibration:
    """Calibration of errors (m, k) with stated standard deviations (m, k), in one unit."""
    known = np.isfinite(error) & np.isfinite(sd)
    if not known.any():
        return Calibration(math.nan, math.nan)
    ratio = np.abs(error[known]) / sd[known]
    return Calibration(math.sqrt(float(np.square(ratio).mean())), float((ratio <= BAND).mean()))
