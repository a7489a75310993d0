"""Trackers by name: torchsphere's own settings, every baseline, and a user's ``module:function``."""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.benchmark.baselines import TRACKERS, Baseline
from torchsphere.benchmark.prediction_table import IGNORED, KNOWN, POSITION, QUATERNION, ROTATION
from torchsphere.geometry.camera import Camera
from torchsphere.geometry.orientation import quaternions
from torchsphere.motion.ledger import INCREMENTS
from torchsphere.runtime.signals import Termination
from torchsphere.tracking.track import Track, track

#: Columns of predictions by name, each with one value per frame.
Columns = Mapping[str, Sequence[Any]]


@dataclass(frozen=True)
class Task:
    """The input of a tracker."""

    images: Any  # grey levels (n, h, w): a Recording, or an array for a user's tracker
    circle: tuple[float, float, float]  # true outline (x, y, radius) in frame 0, px
    camera: Camera | None  # None if the suite has none


@dataclass(frozen=True)
class Entry:
    """A tracker that can be run."""

    name: str
    settings: str  # method and settings, one line
    run: Callable[[Task], tuple[Columns, float]]  # predictions and the time they took, s
    wants_array: bool = False  # the images as an array instead of a `Recording`


def _torchsphere(sphere_map: bool | None, use_camera: bool = True) -> Callable[[Task], tuple[Columns, float]]:
    def run(task: Task) -> tuple[Columns, float]:
        camera = task.camera if use_camera else None
        options: dict[str, Any] = {} if camera is None else {"model": "pinhole", "camera": camera}
        began = time.perf_counter()
        found = track(task.images, task.circle, sphere_map=sphere_map, **options)
        return columns_of(found), time.perf_counter() - began

    return run


def _baseline(name: str) -> Callable[[Task], tuple[Columns, float]]:
    def run(task: Task) -> tuple[Columns, float]:
        found = TRACKERS[name](task.images, task.circle)
        return columns_of(found), found.seconds

    return run


#: torchsphere's settings by the names that the command line takes, each with a description.
OWN: dict[str, tuple[str, Callable[[Task], tuple[Columns, float]]]] = {
    "torchsphere": (
        "torchsphere.track with its defaults, a map of the ball where it can be made; model 'pinhole' where the "
        "suite tells a camera",
        _torchsphere(None),
    ),
    "torchsphere-pairs": ("the same without a map: successive images alone (sphere_map=False)", _torchsphere(False)),
    "torchsphere-map": ("the same with a map that is asked for (sphere_map=True)", _torchsphere(True)),
    "torchsphere-no-camera": ("the defaults, and never told of a camera", _torchsphere(None, use_camera=False)),
}

#: Descriptions of the baselines for the leaderboard.
BASELINES = {
    "translation_only": "torchsphere.track with two modes, the standard correlation, roi 1.0",
    "published": "torchsphere.track with the paper's five printed modes, roi 1.0",
    "ecc": "OpenCV findTransformECC, euclidean",
    "lucas_kanade": "OpenCV pyramidal Lucas-Kanade points, then a fit of the five rigid modes",
    "phase_correlation": "scikit-image phase_cross_correlation",
    "hough": "OpenCV HoughCircles on the silhouette against the background, enlarged",
    "edge_fit": "torchsphere.detection.outline_fit, the circle through the ball's edge in each frame",
    "kornia_registrator": "Kornia ImageRegistrator, similarity",
}


def names() -> tuple[str, ...]:
    """Names of the built-in trackers."""
    return (*OWN, *TRACKERS)


def resolve(name: str) -> Entry:
    """The tracker of this name; ValueError if there is none, or if ``module:function`` cannot be imported."""
    if name in OWN:
        return Entry(name, *OWN[name])
    if name in TRACKERS:
        settings = f"{BASELINES[name]}; defaults of torchsphere.benchmark.baselines.{name}"
        return Entry(name, settings, _baseline(name))
    if ":" in name:
        return Entry(name, f"the function {name}", _user_tracker(name, _imported(name)), wants_array=True)
    raise ValueError(f"no tracker is called {name!r}; expected one of {', '.join(names())}, or module:function")


def _imported(name: str) -> Callable[..., Any]:
    """The function ``module:function``, searched in the working directory too, as by ``python -m``."""
    module, _, attribute = name.partition(":")
    directory = str(Path.cwd())
    if directory not in sys.path:
        sys.path.insert(0, directory)
    try:
        function = getattr(importlib.import_module(module), attribute, None)
    except ImportError as error:
        raise ValueError(f"tracker {name!r}: {error}; run from its folder, or set PYTHONPATH") from error
    except Termination:
        raise
    except (Exception, SystemExit) as error:
        reason = f"{type(error).__name__}: {error}"
        raise ValueError(f"tracker {name!r}: importing {module} failed ({reason}); correct the module") from error
    if not callable(function):
        raise ValueError(f"tracker {name!r}: {module} has no function {attribute!r}")
    return function


def _user_tracker(name: str, function: Callable[..., Any]) -> Callable[[Task], tuple[Columns, float]]:
    """A user's function ``(images, circle) -> columns`` as a tracker."""

    def run(task: Task) -> tuple[Columns, float]:
        began = time.perf_counter()
        try:
            found = function(task.images, task.circle)
        except Termination:
            raise
        except SystemExit as error:
            # SystemExit would end the whole run, and with code 0 without a message.
            raise RuntimeError(f"{name} ended the program (SystemExit: {error.code})") from error
        return _checked(name, found, len(task.images)), time.perf_counter() - began

    return run


def _checked(name: str, found: Any, frames: int) -> Columns:
    """Columns of n rows from the result of a user's function; ValueError for another type, name or length."""
    if isinstance(found, (Track, Baseline)):
        return columns_of(found)
    if not isinstance(found, Mapping):
        raise ValueError(f"{name} returned {type(found).__name__}; expected columns by name, such as x_px and y_px")
    columns: dict[str, Sequence[Any]] = {"frame": range(frames)}
    for column, values in found.items():
        if column not in KNOWN:
            raise ValueError(f"{name} returned a column {column!r}; expected some of {', '.join(KNOWN)}")
        array = np.asarray(values)
        if array.shape != (frames,):
            raise ValueError(f"{name} returned {column!r} of shape {array.shape}; expected ({frames},), one per frame")
        if column not in IGNORED:
            columns[column] = array.tolist()
    return columns


def columns_of(found: Track | Baseline) -> Columns:
    """The motion as columns of predictions, without the rotations that a baseline does not measure."""
    columns: dict[str, Sequence[Any]] = {"frame": range(len(found.status)), "status": found.status.tolist()}
    columns |= _named(POSITION, found.position)
    increments = _named(INCREMENTS, _per_frame(found.increment))
    if isinstance(found, Track):
        sd = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
        columns |= increments | _named([f"sd_{name}" for name in INCREMENTS], _per_frame(sd))
        return columns | _named(QUATERNION, quaternions(found.orientation))
    missing = {name for name, values in increments.items() if name in ROTATION and np.isnan(values).all()}
    return columns | {name: values for name, values in increments.items() if name not in missing}


def _per_frame(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows of increments (n - 1, k) as rows of frames (n, k), NaN in frame 0."""
    return np.concatenate((np.full((1, values.shape[1]), np.nan), values))


def _named(names: Sequence[str], values: NDArray[np.float64]) -> dict[str, Sequence[Any]]:
    return dict(zip(names, values.T.tolist(), strict=True))
