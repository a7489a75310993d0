"""Trackers by name: torchsphere's own settings, every baseline, and ``module:function`` of the user's own."""

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
from torchsphere.benchmark.prediction_table import IGNORED, KNOWN, PLACE, QUATERNION, STEP, TURN
from torchsphere.geometry.camera import Camera
from torchsphere.geometry.orientation import quaternions
from torchsphere.runtime.signals import Ending
from torchsphere.tracking.track import Track, track

#: Columns of predictions by name, each of one value per frame.
Columns = Mapping[str, Sequence[Any]]


@dataclass(frozen=True)
class Task:
    """What a tracker is given.

    Attributes
    ----------
    images : Recording or ndarray
        Grey levels (n, h, w); an array for the user's own trackers.
    circle : tuple of float
        True outline (x, y, radius) in frame 0, px.
    camera : Camera, optional
        Where the suite tells one.
    """

    images: Any
    circle: tuple[float, float, float]
    camera: Camera | None


@dataclass(frozen=True)
class Entry:
    """A tracker that can be run.

    Attributes
    ----------
    name : str
        As it was asked for.
    settings : str
        What it is and with which settings, one line.
    run : callable
        From the task to columns of predictions and the seconds that it took.
    wants_array : bool
        Whether it takes the images as an array only, not as a `Recording`.
    """

    name: str
    settings: str
    run: Callable[[Task], tuple[Columns, float]]
    wants_array: bool = False


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


#: torchsphere by the names that the command line knows, each with a line on what it is.
OWN: dict[str, tuple[str, Callable[[Task], tuple[Columns, float]]]] = {
    "torchsphere": (
        "torchsphere.track with its defaults, a map of the ball where the ball turns far; model 'pinhole' where the "
        "suite tells a camera",
        _torchsphere(None),
    ),
    "torchsphere-pairs": ("the same without a map: successive images alone (sphere_map=False)", _torchsphere(False)),
    "torchsphere-map": ("the same with a map of the ball always (sphere_map=True)", _torchsphere(True)),
    "torchsphere-no-camera": ("the defaults, and never told of a camera", _torchsphere(None, use_camera=False)),
}

#: What the baselines are, for the leaderboard; their modules say how the settings were chosen.
RIVALS = {
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
    """Names of the trackers that are built in."""
    return (*OWN, *TRACKERS)


def resolve(name: str) -> Entry:
    """The tracker of that name.

    Raises
    ------
    ValueError
        If there is none, or a ``module:function`` cannot be imported or called.
    """
    if name in OWN:
        return Entry(name, *OWN[name])
    if name in TRACKERS:
        text = RIVALS.get(name, f"torchsphere.benchmark.baselines.{name}")
        return Entry(name, f"{text}; defaults of torchsphere.benchmark.baselines.{name}", _baseline(name))
    if ":" in name:
        function = _imported(name)
        return Entry(name, f"the function {name}", _users(name, function), wants_array=True)
    raise ValueError(f"no tracker is called {name!r}; expected one of {', '.join(names())}, or module:function")


def _imported(name: str) -> Callable[..., Any]:
    """The function ``module:function``; the present folder is searched as ``python -m`` does."""
    module, _, attribute = name.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)
    try:
        function = getattr(importlib.import_module(module), attribute, None)
    except ImportError as error:
        raise ValueError(f"tracker {name!r}: {error}; run from its folder, or set PYTHONPATH") from error
    except Ending:
        raise
    except (Exception, SystemExit) as error:
        told = f"{type(error).__name__}: {error}"
        raise ValueError(f"tracker {name!r}: importing {module} failed ({told}); correct the module") from error
    if not callable(function):
        raise ValueError(f"tracker {name!r}: {module} has no function {attribute!r}")
    return function


def _users(name: str, function: Callable[..., Any]) -> Callable[[Task], tuple[Columns, float]]:
    """A function ``(images, circle) -> columns`` of somebody else's as a tracker."""

    def run(task: Task) -> tuple[Columns, float]:
        began = time.perf_counter()
        try:
            found = function(task.images, task.circle)
        except Ending:
            raise
        except SystemExit as error:
            # It would end the whole run, and without a word where its code is 0.
            raise RuntimeError(f"{name} called for the program's end (SystemExit: {error.code})") from error
        return checked(name, found, len(task.images)), time.perf_counter() - began

    return run


def checked(name: str, found: Any, frames: int) -> Columns:
    """What a user's function returned as columns of n rows.

    Raises
    ------
    ValueError
        If it is no mapping, or a column has another length or a name that is not known.
    """
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
    """The motion as columns of predictions; a baseline's rotations only where it measures any."""
    n = len(found.status)
    columns: dict[str, Sequence[Any]] = {"frame": range(n), "status": found.status.tolist()}
    columns |= _named(PLACE, found.position)
    step = _named(STEP, _after_blank(found.increment))
    if isinstance(found, Track):
        sd = np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
        columns |= step | _named([f"sd_{name}" for name in STEP], _after_blank(sd))
        return columns | _named(QUATERNION, quaternions(found.orientation))
    measured = {name for k, name in enumerate(STEP) if name not in TURN or np.isfinite(found.increment[:, k]).any()}
    return columns | {name: values for name, values in step.items() if name in measured}


def _after_blank(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows of increments (n - 1, k) as rows of frames (n, k): none leads to frame 0."""
    return np.concatenate((np.full((1, values.shape[1]), np.nan), values))


def _named(names: Sequence[str], values: NDArray[np.float64]) -> dict[str, Sequence[Any]]:
    return dict(zip(names, values.T.tolist(), strict=True))
