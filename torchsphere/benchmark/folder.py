"""A benchmark's folder: its suites, their images and truth, and the checksums that identify them."""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from torchsphere.geometry.camera import Camera
from torchsphere.geometry.orientation import matrices
from torchsphere.runtime import steps
from torchsphere.runtime.arrays import Array

#: The file that describes a benchmark, and the version of its layout and of the suites.
INDEX, NAME, VERSION = "suites.json", "torchsphere", 1

#: The files of a suite.
IMAGES, TRUTH = "frames.tif", "truth.csv"

#: Columns of the truth that scores use.
TRUTH_COLUMNS = ("frame", "time_s", "x_px", "y_px", "radius_px", "qw", "qx", "qy", "qz", "visible")

#: Kinds of suites whose ball has no pattern, so that no tracker can see its rotation.
WITHOUT_PATTERN = ("no-speckle",)

#: Decimals of the truth in the checksum (docs/constants.toml).
CHECKSUM_DECIMALS = 9

_BLOCK_FRAMES = 64


@dataclass(frozen=True)
class Suite:
    """One recording of a benchmark, as ``suites.json`` describes it.

    Without perspective `ball` and `circle` are equal. Under perspective the outline is no circle, and `circle` is the
    circle that fits best, to a few hundredths of a px; `ball` is exact.
    """

    name: str  # also of the folder; "kind.1", "kind.2", ... for repetitions with other seeds
    kind: str  # name without the number of the repetition
    title: str  # the difficulty, in one line
    folder: Path
    seed: int  # of pattern, backdrop and noise
    frames: int
    width: int  # px
    height: int  # px
    frame_rate_hz: float
    diameter_mm: float
    camera: Camera | None  # None for an orthographic view
    circle: tuple[float, float, float]  # true outline (x, y, radius) in frame 0, px
    ball: tuple[float, float, float]  # projected centre and the radius at its depth in frame 0, px
    checksum: str  # of images and truth

    @property
    def images_path(self) -> Path:
        """The stack of images."""
        return self.folder / IMAGES


@dataclass(frozen=True)
class Truth:
    """Exact motion of n frames."""

    position: Array  # projected centre (n, 2), px
    orientation: Array  # rotation matrices (n, 3, 3), camera frame
    visible: Array  # share (n,) of the outline's area that is in the image and not covered
    shows_rotation: bool = True  # False for a ball without a pattern


@dataclass(frozen=True)
class Footage:
    """Images and truth of a suite, with a valid checksum."""

    images: NDArray[Any]  # (n, h, w), memory-mapped unless the file is compressed
    truth: Truth


@dataclass(frozen=True)
class Benchmark:
    """A rendered benchmark."""

    folder: Path
    size: str  # "smoke", "standard" or "full"
    suites: tuple[Suite, ...]  # in the order of ``suites.json``
    checksum: str
    renderer: dict[str, str]  # versions of the renderer's libraries

    def __iter__(self) -> Iterator[Suite]:
        """Iterate over the suites."""
        return iter(self.suites)

    def suite(self, name: str) -> Suite:
        """The suite of this name; ValueError if there is none."""
        for suite in self.suites:
            if suite.name == name:
                return suite
        raise ValueError(
            f"{self.folder}: has no suite {name!r}; expected one of {', '.join(s.name for s in self.suites)}"
        )


def read_benchmark(folder: Path) -> Benchmark:
    """Read the description of a benchmark, without images and truth.

    Raises ValueError if the folder is no benchmark, of another version, or if its description was changed.
    """
    path = folder / INDEX
    if not path.is_file():
        raise ValueError(
            f"{folder}: holds no {INDEX}, so it is no benchmark; make one with 'torchsphere benchmark make'"
        )
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict) or content.get("benchmark") != NAME:
            raise ValueError("it does not say that it is a benchmark of torchsphere")
        if content.get("version") != VERSION:
            raise ValueError(f"its version is {content.get('version')!r}, expected {VERSION}")
        if index_checksum(content) != content["checksum"]:
            raise ValueError("its checksum does not fit its content, so the file was changed since it was made")
        suites = tuple(_suite(folder, entry) for entry in content["suites"])
        return Benchmark(folder, content["size"], suites, content["checksum"], dict(content["renderer"]))
    except (KeyError, TypeError, json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: is damaged ({error!r}); make the benchmark again") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}; make the benchmark again") from error


def read_footage(suite: Suite) -> Footage:
    """Read images and truth of a suite; ValueError if a file is damaged or does not fit the checksum."""
    steps.tell_if_large([suite.images_path], "reading suite %s", suite.name)
    columns, images = read_truth(suite.folder / TRUTH), read_images(suite.images_path)
    found = suite_checksum(images, columns)
    if found != suite.checksum:
        raise ValueError(
            f"{suite.folder}: images or truth have the checksum {found[:19]}..., expected {suite.checksum[:19]}...; "
            "they were changed since they were made: make the benchmark again"
        )
    position = np.column_stack((columns["x_px"], columns["y_px"]))
    orientation = matrices(np.column_stack([columns[name] for name in ("qw", "qx", "qy", "qz")]))
    return Footage(images, Truth(position, orientation, columns["visible"], suite.kind not in WITHOUT_PATTERN))


def read_images(path: Path) -> NDArray[Any]:
    """Grey levels (n, h, w) of a stack, memory-mapped unless compressed; ValueError for any other file."""
    try:
        images: NDArray[Any] = tifffile.imread(path, out="memmap")
    except (tifffile.TiffFileError, ValueError) as error:
        raise ValueError(f"{path}: is no stack of images ({error}); make the benchmark again") from error
    if images.ndim == 2:
        images = images[None]
    if images.ndim != 3 or images.dtype.kind != "u":
        raise ValueError(f"{path}: holds {images.dtype} of the shape {images.shape}, expected grey images (n, h, w)")
    return images


def read_truth(path: Path) -> dict[str, Array]:
    """The `TRUTH_COLUMNS` (n,) of a ``truth.csv`` by name; ValueError unless all are finite numbers."""
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.reader(stream))
    except (csv.Error, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: is no CSV file in UTF-8 ({error}); make the benchmark again") from error
    head, body = (rows[0], rows[1:]) if rows else ([], [])
    missing = [name for name in TRUTH_COLUMNS if name not in head]
    if missing:
        raise ValueError(f"{path}: lacks the column {missing[0]}; expected {', '.join(TRUTH_COLUMNS)}")
    try:
        columns = {name: np.array([float(row[head.index(name)]) for row in body]) for name in TRUTH_COLUMNS}
    except (ValueError, IndexError) as error:
        raise ValueError(f"{path}: holds a row without its numbers ({error}); make the benchmark again") from error
    for name, column in columns.items():
        if not np.isfinite(column).all():
            raise ValueError(f"{path}: column {name} holds a number that is not finite; make the benchmark again")
    return columns


def suite_checksum(images: NDArray[Any], truth: Mapping[str, NDArray[Any]]) -> str:
    """Checksum over the grey levels (n, h, w), their shape and type, and the `TRUTH_COLUMNS` to nine decimals."""
    digest = hashlib.sha256(f"{images.dtype.name} {images.shape}\n".encode())
    little_endian = images.dtype.newbyteorder("<")
    for start in range(0, len(images), _BLOCK_FRAMES):
        digest.update(np.ascontiguousarray(images[start : start + _BLOCK_FRAMES], dtype=little_endian).tobytes())
    for name in TRUTH_COLUMNS:
        # The addition of zero turns -0.0 into 0.0.
        numbers = np.round(np.asarray(truth[name], dtype=np.float64), CHECKSUM_DECIMALS) + 0.0
        digest.update(f"\n{name} ".encode() + " ".join(f"{v:.{CHECKSUM_DECIMALS}f}" for v in numbers.tolist()).encode())
    return f"sha256:{digest.hexdigest()}"


def index_checksum(description: Mapping[str, Any]) -> str:
    """Checksum over the content of ``suites.json``, without its own ``checksum`` and the versions of the renderer."""
    counted = {name: value for name, value in description.items() if name not in ("checksum", "renderer")}
    text = json.dumps(counted, sort_keys=True, ensure_ascii=True, allow_nan=False)
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"


def _suite(folder: Path, entry: Mapping[str, Any]) -> Suite:
    circle = _three(entry["circle"])
    known = dict(entry) | {"camera": Camera.of_settings(entry), "circle": circle}
    return Suite(folder=folder / entry["name"], **known | {"ball": _three(entry.get("ball", circle))})


def _three(values: Sequence[float]) -> tuple[float, float, float]:
    first, second, third = map(float, values)
    return first, second, third
