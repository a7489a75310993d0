"""Recordings as files, and the measurement of a file in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.speed.footage import SPIN, SWING, Footage

#: Shape (h, w) of the images, px.
SHAPE = (256, 512)

#: The ball of R = 50 px that spins, and the ball that swings to and fro.
SPINNING, SWINGING = Footage(SPIN, given_shape=SHAPE), Footage(SWING, given_shape=SHAPE)


def write(path: Path, footage: Footage, count: int) -> Path:
    """Write ``count`` frames as TIFF, CIH with MRAW or MP4, by the suffix; returns the path to open."""
    if path.suffix == ".tif":
        import tifffile

        frames = (footage.image(i) for i in range(count))
        tifffile.imwrite(path, frames, shape=(count, *footage.shape), dtype=np.uint8, metadata=None)
    elif path.suffix == ".cih":
        _write_mraw(path, footage, count)
    else:
        _write_video(path, footage, count)
    return path


def _write_mraw(path: Path, footage: Footage, count: int) -> None:
    with path.with_suffix(".mraw").open("wb") as file:
        for i in range(count):
            file.write(footage.image(i).tobytes())
    header = {
        "Record Rate(fps)": 20000,
        "Shutter Speed(s)": "1/100000",
        "Trigger Mode": "Start",
        "Total Frame": count,
        "Start Frame": 0,
        "Save Step": 1,
        "Image Width": footage.shape[1],
        "Image Height": footage.shape[0],
        "Color Type": "Mono",
        "Color Bit": 8,
        "File Format": "MRaw",
        "EffectiveBit Depth": 8,
        "EffectiveBit Side": "Lower",
    }
    lines = "".join(f"{name} : {value}\r\n" for name, value in header.items())
    path.write_text("#Camera Information Header\r\n" + lines, "latin-1")


def _write_video(path: Path, footage: Footage, count: int) -> None:
    import av

    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("libx264", rate=25, options={"crf": "8", "preset": "veryfast"})
        stream.pix_fmt, stream.width, stream.height = "yuv420p", footage.shape[1], footage.shape[0]
        for i in range(count):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(footage.image(i), format="gray")))
        container.mux(stream.encode())


@dataclass(frozen=True)
class Task:
    """What a process measures: the options of ``torchsphere track``."""

    input: str
    out: str
    map: str  # auto, on or off
    position: str  # file for the measured centres


@dataclass(frozen=True)
class Run:
    """Seconds by stage and in all, peak memory, GB, and outcome of a process that tracked a recording."""

    frames: int
    wall_s: float
    cpu_s: float
    import_s: float
    open_s: float
    circle_s: float
    follow_s: float
    rest_s: float
    peak_gb: float
    ok: int
    on_map: int
    error_px: float = float("nan")  # largest distance from the true position

    @property
    def rate(self) -> float:
        """Frames per second, all in all."""
        return self.frames / self.wall_s


def measured(kind: str, footage: Footage, count: int, sphere_map: str = "auto") -> Run:
    """Time the track of ``count`` frames from a file of that ``kind`` in a separate process."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = write(folder / f"shot.{kind}", footage, count)
        centres = folder / "position.npy"
        task = Task(str(path), str(folder / "result"), sphere_map, str(centres))
        command = [sys.executable, "-m", "experiments.speed.timed_run", json.dumps(asdict(task))]
        # Python keeps its bytecode, even if the build machine forbids that.
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        root = Path(__file__).parents[2]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, cwd=root)
        if done.returncode != 0:
            raise RuntimeError(f"the track of {count} frames as {kind} failed: {done.stderr[-2000:]}")
        away = np.load(centres) - footage.position(range(count))
    found = json.loads(done.stdout.splitlines()[-1])
    return Run(**found, error_px=float(np.nanmax(np.linalg.norm(away, axis=1), initial=0.0)))
