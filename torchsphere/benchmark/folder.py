"""Read a benchmark's folder: what its suites are, and their images and truth with the checksums verified."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.benchmark.checksum import of_benchmark, of_suite
from torchsphere.benchmark.recorded import IMAGES, TRUTH, read_images, read_truth
from torchsphere.geometry.camera import Camera

Array = NDArray[np.float64]

#: The file that tells a benchmark's folder from any other, and the version of its layout and of the suites.
INDEX, NAME, VERSION = "suites.json", "torchsphere", 1


@dataclass(frozen=True)
class Suite:
    """One recording of a benchmark, as ``suites.json`` describes it.

    Attributes
    ----------
    name : str
        Name of the suite and of its folder; where a suite is repeated with other seeds, ``kind.1``, ``kind.2`` ...
    kind : str
        Name of the suite without the number of its repetition.
    title : str
        What is hard about it, in one line.
    folder : Path
        Where its files are.
    seed : int
        Of pattern, backdrop and noise.
    frames, width, height : int
        Number of images, and their size, px.
    frame_rate_hz : float
        Frames per second.
    diameter_mm : float
        Diameter of the ball.
    camera : Camera or None
        The pinhole camera, as `torchsphere.track` takes it; None where the view is orthographic.
    circle : tuple of float
        The true outline (x, y, radius) in frame 0, px; under perspective, where it is no circle, the one that fits
        best, which leaves a few hundredths of a px to taste.
    ball : tuple of float
        Where the camera sees the ball's centre in frame 0, and the radius at its depth, px: exact under perspective,
        too. `torchsphere.Circle` with a camera is this; without perspective it is `circle`.
    checksum : str
        Over images and truth.
    """

    name: str
    kind: str
    title: str
    folder: Path
    seed: int
    frames: int
    width: int
    height: int
    frame_rate_hz: float
    diameter_mm: float
    camera: Camera | None
    circle: tuple[float, float, float]
    ball: tuple[float, float, float]
    checksum: str

    @property
    def images_path(self) -> Path:
        """The stack of images, for whoever opens it as a recording."""
        return self.folder / IMAGES


@dataclass(frozen=True)
class Truth:
    """What a tracker should find in a suite of n frames.

    Attributes
    ----------
    time_s : (n,) ndarray
        Middle of each exposure.
    position : (n, 2) ndarray
        Where the camera sees the ball's centre, px.
    radius : (n,) ndarray
        The ball's radius at the depth of its centre, px.
    quaternion : (n, 4) ndarray
        Orientation (w, x, y, z) since frame 0, in the camera frame.
    visible : (n,) ndarray
        Share of the outline's area that is in the image and that nothing hides.
    """

    time_s: Array
    position: Array
    radius: Array
    quaternion: Array
    visible: Array


@dataclass(frozen=True)
class Footage:
    """A suite's images (n, h, w), memory-mapped where the file allows it, and its truth; their checksum is right."""

    images: NDArray[Any]
    truth: Truth


@dataclass(frozen=True)
class Benchmark:
    """A benchmark that was made.

    Attributes
    ----------
    folder : Path
        Where it is.
    size : str
        ``smoke``, ``standard`` or ``full``.
    suites : tuple of Suite
        In the order in which they were made.
    checksum : str
        Over all of it.
    renderer : dict of str to str
        Versions of what rendered it.
    """

    folder: Path
    size: str
    suites: tuple[Suite, ...]
    checksum: str
    renderer: dict[str, str]

    def __iter__(self) -> Iterator[Suite]:
        """The suites in turn."""
        return iter(self.suites)

    def suite(self, name: str) -> Suite:
        """A suite by its name.

        Raises
        ------
        ValueError
            Where the benchmark does not have it.
        """
        for suite in self.suites:
            if suite.name == name:
                return suite
        raise ValueError(
            f"{self.folder}: has no suite {name!r}; expected one of {', '.join(s.name for s in self.suites)}"
        )


def read_benchmark(folder: Path) -> Benchmark:
    """Read what a benchmark's folder holds; images and truth are read by `read_footage`.

    Parameters
    ----------
    folder : Path
        Made by `torchsphere.benchmark.make.make`.

    Returns
    -------
    Benchmark

    Raises
    ------
    ValueError
        Where it is no benchmark, of another version, or its description was changed.
    OSError
        Where it cannot be read.
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
        if of_benchmark(content) != content["checksum"]:
            raise ValueError("its checksum does not fit what it says, so it was changed since it was made")
        suites = tuple(_suite(folder, entry) for entry in content["suites"])
        return Benchmark(folder, content["size"], suites, content["checksum"], dict(content["renderer"]))
    except (KeyError, TypeError, json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: is damaged ({error!r}); make the benchmark again") from error
    except ValueError as error:
        raise ValueError(f"{path}: {error}; make the benchmark again") from error


def read_footage(suite: Suite) -> Footage:
    """Read images and truth of a suite and verify its checksum.

    Parameters
    ----------
    suite : Suite
        Of `read_benchmark`.

    Returns
    -------
    Footage

    Raises
    ------
    ValueError
        Where a file is damaged or another than the one that was made.
    OSError
        Where a file is missing or cannot be read.
    """
    columns, images = read_truth(suite.folder / TRUTH), read_images(suite.images_path)
    found = of_suite(images, columns)
    if found != suite.checksum:
        raise ValueError(
            f"{suite.folder}: images or truth have the checksum {found[:19]}..., expected {suite.checksum[:19]}...; "
            "they are not those that were made: make the benchmark again"
        )
    quaternion = np.column_stack([columns[name] for name in ("qw", "qx", "qy", "qz")])
    position = np.column_stack((columns["x_px"], columns["y_px"]))
    truth = Truth(columns["time_s"], position, columns["radius_px"], quaternion, columns["visible"])
    return Footage(images, truth)


def _suite(folder: Path, entry: Mapping[str, Any]) -> Suite:
    camera = entry["camera"]
    name = str(entry["name"])
    return Suite(
        name=name,
        kind=str(entry["kind"]),
        title=str(entry["title"]),
        folder=folder / name,
        seed=int(entry["seed"]),
        frames=int(entry["frames"]),
        width=int(entry["width"]),
        height=int(entry["height"]),
        frame_rate_hz=float(entry["frame_rate_hz"]),
        diameter_mm=float(entry["diameter_mm"]),
        camera=None if camera is None else _camera(camera),
        circle=_three(entry["circle"]),
        ball=_three(entry.get("ball", entry["circle"])),
        checksum=str(entry["checksum"]),
    )


def _camera(entry: Mapping[str, Any]) -> Camera:
    x, y = map(float, entry["principal_px"])
    return Camera(float(entry["focal_px"]), (x, y), _three(entry["distortion"]))


def _three(values: Sequence[float]) -> tuple[float, float, float]:
    first, second, third = map(float, values)
    return first, second, third
