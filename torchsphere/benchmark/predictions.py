"""A tracker's prediction for one suite, read from its CSV file and checked against the suite.

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

from torchsphere.benchmark.folder import Suite
from torchsphere.benchmark.prediction_table import POSITION, QUATERNION, ROTATION, SD, TRANSLATION, Table, columns_of
from torchsphere.benchmark.prediction_table import read as read_table
from torchsphere.geometry.orientation import rotation_vectors
from torchsphere.motion.ledger import INCREMENTS
from torchsphere.runtime.arrays import Array

#: Values of the column ``status`` with a valid position, and with a valid rotation.
VALID_POSITION, VALID_ROTATION = ("", "ok", "weak_texture"), ("", "ok")

#: Largest deviation of a quaternion's length from 1 (docs/constants.toml).
LENGTH_TOLERANCE = 0.01


@dataclass(frozen=True)
class Prediction:
    """Motion of the ball over n frames as a tracker states it; NaN where the tracker states nothing."""

    position: Array  # centre (n, 2), px
    orientation: Array  # rotation matrices (n, 3, 3) since frame 0
    increment: Array  # (n - 1, 5) as (dx, dy, wx, wy, wz), px and rad
    sd_position: Array  # standard deviations (n, 2)
    sd_increment: Array  # standard deviations (n - 1, 5)
    position_doubted: NDArray[np.bool_]  # (n,), the tracker itself calls the position unreliable
    rotation_doubted: NDArray[np.bool_]  # (n,)
    measures_rotation: bool  # about all three axes
    ms_per_pair: float  # NaN if not stated
    notes: tuple[str, ...]  # sentences on missing parts


def lost(suite: Suite, note: str) -> Prediction:
    """The prediction of a tracker that lost the ball in every frame; ``note`` is the reason."""
    n = suite.frames
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


def read(path: Path, suite: Suite) -> Prediction:
    """Read and check the predictions for a suite; docs/benchmark.md explains the columns.

    Frames without a row are lost. Raises ValueError, in one sentence, if the file is invalid, of another suite or of
    other images.
    """
    table = read_table(path)
    _check_origin(path, table, suite)
    n = suite.frames
    if max(table.frames, default=0) >= n:
        raise ValueError(
            f"{path}: has a frame {max(table.frames)}, but suite {suite.name!r} ends with {n - 1}; "
            "it is of another suite or another size, or counts from 1"
        )
    by_frame = _by_frame(table, n)
    _check_values(path, by_frame, suite)
    if "x_px" not in by_frame.numbers:
        by_frame = _integrated(by_frame, suite)
    columns = by_frame.numbers.keys()
    position, increment, sd = (columns_of(by_frame, names) for names in (POSITION, INCREMENTS, SD))
    has_translation = set(TRANSLATION) <= columns
    orientation, rotation = _rotation(by_frame)
    words = by_frame.texts.get("status", ("ok",) * n)
    ms = by_frame.numbers.get("ms", np.array([np.nan]))
    return Prediction(
        position=_complete_rows(position),
        orientation=orientation,
        increment=np.concatenate(
            (
                _complete_rows(increment[1:, :2] if has_translation else np.diff(position, axis=0)),
                rotation if np.isfinite(rotation).any() else increment[1:, 2:],
            ),
            axis=1,
        ),
        sd_position=sd[:, :2],
        sd_increment=sd[1:, 2:],
        position_doubted=np.array([word.lower() not in VALID_POSITION for word in words]),
        rotation_doubted=np.array([word.lower() not in VALID_ROTATION for word in words]),
        measures_rotation=set(QUATERNION) <= columns or set(ROTATION) <= columns,
        ms_per_pair=float(ms[np.isfinite(ms)].mean()) if np.isfinite(ms).any() else math.nan,
        notes=_notes(path, table, suite),
    )


def _check_origin(path: Path, table: Table, suite: Suite) -> None:
    """ValueError if the file names another suite or other images."""
    named = {name for name in (*table.texts.get("suite", ()), table.keys.get("suite", "")) if name}
    others = sorted(named - {suite.name})
    if others:
        raise ValueError(f"{path}: says that it is of suite {others[0]!r}, not {suite.name!r}; give the right file")
    stated = table.keys.get("checksum", suite.checksum)
    if stated != suite.checksum:
        raise ValueError(
            f"{path}: was made from other images of suite {suite.name!r} (checksum {stated[:19]}..., these have "
            f"{suite.checksum[:19]}...); run the tracker on these"
        )


def _check_values(path: Path, table: Table, suite: Suite) -> None:
    """ValueError if numbers do not fit their columns, or if frame 0 does not fit the suite."""
    x, y, radius = suite.circle
    first = columns_of(table, POSITION)[0]
    if np.hypot(*(first - (x, y))) > radius:
        raise ValueError(
            f"{path}: the ball is at ({first[0]:g}, {first[1]:g}) px in frame 0, but suite {suite.name!r} has it at "
            f"({x:g}, {y:g}); this is another suite's file, or x and y are something else"
        )
    for name in (*SD, "ms", "radius_px"):
        bad = np.flatnonzero(table.numbers.get(name, np.ones(1)) <= 0)
        if len(bad):
            raise ValueError(f"{path}: {name} is 0 or less in frame {bad[0]}; leave unknown values empty")
    length = np.linalg.norm(columns_of(table, QUATERNION), axis=1)
    wrong = np.flatnonzero(np.abs(length - 1) > LENGTH_TOLERANCE)
    if len(wrong):
        raise ValueError(
            f"{path}: qw, qx, qy, qz have the length {length[wrong[0]]:.3g} in frame {wrong[0]}; expected 1"
        )
    if np.isfinite(length).any() and not np.isfinite(length[0]):
        raise ValueError(f"{path}: frame 0 has no qw, qx, qy, qz, from which rotations count; write 1, 0, 0, 0 there")
    # A rotation is known up to whole turns, so half a turn is the largest valid value.
    wide = np.flatnonzero(np.linalg.norm(np.nan_to_num(columns_of(table, ROTATION)), axis=1) > math.pi + 1e-6)
    if len(wide):
        raise ValueError(f"{path}: wx, wy, wz are more than half a turn in frame {wide[0]}; expected rad, not degrees")


def _notes(path: Path, table: Table, suite: Suite) -> tuple[str, ...]:
    """Sentences on the missing parts of the file."""
    found = []
    absent = suite.frames - len(table.frames)
    if absent:
        found.append(f"{path.name}: {absent} of {suite.frames} frames are not in the file and count as lost.")
    if "failed" in table.keys:
        found.append(f"{path.name}: the tracker failed: {table.keys['failed']}")
    if "checksum" not in table.keys:
        found.append(f"{path.name}: has no line '# checksum: ...', so it is taken to be of these images.")
    return tuple(found)


def _by_frame(table: Table, n: int) -> Table:
    """The table with a row for each of n frames; missing rows are NaN and "lost"."""
    rows = np.array(table.frames, dtype=np.intp)
    numbers = {}
    for name, values in table.numbers.items():
        numbers[name] = np.full(n, np.nan)
        numbers[name][rows] = values
    texts = {}
    if "status" in table.texts:
        words = dict(zip(table.frames, table.texts["status"], strict=True))
        texts["status"] = tuple(words.get(frame, "lost") for frame in range(n))
    return dataclasses.replace(table, frames=tuple(range(n)), numbers=numbers, texts=texts)


def _integrated(table: Table, suite: Suite) -> Table:
    """The table with positions that are the sum of increments from the given circle; NaN after a missing increment."""
    translation = columns_of(table, TRANSLATION)
    translation[0] = suite.circle[:2]
    x, y = translation.cumsum(0).T
    return dataclasses.replace(table, numbers={**table.numbers, "x_px": x, "y_px": y})


def _rotation(table: Table) -> tuple[Array, Array]:
    """Orientations since frame 0 (n, 3, 3) and increments (n - 1, 3); missing ones follow from the other columns."""
    n = len(table.frames)
    matrices = np.full((n, 3, 3), np.nan)
    quaternion, increment = columns_of(table, QUATERNION), _complete_rows(columns_of(table, ROTATION))[1:]
    if "qw" not in table.numbers:
        known_count = int(np.isfinite(increment).all(1).cumprod().sum())
        product = Rotation.identity()
        matrices[0] = product.as_matrix()
        for frame, w in enumerate(increment[:known_count], start=1):
            product = Rotation.from_rotvec(w) * product
            matrices[frame] = product.as_matrix()
        return matrices, increment
    known = np.isfinite(quaternion).all(1)
    if known.any():
        matrices[known] = Rotation.from_quat(quaternion[known][:, [1, 2, 3, 0]]).as_matrix()
        matrices = matrices @ matrices[0].T
    has_increments = set(ROTATION) <= table.numbers.keys()
    return matrices, increment if has_increments else rotation_vectors(matrices[1:], matrices[:-1])


def _complete_rows(values: Array) -> Array:
    """The values, with NaN in all components of a row in which one component is unknown."""
    return np.where(np.isfinite(values).all(1, keepdims=True), values, np.nan)
