"""Scores of one tracker on one suite: errors in which what was lost counts, and how honest the tracker is about them.

Four kinds of error, each a vector per frame: the step from the frame before (px, deg) and the place and the
orientation since frame 0 (px, deg). A frame in which the ball is there but the tracker states nothing has an error of
the cap, and no error counts for more than the cap: so a failure is in every mean, and is never worth less than an
answer. Frame 0 is given to every tracker and scored for none. docs/benchmark.md says the same for users.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchsphere.benchmark.errors import Truth, errors_of
from torchsphere.benchmark.predictions import Prediction

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: A place or an orientation that is off by more than this is wrong: the benchmark's own definition. Two degrees move
#: the front of a ball of 30 px by one px.
LIMIT_PX, LIMIT_DEG = 1.0, 2.0

#: Largest error that counts, and that of a lost frame: five times what is wrong.
CAP_PX, CAP_DEG = 5 * LIMIT_PX, 5 * LIMIT_DEG

#: Share of the outline's area in view below which the right answer is that the ball is gone.
MIN_VISIBLE = 0.3

#: Standard deviations on either side that hold 95 % of normal errors.
BAND = 1.96

#: The kinds of error in the order of `Score.kinds`: name, unit, cap.
KINDS = (("step", "px", CAP_PX), ("step", "deg", CAP_DEG), ("place", "px", CAP_PX), ("orientation", "deg", CAP_DEG))


@dataclass(frozen=True)
class Errors:
    """One kind of error over the m frames in which it is scored.

    Attributes
    ----------
    mean : float
        Mean of ``min(|e|, cap)``, a lost frame at the cap.
    bias : float
        Length of the mean error vector, each shortened to the cap, a lost frame as one of the cap in its direction.
    std : float
        Root of the mean squared distance from the mean error vector, a lost frame as one of the cap.
    """

    mean: float
    bias: float
    std: float


@dataclass(frozen=True)
class Honesty:
    """Stated standard deviations against errors; NaN where none is stated.

    Attributes
    ----------
    ratio : float
        Root mean square of error over stated standard deviation, bias included: 1 is honest, more is too confident.
    within : float
        Share of the errors within 1.96 of them; 0.95 is honest.
    """

    ratio: float
    within: float


@dataclass(frozen=True)
class Score:
    """What one tracker is worth on one suite.

    Attributes
    ----------
    points : float
        Mean of the four kinds' mean errors, each over its cap: 0 is perfect, 1 is nothing measured.
    kinds : tuple of Errors
        In the order of `KINDS`; the rotations' are NaN where no rotation can be seen.
    component_bias, component_std : ndarray
        Mean and standard deviation (5,) of the steps that were stated, px and deg; lost frames are not in these.
    drift_px, drift_deg : float
        Growth of the error of place and orientation per frame: slope of the line through 0 at frame 0 that fits the
        error vectors stated best; NaN where none is stated.
    lost, lost_rotation : float
        Share of the frames without a place to be relied on, or without a rotation; the second is NaN where the tracker
        does not measure rotations or none can be seen.
    silent : float
        Share of all frames in which the tracker relies on a place or an orientation that is wrong.
    gone, gone_noticed : int, float
        Frames in which the ball is gone, and the share of them in which the tracker states no place.
    honesty_px, honesty_deg : Honesty
        Of the steps.
    measures_rotation : bool
        Whether the tracker states rotations at all.
    ms_per_pair : float
        Time, ms; NaN where it is not stated.
    frames : int
        Frames in which the ball is there to be found, frame 0 not among them.
    """

    points: float
    kinds: tuple[Errors, Errors, Errors, Errors]
    component_bias: Array
    component_std: Array
    drift_px: float
    drift_deg: float
    lost: float
    lost_rotation: float
    silent: float
    gone: int
    gone_noticed: float
    honesty_px: Honesty
    honesty_deg: Honesty
    measures_rotation: bool
    ms_per_pair: float
    frames: int


NO_ERRORS = Errors(math.nan, math.nan, math.nan)


def score(truth: Truth, prediction: Prediction) -> Score:
    """Score a prediction.

    Parameters
    ----------
    truth : Truth
        Of n frames, two at least.
    prediction : Prediction
        Of the same frames.

    Returns
    -------
    Score

    Raises
    ------
    ValueError
        If the numbers of frames differ, or the ball is there in frame 0 alone.
    """
    if len(prediction.position) != len(truth.position):
        raise ValueError(f"{len(prediction.position)} frames were predicted, but the truth has {len(truth.position)}")
    there = truth.visible >= MIN_VISIBLE
    if not there[1:].any():
        raise ValueError("the ball is in no frame but the first; nothing can be scored")
    step_px, step_deg, place, turn = errors_of(truth, prediction)
    pairs = there[1:] & there[:-1]
    scored = (step_px[pairs], step_deg[pairs], place[there[1:]], turn[there[1:]])
    kinds = [_summary(error, cap) for error, (_, _, cap) in zip(scored, KINDS, strict=True)]
    if not truth.shows_rotation:
        kinds[1] = kinds[3] = NO_ERRORS
    shares = [found.mean / cap for found, (_, _, cap) in zip(kinds, KINDS, strict=True)]
    lost, lost_rotation = _lost(truth, prediction, there[1:])
    steps = np.concatenate((step_px, step_deg), 1)[pairs]
    sd = prediction.sd_increment[pairs] * np.array([1, 1, *3 * [math.degrees(1)]])
    unseen = ~there[1:]
    return Score(
        points=float(np.nanmean(shares)),
        kinds=(kinds[0], kinds[1], kinds[2], kinds[3]),
        component_bias=_by_component(steps, np.mean),
        component_std=_by_component(steps, np.std),
        drift_px=_drift(place, there[1:]),
        drift_deg=_drift(turn, there[1:]) if truth.shows_rotation else math.nan,
        lost=lost,
        lost_rotation=lost_rotation,
        silent=_silent(truth, prediction, place, turn),
        gone=int(unseen.sum()),
        gone_noticed=float(_states_no_place(prediction)[unseen].mean()) if unseen.any() else math.nan,
        honesty_px=_honesty(steps[:, :2], sd[:, :2]),
        honesty_deg=_honesty(steps[:, 2:], sd[:, 2:]),
        measures_rotation=prediction.measures_rotation,
        ms_per_pair=prediction.ms_per_pair,
        frames=int(there[1:].sum()),
    )


def _summary(error: Array, cap: float) -> Errors:
    """Mean, bias and standard deviation of errors (m, k) with what is lost, NaN, at the cap."""
    stated = np.isfinite(error).all(1)
    length = np.where(stated, np.linalg.norm(error, axis=1), cap)
    if not len(error):
        return NO_ERRORS
    capped = error[stated] * np.minimum(1, cap / np.maximum(length[stated], 1e-300))[:, None]
    lost = len(error) - len(capped)
    middle = capped.sum(0) / max(len(capped), 1)
    squares = np.square(capped - middle).sum() + lost * cap**2
    bias = (np.linalg.norm(capped.sum(0)) + lost * cap) / len(error)
    return Errors(float(np.minimum(length, cap).mean()), float(bias), math.sqrt(squares / len(error)))


def _by_component(error: Array, of: Callable[[Array], np.floating]) -> Array:
    """``of``, `np.mean` or `np.std`, each column (m,) without its NaN; NaN where a column has nothing else."""
    columns = (column[np.isfinite(column)] for column in error.T)
    return np.array([float(of(column)) if len(column) else math.nan for column in columns])


def _drift(error: Array, there: Mask) -> float:
    """Slope of the error vectors (n - 1, k) of the frames from 1 on, 0 in frame 0; per frame."""
    known = there & np.isfinite(error).all(1)
    frame = np.arange(1, len(error) + 1, dtype=np.float64)[known]
    if not len(frame):
        return math.nan
    return float(np.linalg.norm(frame @ error[known]) / (frame @ frame))


def _states_no_place(prediction: Prediction) -> Mask:
    """(n - 1,), whether a frame from 1 on has no place to be relied on."""
    return (prediction.position_doubted | ~np.isfinite(prediction.position[:, 0]))[1:]


def _lost(truth: Truth, prediction: Prediction, there: Mask) -> tuple[float, float]:
    """Share of the frames in which the ball is there without a place; and of those without a rotation."""
    lost = float(_states_no_place(prediction)[there].mean())
    if not (prediction.measures_rotation and truth.shows_rotation):
        return lost, math.nan
    no_turn = prediction.rotation_doubted[1:] | ~np.isfinite(prediction.increment[:, 2:]).all(1)
    return lost, float(no_turn[there].mean())


def _silent(truth: Truth, prediction: Prediction, place: Array, turn: Array) -> float:
    """Share of the frames from 1 on, the ball there or gone, with a wrong place or orientation that is relied on."""
    wrong_place = (np.linalg.norm(place, axis=1) > LIMIT_PX) & ~prediction.position_doubted[1:]
    wrong_turn = (np.linalg.norm(turn, axis=1) > LIMIT_DEG) & ~prediction.rotation_doubted[1:]
    return float((wrong_place | wrong_turn).mean())


def _honesty(error: Array, sd: Array) -> Honesty:
    """Of errors (m, k) with stated standard deviations (m, k), in one unit."""
    known = np.isfinite(error) & np.isfinite(sd)
    if not known.any():
        return Honesty(math.nan, math.nan)
    ratio = np.abs(error[known]) / sd[known]
    return Honesty(math.sqrt(float(np.square(ratio).mean())), float((ratio <= BAND).mean()))
