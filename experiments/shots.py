"""Rendered shots and their tracks, each made once and kept in ``experiments/cache``.

A key contains all settings of a file: the whole shot with every default, the rows of its table of motion, the options,
and the version. Delete the folder after a change to the package or the renderer that leaves the version as it is.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

import torchsphere as ts
from experiments.experiment import CACHE, Array, key_of
from render import preset
from render.frames import render_frames
from render.shot import Shot
from render.trajectory import Table
from render.truth import truth
from torchsphere.benchmark.baselines import TRACKERS, Baseline
from torchsphere.motion.findings import Findings

Circle = tuple[float, float, float]


@dataclass(frozen=True)
class Footage:
    """A rendered shot."""

    shot: Shot
    images: NDArray[np.uint8]  # grey levels (n, h, w)
    key: str  # hash of all settings of the images

    @cached_property
    def truth(self) -> dict[str, NDArray[Any]]:
        """True motion, by the columns of `render.truth`."""
        return truth(self.shot)

    def true(self, *names: str) -> Array:
        """Columns of the truth side by side (n, len(names))."""
        return np.stack([np.asarray(self.truth[name], dtype=np.float64) for name in names], 1)

    @property
    def circle(self) -> Circle:
        """The true outline in the first image, px."""
        x, y, radius = self.true("x_px", "y_px", "radius_px")[0].tolist()
        return x, y, radius

    @property
    def m_per_px(self) -> float:
        """Size of a pixel at the ball, m."""
        return self.shot.setup.ball.radius_m / self.circle[2]


def settings_of(shot: Shot) -> dict[str, Any]:
    """All settings of a shot; a table of motion by the hash of its file instead of its path."""
    whole = preset.table(shot)
    if isinstance(shot.trajectory, Table):
        digest = hashlib.sha256(Path(shot.trajectory.file).read_bytes()).hexdigest()
        whole["trajectory"] = whole["trajectory"] | {"file": digest}
    return whole


def rendered(shot: Shot) -> Footage:
    """The shot's images, rendered or from the cache."""
    key = key_of(f"shot-{shot.name}", settings_of(shot))

    def make() -> dict[str, NDArray[Any]]:
        frames = render_frames(shot.setup, shot.trajectory, shot.times_s)
        return {"images": np.stack(list(tqdm(frames, f"rendering {shot.name}", shot.frames)))}

    return Footage(shot, _cached_arrays(key, make)["images"], key)


def tracked(footage: Footage, circle: Circle | None = None, **options: Any) -> ts.Track:
    """The ball's motion by `torchsphere.track` with these options, measured or from the cache."""
    key = key_of("tracked", [footage.key, circle, options])

    def make() -> dict[str, NDArray[Any]]:
        with _bar(f"tracking {footage.shot.name}", options) as progress:
            found = ts.track(footage.images, circle, progress=progress, **options)
        values = {field.name: getattr(found, field.name) for field in dataclasses.fields(found)}
        columns = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
        about = {
            "circle": dataclasses.asdict(found.circle),
            "settings": found.settings,
            "findings": found.findings.items(),
            "warnings": found.warnings,
        }
        return columns | {"about": np.array(json.dumps(about, default=str))}

    columns: dict[str, Any] = dict(_cached_arrays(key, make))
    about = json.loads(str(columns.pop("about")))
    about |= {
        "findings": Findings.read(about["findings"]),
        "circle": ts.Circle(**about["circle"]),
        "warnings": tuple(about["warnings"]),
    }
    return ts.Track(**columns, **about)


def rival(footage: Footage, name: str, circle: Circle) -> Baseline:
    """The ball's motion by another tracker of `torchsphere.benchmark.baselines`, measured or from the cache."""
    key = key_of(f"rival-{name}", [footage.key, circle])

    def make() -> dict[str, NDArray[Any]]:
        with _bar(f"tracking {footage.shot.name}", {"by": name}) as progress:
            found = TRACKERS[name](footage.images, circle, progress=progress)
        columns = {field: getattr(found, field) for field in ("position", "increment", "status")}
        settings = np.array(json.dumps(found.settings, default=str))
        return columns | {"seconds": np.array(found.seconds), "settings": settings}

    columns: dict[str, Any] = dict(_cached_arrays(key, make))
    seconds, settings = float(columns.pop("seconds")), json.loads(str(columns.pop("settings")))
    return Baseline(**columns, seconds=seconds, settings=settings)


@contextmanager
def _bar(text: str, options: dict[str, Any]) -> Iterator[Callable[[int, int], None]]:
    """A progress bar as a callback for trackers."""
    with tqdm(desc=" ".join((text, *(f"{name}={value}" for name, value in options.items())))) as shown:

        def advance(done: int, total: int) -> None:
            shown.total = total
            shown.update(done - shown.n)

        yield advance


def _cached_arrays(key: str, make: Callable[[], dict[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Arrays by name, from ``make`` or from the cache."""
    path = CACHE / f"{key}.npz"
    if not path.exists():
        CACHE.mkdir(exist_ok=True)
        # A file gets its name when it is complete: an interrupted run leaves no broken file.
        part = path.with_suffix(".part.npz")
        np.savez_compressed(part, **make())  # type: ignore[arg-type]  # arrays by name, and no option of savez
        part.replace(path)
    with np.load(path) as content:
        return dict(content)


def spread(values: Array) -> tuple[float, float]:
    """Mean and standard deviation of values (n,); NaN entries are left out."""
    return float(np.nanmean(values)), float(np.nanstd(values, ddof=1))


def frames_of(shown: int, count: int) -> Iterator[int]:
    """Numbers of evenly spaced frames, the first and the last one included."""
    yield from np.linspace(0, count - 1, shown).round().astype(int).tolist()
