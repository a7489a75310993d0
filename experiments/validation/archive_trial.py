"""An archive of 200 short recordings with faults: ``python -m experiments.validation.archive_trial``.

One recording kills its worker, three are corrupt, and a worker is killed during the run.

Claim: 196 results, four failures with their reasons, nothing measured twice, and nothing to do in a second run; with
own processes, with a Dask cluster, and after the parent was killed with SIGKILL in the middle. The trial also measures
time, memory and files of such short recordings; `experiments.speed.million` measures those of the demo's shot.

The trial takes about a quarter of an hour on two cores; a number of recordings after the command makes it smaller. Its
recordings get no report, which would take most of the time of such short recordings.
"""

from __future__ import annotations

import csv
import functools
import json
import logging
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
import torch

import torchsphere as ts
from experiments.experiment import OUTPUT, table
from torchsphere.archive import dask_engine, manifest, processes
from torchsphere.archive.run import Counts, run
from torchsphere.archive.work import Job, Outcome
from torchsphere.measure import Request, measure
from torchsphere.synthetic import ray_caster

COUNT, WORKERS, RADIUS, FRAMES = 200, 2, 12.0, 5
COMMON: dict[str, Any] = {
    "circle": (22.0, 32.3, RADIUS),
    "fps": 1000.0,
    "diameter_mm": 30.0,
    "map": "off",
    "report": False,
}
CALLS = "calls.txt"
OUT = OUTPUT / "archive_trial.json"


def write_archive(folder: Path, count: int) -> None:
    """Recordings of five frames of 64 x 64 px in ten folders.

    One recording kills its worker, one waits for the killer, and three are cut.
    """
    turn = torch.deg2rad(torch.tensor([0.2, 0.6, 0.1], dtype=torch.float64))
    vectors = torch.arange(FRAMES, dtype=torch.float64)[:, None] * turn
    turned = torch.stack([torch.matrix_exp(_cross(vector)) for vector in vectors]).float()
    pattern = ray_caster.speckle(0, radius_px=RADIUS)
    special = {count // 3: "held", count // 2: "poison", 7: "corrupt", count // 4: "corrupt", count - 3: "corrupt"}
    for i in range(count):
        path = folder / f"day{i % 10}" / f"{special.get(i, 'shot')}{i:04d}.tif"
        path.parent.mkdir(parents=True, exist_ok=True)
        centres = torch.tensor([[22.0 + (1 + 0.01 * i) * k, 32.3] for k in range(FRAMES)])
        images = ray_caster.render(pattern, centres, RADIUS, turned, 90.0, shape=(64, 64), subsamples=2)
        tifffile.imwrite(path, images.round().clamp(0, 255).numpy().astype(np.uint8), photometric="minisblack")
        if i in special and special[i] == "corrupt":
            path.write_bytes(path.read_bytes()[:9000])


def _cross(v: torch.Tensor) -> torch.Tensor:
    x, y, z = v.tolist()
    return torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=torch.float64)


def faulty_measure(request: Request, progress: None, extra: Mapping[str, Path]) -> None:
    """Measure, and record the call; kill the worker on "poison", wait to be killed on "held"."""
    mark = request.input.with_suffix(".pid")
    if "poison" in request.input.name:
        os.kill(os.getpid(), signal.SIGKILL)
    if "held" in request.input.name and not mark.exists():
        mark.with_suffix(".new").write_text(str(os.getpid()))
        mark.with_suffix(".new").rename(mark)
        time.sleep(600)
    measure(request, progress, extra)
    status = Path("/proc/self/status")
    if status.exists():
        # The peak of this process alone; what the system counts for children begins with their parent's.
        peak = next(line.split()[1] for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        (request.input.parents[1] / f"peak-{os.getpid()}").write_text(peak)
    with (request.input.parents[1] / CALLS).open("a") as file:
        file.write(f"{request.input.name}\n")


def _kill_waiting_worker(source: Path) -> None:
    while not (marks := list(source.rglob("*.pid"))):
        time.sleep(0.05)
    os.kill(int(marks[0].read_text()), signal.SIGKILL)


Engine = Callable[[Iterator[Job]], Iterator[Outcome]]
OWN: Engine = functools.partial(processes.run, workers=WORKERS, measure=faulty_measure)


def trial(source: Path, out: Path, engine: Engine, prepare: Callable[[], None] = lambda: None) -> dict[str, Any]:
    """Run over the archive while a worker is killed, then run again; ``prepare`` is called before both."""
    began = time.perf_counter()
    killer = threading.Thread(target=_kill_waiting_worker, args=(source,), daemon=True)
    killer.start()
    prepare()
    archive = manifest.read(source, COMMON, out)
    first = run(archive, out, engine, changed=_show)
    seconds = time.perf_counter() - began
    began = time.perf_counter()
    second = run(manifest.read(source, COMMON, out), out, engine)
    calls = Counter((source / CALLS).read_text().split())
    with (out / "summary.csv").open(newline="") as stream:
        reasons = {row["recording"]: row["reason"] for row in csv.DictReader(stream) if row["state"] == "failed"}
    return {
        "done": first.done,
        "reasons": reasons,
        "measured_twice": sum(count > 1 for count in calls.values()),
        "measured_in_second_run": second.measured,
        "results": len(list(out.rglob("summary.json"))),
        "left_over": len([p for p in out.rglob(".*.*") if p.is_dir()]),
        "seconds": seconds,
        "seconds_second_run": time.perf_counter() - began,
    }


def _show(counts: Counts) -> None:
    print(f"\r{counts.done} done, {counts.failed} failed of {counts.total} ", end="", file=sys.stderr, flush=True)


def _by_processes(folder: Path, count: int) -> dict[str, Any]:
    write_archive(folder / "in", count)
    found = trial(folder / "in", folder / "out", OWN)
    files = [path for path in (folder / "out").rglob("*") if path.is_file()]
    state = [path for path in files if ".batch" in path.parts]
    found["files_per_result"] = (len(files) - len(state)) / found["results"]
    found["kB_per_result"] = sum(p.stat().st_size for p in files if p not in set(state)) / found["results"] / 1e3
    found["worker_MB"] = max((int(p.read_text()) for p in (folder / "in").glob("peak-*")), default=0) / 1e3
    return found


def _by_dask(folder: Path, count: int) -> dict[str, Any]:
    from distributed import LocalCluster

    write_archive(folder / "in", count)
    with LocalCluster(
        n_workers=WORKERS, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
    ) as cluster:
        engine = functools.partial(dask_engine.run, address=cluster.scheduler_address, measure=faulty_measure)
        return trial(folder / "in", folder / "out", engine)


def _with_parent_killed(folder: Path, count: int) -> dict[str, Any]:
    source, out = folder / "in", folder / "out"
    write_archive(source, count)
    when: dict[str, int] = {}

    def kill_parent() -> None:
        with subprocess.Popen(
            [sys.executable, "-m", "experiments.validation.archive_trial", "--run", str(source), str(out)]
        ) as parent:
            while _count_results(out) < count * 5 // 8:
                time.sleep(0.1)
            parent.kill()
        when["done"] = _count_results(out)

    return {**trial(source, out, OWN, kill_parent), "done_when_killed": when["done"]}


def _count_results(out: Path) -> int:
    """Number of complete results; folders of results in progress have names that begin with a dot."""
    found = 0
    for _, folders, files in os.walk(out):
        folders[:] = [name for name in folders if not name.startswith(".")]
        found += "summary.json" in files
    return found


def compute(count: int = COUNT) -> dict[str, Any]:
    """All trials; kept in ``experiments/output/archive_trial.json``."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        found: dict[str, Any] = {"count": count, "workers": WORKERS, "version": ts.__version__}
        for key, how in (("own processes", _by_processes), ("Dask", _by_dask), ("parent killed", _with_parent_killed)):
            found[key] = how(folder / key.replace(" ", "-"), count)
            OUT.parent.mkdir(exist_ok=True)
            OUT.write_text(json.dumps(found, indent=1))
    return found


def holds(found: Mapping[str, Any], count: int) -> bool:
    """Whether a trial confirms the claim."""
    nothing = found["measured_twice"] == found["measured_in_second_run"] == found["left_over"] == 0
    return nothing and found["done"] == found["results"] == count - 4 and len(found["reasons"]) == 4


def main() -> None:
    """Run the trials and print the table."""
    found = compute(int(sys.argv[1]) if len(sys.argv) > 1 else COUNT)
    count = found["count"]
    head = (f"{count} recordings", "results", "failed", "measured twice", "second run measured", "s", "holds")
    lines = []
    for key in ("own processes", "Dask", "parent killed"):
        row = found[key]
        counts = (row["results"], len(row["reasons"]), row["measured_twice"], row["measured_in_second_run"])
        lines.append((key, *counts, f"{row['seconds']:.0f}", "yes" if holds(row, count) else "NO"))
    print("\n" + table(head, lines))
    own = found["own processes"]
    seconds, size = own["seconds"] * WORKERS / own["results"], own["kB_per_result"]
    print(
        f"A recording, by a worker of {WORKERS}: {seconds:.2f} s, {own['files_per_result']:.0f} files, {size:.0f} kB."
    )
    print(f"A worker held {own['worker_MB']:.0f} MB.\n")
    for recording, reason in sorted(own["reasons"].items()):
        print(f"  {recording}: {reason}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--run"]:
        here = Path(sys.argv[3])
        run(manifest.read(Path(sys.argv[2]), COMMON, here), here, OWN)
    else:
        main()
