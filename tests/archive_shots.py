"""Small recordings for archives, and measurements that die, wait or fail by the names of recordings."""

from __future__ import annotations

import csv
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from torchsphere.archive.work import Job, Outcome, run_job
from torchsphere.cli import batch
from torchsphere.measure import Request
from torchsphere.recording import open_recording
from torchsphere.request import PER_RECORDING
from torchsphere.results import atomic_output, writer
from torchsphere.runtime.file_hash import hash_files
from torchsphere.runtime.shown_text import shown

RADIUS, FRAMES, BACKGROUND = 12.0, 5, 90
#: Settings of all recordings.
COMMON: dict[str, Any] = {"circle": (22.0, 32.3, RADIUS), "fps": 1000.0, "diameter_mm": 30.0, "map": "off"}
CALLS = "calls.txt"
#: Grey level of a recording that `pretended` refuses, and reasons of recordings without a usable result.
BAD = 255
UNUSABLE: dict[str, str] = {}
#: Numbers of severe warnings of recordings.
SEVERE: dict[str, int] = {}
#: Limit of every wait for an event, s, far above the time under heavy load.
PATIENCE_S = 900.0


#: Twelve recordings of which nine can be measured.
NAMES = [
    "a/r0",
    "a/r1",
    "a/held2",
    "a/r3",
    "a/corrupt4",
    "b/r5",
    "b/poison6",
    "b/r7",
    "b/r8",
    "b/corrupt9",
    "c/r10",
    "c/r11",
]
GOOD = [name for name in NAMES if "corrupt" not in name and "poison" not in name]


def step_px(seed: int) -> float:
    """Step of the ball in each recording, which identifies the recording of a result."""
    return 1.0 + 0.25 * (seed % 12)


def write_recording(path: Path, seed: int) -> None:
    """Five frames of 64 x 64 px."""
    # Here, as the processes of an archive import this file and make no recording.
    import torch
    from shots import rotation_matrix, speckle

    from torchsphere.synthetic import ray_caster

    centres = torch.tensor([[22.0 + step_px(seed) * i, 32.3] for i in range(FRAMES)])
    turn = torch.deg2rad(torch.tensor([0.2, 0.6, 0.1], dtype=torch.float64))
    turned = torch.stack([rotation_matrix(turn * i) for i in range(FRAMES)]).float()
    images = ray_caster.render(speckle(0, RADIUS), centres, RADIUS, turned, BACKGROUND, shape=(64, 64), subsamples=2)
    path.parent.mkdir(parents=True, exist_ok=True)
    tifffile.imwrite(path, images.round().clamp(0, 255).numpy().astype(np.uint8), photometric="minisblack")


def write_array(path: Path, level: int) -> None:
    """A recording of one grey level, for the pretended measurement."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, np.full((3, 8, 9), level, np.uint8))


def write_archive(folder: Path, names: Iterable[str]) -> None:
    """Recordings of these names; a recording called corrupt is cut."""
    for seed, name in enumerate(names):
        path = folder / f"{name}.tif"
        write_recording(path, seed)
        if "corrupt" in name:
            path.write_bytes(path.read_bytes()[:9000])


def write_result(request: Request, extra: Mapping[str, Path], step: Sequence[float] | None = None) -> None:
    """A result folder as of `torchsphere.measure.measure`, without a report, and a line in the list of calls."""
    with atomic_output.atomic_folder(request.out, request.overwrite) as folder:
        for name, source in extra.items():
            (folder / name).write_bytes(source.read_bytes())
        table = {"input": {"sha256": hash_files([request.input])}, "frames_per_status": {"ok": 3}}
        table |= {"unusable": UNUSABLE.get(request.input.stem, ""), "settings": {"diameter_mm": request.diameter_mm}}
        table |= {"warning_levels": ["severe"] * SEVERE.get(request.input.stem, 0)}
        table |= {"mean_motion": {"increment_px_rad": step}, "frame_rate": request.fps}
        writer.write_summary(folder, table)
    with (request.input.parent / CALLS).open("a") as file:
        file.write(f"{shown(request.input.stem)}\n")


def measured(request: Request, progress: None, extra: Mapping[str, Path]) -> None:
    """Measure the ball's step; die on a poisonous recording, and wait on a held recording the first time.

    A step of the disc's middle identifies a recording, and each process is spared the loops of a track.
    """
    name, mark = request.input.stem, request.input.with_suffix(".pid")
    if "poison" in name:
        os.kill(os.getpid(), signal.SIGKILL)
    if "held" in name and not mark.exists():
        mark.with_suffix(".new").write_text(str(os.getpid()))
        mark.with_suffix(".new").rename(mark)
        time.sleep(2 * PATIENCE_S)
    with open_recording(request.input) as recording:
        images = np.asarray(recording.images(0, len(recording)))
    # Hardly any pixel of the ball has the level of the background.
    middles = [np.argwhere(image != BACKGROUND).mean(0)[::-1] for image in images]
    write_result(request, extra, ((middles[-1] - middles[0]) / (len(images) - 1)).tolist())


def pretended(request: Request, progress: None, extra: Mapping[str, Path]) -> None:
    """Write a result folder without tracking; a recording with the grey level `BAD` fails."""
    if np.load(request.input).max() == BAD:
        raise ValueError(f"{request.input}: is bad")
    write_result(request, extra)


def serial(jobs: Iterator[Job]) -> Iterator[Outcome]:
    """An engine in this process that pretends to measure."""
    for job in jobs:
        yield run_job(job, pretended)


def calls(folder: Path) -> list[str]:
    """Names of the recordings that were measured to the end, sorted."""
    return sorted(line for file in folder.rglob(CALLS) for line in file.read_text().split())


def wait_until(has_happened: Callable[[], bool], event: str) -> None:
    """Wait for an event."""
    end = time.monotonic() + PATIENCE_S
    while not has_happened():
        if time.monotonic() > end:
            raise TimeoutError(f"waited {PATIENCE_S:g} s in vain: {event}")
        time.sleep(0.02)


def pid_of(mark: Path) -> int:
    """The process that holds a recording, after a wait for the process."""
    wait_until(mark.exists, f"a process takes up the recording of {mark}")
    return int(mark.read_text())


def kill_holder(mark: Path) -> threading.Thread:
    """Kill the process that holds a recording, in a thread."""
    thread = threading.Thread(target=lambda: os.kill(pid_of(mark), signal.SIGKILL), daemon=True)
    thread.start()
    return thread


def arguments(source: Path, out: Path, **more: Any) -> dict[str, Any]:
    """Options of the command for an archive of these recordings."""
    none = dict.fromkeys(PER_RECORDING)
    fixed = {"source": [source], "out": out, "config": None, "scheduler": None, "workers": 2, "verbose": False}
    return {**none, **COMMON, **fixed, "shard": None, "retry_failed": False, "quiet": True, **more}


def rows(out: Path) -> dict[str, dict[str, str]]:
    with (out / "summary.csv").open(newline="") as stream:
        return {row["recording"]: row for row in csv.DictReader(stream)}


def check_the_whole(out: Path, source: Path) -> None:
    """Nine results of the right recordings, each measured once, and three failures with their reasons."""
    table = {name.removesuffix(".tif"): row for name, row in rows(out).items()}
    assert {name for name, row in table.items() if row["state"] == "done"} == set(GOOD)
    assert "worker process died" in table["b/poison6"]["reason"]
    assert all("cut" in table[name]["reason"] for name in ("a/corrupt4", "b/corrupt9"))
    assert calls(source) == sorted(Path(name).name for name in GOOD)
    for seed, name in enumerate(NAMES):
        if name in GOOD:
            step = json.loads((out / name / "summary.json").read_text())["mean_motion"]["increment_px_rad"][0]
            # Pixels of the background's level move the middle by hundredths of a px; recordings differ by 0.25 px.
            assert step == pytest.approx(step_px(seed), abs=0.08)
    assert not [path for path in out.rglob(".*.*") if path.is_dir() and path.parent.name != ".batch"]


if __name__ == "__main__":
    # Tests that a shell starts in the background ignore Ctrl-C, and processes inherit this.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.exit(batch.run(arguments(Path(sys.argv[1]), Path(sys.argv[2]), workers=int(sys.argv[3])), measured))
