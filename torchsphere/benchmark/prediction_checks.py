"""What a file of predictions must agree with, one sentence for whatever does not."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from torchsphere.benchmark.prediction_table import PLACE, QUATERNION, SD, TURN, Table, columns_of

#: A quaternion may be this much longer or shorter than 1: six digits are written by careful people, three by others.
LENGTH_TOLERANCE = 0.01


@dataclass(frozen=True)
class Given:
    """What a tracker was given, as far as its predictions must agree with it.

    Attributes
    ----------
    suite : str
        Name of the suite.
    frames : int
        Number of its frames.
    circle : tuple of float
        True outline (x, y, radius) in frame 0, px.
    checksum : str
        Of the suite's images and truth.
    """

    suite: str
    frames: int
    circle: tuple[float, float, float]
    checksum: str


def check_origin(path: Path, table: Table, given: Given) -> None:
    """ValueError where the file says itself that it is of other images."""
    named = {name for name in (*table.texts.get("suite", ()), table.keys.get("suite", "")) if name}
    others = sorted(named - {given.suite})
    if others:
        raise ValueError(f"{path}: says that it is of suite {others[0]!r}, not {given.suite!r}; give the right file")
    stated = table.keys.get("checksum", given.checksum)
    if stated != given.checksum:
        raise ValueError(
            f"{path}: was made from other images of suite {given.suite!r} (checksum {stated[:19]}..., these have "
            f"{given.checksum[:19]}...); run the tracker on these"
        )


def check_values(path: Path, table: Table, given: Given) -> None:
    """ValueError where numbers cannot be what their columns say, or frame 0 shows that they are of another suite."""
    x, y, radius = given.circle
    place = columns_of(table, PLACE)[0]
    if np.hypot(*(place - (x, y))) > radius:
        raise ValueError(
            f"{path}: the ball is at ({place[0]:g}, {place[1]:g}) px in frame 0, but suite {given.suite!r} has it at "
            f"({x:g}, {y:g}); this is another suite's file, or x and y are something else"
        )
    for name in (*SD, "ms", "radius_px"):
        bad = np.flatnonzero(table.numbers.get(name, np.ones(1)) <= 0)
        if len(bad):
            raise ValueError(f"{path}: {name} is 0 or less in frame {bad[0]}; leave it empty where it is not known")
    length = np.linalg.norm(columns_of(table, QUATERNION), axis=1)
    wrong = np.flatnonzero(np.abs(length - 1) > LENGTH_TOLERANCE)
    if len(wrong):
        raise ValueError(
            f"{path}: qw, qx, qy, qz have the length {length[wrong[0]]:.3g} in frame {wrong[0]}; expected 1"
        )
    if np.isfinite(length).any() and not np.isfinite(length[0]):
        raise ValueError(f"{path}: frame 0 has no qw, qx, qy, qz, from which rotations count; write 1, 0, 0, 0 there")
    # A rotation is known up to whole turns, and half a turn is the most that can be meant.
    wide = np.flatnonzero(np.linalg.norm(np.nan_to_num(columns_of(table, TURN)), axis=1) > math.pi + 1e-6)
    if len(wide):
        raise ValueError(f"{path}: wx, wy, wz are more than half a turn in frame {wide[0]}; expected rad, not degrees")


def notes(path: Path, table: Table, given: Given) -> tuple[str, ...]:
    """Sentences on what the file does not have."""
    found = []
    absent = given.frames - len(table.frames)
    if absent:
        found.append(f"{path.name}: {absent} of {given.frames} frames are not in the file and count as lost.")
    if "failed" in table.keys:
        found.append(f"{path.name}: the tracker failed: {table.keys['failed']}")
    if "checksum" not in table.keys:
        found.append(f"{path.name}: has no line '# checksum: ...', so it is taken to be of these images.")
    return tuple(found)
