"""What a tracker says of one suite, checked against what the suite is: `read` makes it from a CSV.

Frames of reference are those of the truth: ``x`` right, ``y`` down, the centre of the top-left pixel at (0, 0);
rotations in the camera frame, ``x`` right, ``y`` down, ``z`` away from the camera, ``A_i = exp([w]x) A_(i-1)``.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from torchsphere.benchmark.prediction_checks import Given, check_origin, check_values, notes
from torchsphere.benchmark.prediction_table import PLACE, QUATERNION, SD, SHIFT, STEP, TURN, Table, columns_of
from torchsphere.benchmark.prediction_table import read as read_table

Array = NDArray[np.float64]

#: Words of the column ``status`` with which a position stands; and those with which a rotation does.
POSITION_STANDS, ROTATION_STANDS = ("", "ok", "weak_texture"), ("", "ok")


@dataclass(frozen=True)
class Prediction:
    """Motion of the ball over n frames as a tracker states it; NaN where it states nothing.

    Attributes
    ----------
    position : ndarray
        Centre (n, 2), px.
    orientation : ndarray
        Rotation matrices (n, 3, 3) since frame 0.
    increment : ndarray
        (n - 1, 5) as (dx, dy, wx, wy, wz), px and rad.
    sd_position, sd_increment : ndarray
        Their standard deviations (n, 2) and (n - 1, 5).
    position_doubted, rotation_doubted : ndarray
        (n,), True where the tracker itself says that they are not to be relied on.
    measures_rotation : bool
        Whether it states rotations about all three axes at all.
    ms_per_pair : float
        Time, ms; NaN where it is not stated.
    notes : tuple of str
        Sentences on what is missing.
    """

    position: Array
    orientation: Array
    increment: Array
    sd_position: Array
    sd_increment: Array
    position_doubted: NDArray[np.bool_]
    rotation_doubted: NDArray[np.bool_]
    measures_rotation: bool
    ms_per_pair: float
    notes: tuple[str, ...]


def nothing(given: Given, note: str) -> Prediction:
    """What a tracker says that lost the ball in every frame; ``note`` says why."""
    n = given.frames
    return Prediction(
        position=np.full((n, 2), np.nan),
        orientation=np.full((n, 3, 3), np.nan),
        increment=np.full((n - 1, 5), np.nan),
        sd_position=np.full((n, 2), np.nan),
        sd_increment=np.full((n - 1, 5), np.nan),
        position_doubted=np.ones(n, dtype=bool),
        rotation_doubted=np.ones(n, dtype=bool),
        measures_rotation=True,
        ms_per_pair=math.nan,
        notes=(note,),
    )


def read(path: Path, given: Given) -> Prediction:
    """Read and check the predictions for one suite.

    Parameters
    ----------
    path : Path
        CSV with the columns of `torchsphere.benchmark.prediction_table`; docs/benchmark.md explains them.
    given : Given
        What they must agree with.

    Returns
    -------
    Prediction
        Frames that the file does not have are lost, and `Prediction.notes` says how many.

    Raises
    ------
    ValueError
        In one sentence, where the file is no such CSV, or of another suite, or of another version of this one, or
        where its numbers cannot be what their columns say.
    OSError
        If it cannot be read.
    """
    table = read_table(path)
    check_origin(path, table, given)
    n = given.frames
    beyond = [frame for frame in table.frames if frame >= n]
    if beyond:
        raise ValueError(
            f"{path}: has a frame {max(beyond)}, but suite {given.suite!r} ends with {n - 1}; "
            "it is of another suite or another size, or counts from 1"
        )
    whole = _by_frame(table, n)
    check_values(path, whole, given)
    if "x_px" not in whole.numbers:
        whole = _added_up(whole, given)
    place, step = columns_of(whole, PLACE), columns_of(whole, STEP)[1:]
    orientation, turn = _rotation(whole)
    shift = np.diff(place, axis=0)
    words = whole.texts.get("status", ("ok",) * n)
    measures = set(QUATERNION) <= whole.numbers.keys() or set(TURN) <= whole.numbers.keys()
    sd = columns_of(whole, SD)
    return Prediction(
        position=_together(place),
        orientation=orientation,
        increment=np.concatenate(
            (
                _together(step[:, :2] if set(SHIFT) <= whole.numbers.keys() else shift),
                turn if np.isfinite(turn).any() else step[:, 2:],
            ),
            axis=1,
        ),
        sd_position=sd[:, :2],
        sd_increment=sd[1:, 2:],
        position_doubted=np.array([word.lower() not in POSITION_STANDS for word in words]),
        rotation_doubted=np.array([word.lower() not in ROTATION_STANDS for word in words]),
        measures_rotation=measures,
        ms_per_pair=_mean(whole.numbers.get("ms", np.array([np.nan]))),
        notes=notes(path, table, given),
    )


def _by_frame(table: Table, n: int) -> Table:
    """The table with a row for each of n frames, NaN and "lost" where there was none."""
    at = np.array(table.frames, dtype=np.intp)
    numbers = {}
    for name, values in table.numbers.items():
        numbers[name] = np.full(n, np.nan)
        numbers[name][at] = values
    texts = {}
    if "status" in table.texts:
        words = dict(zip(table.frames, table.texts["status"], strict=True))
        texts["status"] = tuple(words.get(frame, "lost") for frame in range(n))
    return dataclasses.replace(table, frames=tuple(range(n)), numbers=numbers, texts=texts)


def _added_up(table: Table, given: Given) -> Table:
    """The table with positions from the given circle on, from increments alone; NaN from where one is missing."""
    shift = columns_of(table, SHIFT)
    shift[0] = given.circle[:2]
    place = shift.cumsum(0)
    return dataclasses.replace(table, numbers={**table.numbers, "x_px": place[:, 0], "y_px": place[:, 1]})


def _rotation(table: Table) -> tuple[Array, Array]:
    """Orientation since frame 0 (n, 3, 3) and increments (n - 1, 3), each from the other where one is missing."""
    n = len(table.frames)
    quaternion, turn = columns_of(table, QUATERNION), _together(columns_of(table, TURN))[1:]
    if "qw" not in table.numbers:
        matrices = np.full((n, 3, 3), np.nan)
        known = int(np.isfinite(turn).all(1).cumprod().sum())
        product = Rotation.identity()
        matrices[0] = product.as_matrix()
        for at, w in enumerate(turn[:known], start=1):
            product = Rotation.from_rotvec(w) * product
            matrices[at] = product.as_matrix()
        return matrices, turn
    known_q = np.isfinite(quaternion).all(1)
    matrices = np.full((n, 3, 3), np.nan)
    if known_q.any():
        matrices[known_q] = Rotation.from_quat(quaternion[known_q][:, [1, 2, 3, 0]]).as_matrix()
        matrices = matrices @ matrices[0].T
    return matrices, turn if set(TURN) <= table.numbers.keys() else rotation_vectors(matrices[1:], matrices[:-1])


def rotation_vectors(later: Array, earlier: Array) -> Array:
    """Rotation vectors (m, 3) from ``earlier`` to ``later`` orientations (m, 3, 3), rad; NaN where one is not known."""
    product = later @ earlier.swapaxes(1, 2)
    vectors = np.full((len(product), 3), np.nan)
    known = np.isfinite(product).all((1, 2))
    if known.any():
        vectors[known] = Rotation.from_matrix(product[known]).as_rotvec()
    return vectors


def _together(values: Array) -> Array:
    """The rows that are known in all their components; half a vector is none."""
    return np.where(np.isfinite(values).all(1, keepdims=True), values, np.nan)


def _mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else math.nan
