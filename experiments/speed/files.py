"""Recordings of any length to time a whole track: a ball that swings to and fro, with a period of 700 frames."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from kornia.geometry.liegroup import So3
from numpy.typing import NDArray

from torchsphere.synthetic import ray_caster

#: Frames of one swing there and back, its middle and reach, px, and its turn to either side, rad. The largest step is
#: that of the example shot, 1.35 px and 0.57 deg per frame.
PERIOD, MIDDLE, SWING_PX, SWING_RAD = 700, (256.3, 128.2), (150.0, 25.0), 1.1

#: Oblique axis of the rotation, radius, px, and shape of the images.
AXIS, RADIUS, SHAPE = (0.348, 0.870, 0.348), 50.0, (256, 512)


@lru_cache(maxsize=1)
def swing() -> NDArray[np.uint8]:
    """Images of half a swing (351, h, w), from one end to the other."""
    phase = torch.sin(torch.linspace(-torch.pi / 2, torch.pi / 2, PERIOD // 2 + 1, dtype=torch.float64))
    centres = torch.tensor(MIDDLE) + phase[:, None] * torch.tensor(SWING_PX)
    turned = So3.exp(SWING_RAD * phase[:, None] * torch.tensor(AXIS, dtype=torch.float64)).matrix()
    pattern = ray_caster.speckle(0, radius_px=RADIUS)
    images = ray_caster.render(pattern, centres.float(), RADIUS, turned.float(), 90.0, shape=SHAPE, subsamples=4)
    noise = 2.0 * torch.randn(images.shape, generator=torch.Generator().manual_seed(1))
    return (images + noise).round().clamp(0, 255).to(torch.uint8).numpy()


def frame(i: int) -> NDArray[np.uint8]:
    """Image (h, w) number ``i`` of an endless swing."""
    place = i % PERIOD
    return np.asarray(swing()[min(place, PERIOD - place)])


def write(path: Path, count: int) -> Path:
    """Write ``count`` frames as TIFF, CIH with MRAW or MP4, by the suffix; returns the path to open."""
    if path.suffix == ".tif":
        import tifffile

        tifffile.imwrite(path, (frame(i) for i in range(count)), shape=(count, *SHAPE), dtype=np.uint8, metadata=None)
    elif path.suffix == ".cih":
        with path.with_suffix(".mraw").open("wb") as file:
            for i in range(count):
                file.write(frame(i).tobytes())
        header = {
            "Record Rate(fps)": 20000,
            "Shutter Speed(s)": "1/100000",
            "Trigger Mode": "Start",
            "Total Frame": count,
            "Start Frame": 0,
            "Save Step": 1,
            "Image Width": SHAPE[1],
            "Image Height": SHAPE[0],
            "Color Type": "Mono",
            "Color Bit": 8,
            "File Format": "MRaw",
            "EffectiveBit Depth": 8,
            "EffectiveBit Side": "Lower",
        }
        lines = "".join(f"{name} : {value}\r\n" for name, value in header.items())
        path.write_text("#Camera Information Header\r\n" + lines, "latin-1")
    else:
        _write_video(path, count)
    return path


def _write_video(path: Path, count: int) -> None:
    import av

    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream("libx264", rate=25, options={"crf": "8", "preset": "veryfast"})
        stream.pix_fmt, stream.width, stream.height = "yuv420p", SHAPE[1], SHAPE[0]
        for i in range(count):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(frame(i), format="gray")))
        container.mux(stream.encode())


@dataclass(frozen=True)
class Run:
    """Seconds by stage and in all, and peak memory, of a process that tracked a recording."""

    frames: int
    wall_s: float
    cpu_s: float
    import_s: float
    open_s: float
    circle_s: float
    follow_s: float
    rest_s: float
    peak_mib: float
    ok: int


#: Timed functions: module, name, and the name of the time.
STAGES = (
    ("torchsphere.measure", "open_recording", "open_s"),
    ("torchsphere.tracking.track", "find_initial_circle", "circle_s"),
    ("torchsphere.measure", "track", "track_s"),
)

#: Program of the process: `torchsphere.measure.measure` with clocks around the stages of its last argument.
_CODE = """
import json, resource, sys, time
import importlib
begin = time.perf_counter()
from pathlib import Path
from torchsphere import measure
from torchsphere.tracking import follow
spent = {"import_s": time.perf_counter() - begin}
def timed(place, name, key):
    module = importlib.import_module(place)
    def wrapper(*args, **kwargs):
        start = time.perf_counter()
        try:
            return inner(*args, **kwargs)
        finally:
            spent[key] = spent.get(key, 0) + time.perf_counter() - start
    inner = getattr(module, name)
    setattr(module, name, wrapper)
for stage in json.loads(sys.argv[3]):
    timed(*stage)
request = measure.Request(input=Path(sys.argv[1]), out=Path(sys.argv[2]), fps=20000.0, diameter_mm=30.0, mass_g=110.0,
                          map="off")
done = measure.measure(request)
wall = time.perf_counter() - begin
usage = resource.getrusage(resource.RUSAGE_SELF)
# The peak of this process alone: what the system counts for a child begins with its parent's size.
status = Path("/proc/self/status").read_text().splitlines()
peak = int(next(line.split()[1] for line in status if line.startswith("VmHWM")))
spent["follow_s"] = spent["track_s"] - spent["circle_s"]
spent["rest_s"] = wall - spent["import_s"] - spent["open_s"] - spent.pop("track_s")
print(json.dumps(spent | {"frames": len(done.track.status), "wall_s": wall, "cpu_s": usage.ru_utime + usage.ru_stime,
                          "peak_mib": peak / 1024, "ok": int((done.track.status == "ok").sum())}))
"""


def measured(kind: str, count: int) -> Run:
    """Time the track of ``count`` frames from a file of that ``kind`` in a separate process."""
    with tempfile.TemporaryDirectory() as folder:
        path = write(Path(folder) / f"swing.{kind}", count)
        command = [sys.executable, "-c", _CODE, str(path), str(Path(folder) / "result"), json.dumps(STAGES)]
        # Python keeps its bytecode, even if the build machine forbids that.
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode != 0:
        raise RuntimeError(f"the track of {count} frames as {kind} failed: {done.stderr[-2000:]}")
    return Run(**json.loads(done.stdout.splitlines()[-1]))
