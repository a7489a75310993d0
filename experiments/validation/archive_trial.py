"""An archive of 300 short recordings with faults: ``python -m experiments.validation.archive_trial``.

Two runs measure it at the same time. One recording kills its workers; three are cut, one is empty, one is a pipe; two
have workers that are killed; two have names of 226 bytes, and two names that are not UTF-8.

Claim: 294 results, six failures with their reasons, nothing measured twice, and nothing to do in a later run; with own
processes, with a Dask cluster, and after the parent was killed with SIGKILL in the middle. The trial also measures
time, memory and files of such short recordings; `experiments.speed.million` measures those of the demo's shot.

The trials take about half an hour on two cores. A number of recordings after the command makes them smaller, and names
of trials after the number leave out the others, whose earlier results stay. The recordings get no report, which would
take most of the time of such short recordings.
"""

from __future__ import annotations

import csv
import functools
import json
import logging
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
import torch

import torchsphere as ts
from experiments.experiment import OUTPUT, publish, table
from torchsphere.archive import dask_engine, manifest, processes
from torchsphere.archive.run import Counts, run
from torchsphere.archive.work import Job, Outcome
from torchsphere.measure import Request, measure
from torchsphere.runtime.shown_text import shown
from torchsphere.synthetic import ray_caster

COUNT, WORKERS, RADIUS, FRAMES = 300, 2, 12.0, 5
#: Recordings that cannot be measured: three that are cut, one that is empty, a pipe, and one that kills its workers.
BAD = 6
COMMON: dict[str, Any] = {
    "circle": (22.0, 32.3, RADIUS),
    "fps": 1000.0,
    "diameter_mm": 30.0,
    "map": "off",
    "report": False,
}
CALLS = "calls.txt"
OUT = OUTPUT / "archive_trial.json"


def _names(count: int) -> dict[int, str]:
    """Names of recordings that are not plain, by their number; several begin with their fault."""
    long, bytes_ = "n" * 214, os.fsdecode(b"caf\xe9")
    places = {1: "cut", 2: "empty", 3: "pipe", 4: long, 5: bytes_}
    places |= {count // 3: "held", count // 2: "poison", 2 * count // 3: "held"}
    places |= {count - 1: "cut", count - 2: "cut", count - 3: long, count - 4: bytes_}
    return places


def write_archive(folder: Path, count: int) -> None:
    """Recordings of five frames of 64 x 64 px in ten folders, some of which have a fault or an unusual name."""
    turn = torch.deg2rad(torch.tensor([0.2, 0.6, 0.1], dtype=torch.float64))
    vectors = torch.arange(FRAMES, dtype=torch.float64)[:, None] * turn
    turned = torch.stack([torch.matrix_exp(_cross(vector)) for vector in vectors]).float()
    pattern = ray_caster.speckle(0, radius_px=RADIUS)
    names = _names(count)
    for i in range(count):
        fault = names.get(i, "shot")
        path = folder / f"day{i % 10}" / f"{fault}{i:04d}.tif"
        path.parent.mkdir(parents=True, exist_ok=True)
        if fault == "pipe":
            os.mkfifo(path)
            continue
        centres = torch.tensor([[22.0 + (1 + 0.01 * i) * k, 32.3] for k in range(FRAMES)])
        images = ray_caster.render(pattern, centres, RADIUS, turned, 90.0, shape=(64, 64), subsamples=2)
        tifffile.imwrite(path, images.round().clamp(0, 255).numpy().astype(np.uint8), photometric="minisblack")
        if fault in ("cut", "empty"):
            path.write_bytes(path.read_bytes()[: 9000 if fault == "cut" else 0])


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
        file.write(f"{shown(request.input.name)}\n")


def _kill_waiting_workers(source: Path) -> None:
    killed: set[Path] = set()
    while len(killed) < 2:
        for mark in set(source.rglob("*.pid")) - killed:
            os.kill(int(mark.read_text()), signal.SIGKILL)
            killed.add(mark)
        time.sleep(0.05)


Engine = Callable[[Iterator[Job]], Iterator[Outcome]]
OWN: Engine = functools.partial(processes.run, workers=WORKERS, measure=faulty_measure)


def _run_elsewhere(source: Path, out: Path, scheduler: str = "") -> subprocess.Popen[bytes]:
    """Another run over the archive, in a process of its own."""
    command = [sys.executable, "-m", "experiments.validation.archive_trial", "--run", str(source), str(out)]
    return subprocess.Popen([*command, *filter(None, (scheduler,))])


def _by_scheduler(address: str) -> Engine:
    return functools.partial(dask_engine.run, address=address, measure=faulty_measure)


def trial(
    source: Path, out: Path, engine: Engine, scheduler: str = "", prepare: Callable[[], None] = lambda: None
) -> dict[str, Any]:
    """Two runs over the archive while workers are killed, then a later run; ``prepare`` is called before all."""
    began = time.perf_counter()
    killer = threading.Thread(target=_kill_waiting_workers, args=(source,), daemon=True)
    killer.start()
    prepare()
    with _run_elsewhere(source, out, scheduler) as beside:
        first = run(manifest.read(source, COMMON, out), out, engine, changed=_show)
        beside_code = beside.wait()
    seconds = time.perf_counter() - began
    began = time.perf_counter()
    later = run(manifest.read(source, COMMON, out), out, engine)
    calls = Counter((source / CALLS).read_text().split())
    with (out / "summary.csv").open(newline="") as stream:
        reasons = {row["recording"]: row["reason"] for row in csv.DictReader(stream) if row["state"] == "failed"}
    return {
        "done": first.done,
        "done_later": later.done,
        "other_run": beside_code,
        "reasons": reasons,
        "measured_twice": sum(count > 1 for count in calls.values()),
        "measured_in_later_run": later.measured,
        "results": len(list(out.rglob("summary.json"))),
        "left_over": len([p for p in out.rglob(".*.*") if p.is_dir()]),
        "seconds": seconds,
        "seconds_later_run": time.perf_counter() - began,
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
    import dask
    from distributed import LocalCluster

    write_archive(folder / "in", count)
    # The cluster gives up a worker that was killed and takes longer to start again, as on a busy machine.
    dask.config.set({"distributed.deploy.lost-worker-timeout": "600s"})
    with LocalCluster(
        n_workers=WORKERS, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=logging.CRITICAL
    ) as cluster:
        address = cluster.scheduler_address
        return trial(folder / "in", folder / "out", _by_scheduler(address), address)


def _with_parent_killed(folder: Path, count: int) -> dict[str, Any]:
    source, out = folder / "in", folder / "out"
    write_archive(source, count)
    when: dict[str, int] = {}

    def kill_parent() -> None:
        with _run_elsewhere(source, out) as parent:
            while _count_results(out) < count * 5 // 8:
                time.sleep(0.1)
            parent.kill()
        when["done"] = _count_results(out)

    return {**trial(source, out, OWN, prepare=kill_parent), "done_when_killed": when["done"]}


def _count_results(out: Path) -> int:
    """Number of complete results; folders of results in progress have names that begin with a dot."""
    found = 0
    for _, folders, files in os.walk(out):
        folders[:] = [name for name in folders if not name.startswith(".")]
        found += "summary.json" in files
    return found


TRIALS = {"own processes": _by_processes, "Dask": _by_dask, "parent killed": _with_parent_killed}


def compute(count: int, trials: Sequence[str]) -> dict[str, Any]:
    """The trials, and earlier ones of as many recordings; kept in ``experiments/output/archive_trial.json``."""
    found: dict[str, Any] = {"count": count, "workers": WORKERS, "version": ts.__version__}
    earlier = json.loads(OUT.read_text()) if OUT.exists() else {}
    if all(earlier.get(key) == value for key, value in found.items()):
        found = earlier
    with tempfile.TemporaryDirectory() as name:
        for key in trials:
            found[key] = TRIALS[key](Path(name) / key.replace(" ", "-"), count)
            OUT.parent.mkdir(exist_ok=True)
            OUT.write_text(json.dumps(found, indent=1))
    return found


def holds(found: Mapping[str, Any], count: int) -> bool:
    """Whether a trial confirms the claim."""
    nothing = found["measured_twice"] == found["measured_in_later_run"] == found["left_over"] == found["other_run"] == 0
    all_done = found["done"] == found["done_later"] == found["results"] == count - BAD
    return nothing and all_done and len(found["reasons"]) == BAD


def main() -> None:
    """Run the trials and write their tables."""
    count, *trials = sys.argv[1:] or [str(COUNT)]
    write_tables(compute(int(count), trials or list(TRIALS)))


def write_tables(found: Mapping[str, Any]) -> None:
    """Write the tables of the page: the trials, and the reasons of failures."""
    count = found["count"]
    head = (f"{count} recordings", "results", "failed", "measured twice", "later run measured", "s", "as it should be")
    lines = []
    for key in (key for key in TRIALS if key in found):
        row = found[key]
        counts = (row["results"], len(row["reasons"]), row["measured_twice"], row["measured_in_later_run"])
        lines.append((key, *counts, f"{row['seconds']:.0f}", "yes" if holds(row, count) else "NO"))
    own = found.get("own processes") or found[key]
    reasons = ((recording, _short(reason)) for recording, reason in sorted(own["reasons"].items()))
    publish("archive", "validation.archive_trial", table(head, lines), table(("failed", "its reason"), reasons))
    if "kB_per_result" in own:
        # Two runs, each with its workers.
        seconds, size = own["seconds"] * 2 * WORKERS / own["results"], own["kB_per_result"]
        files, held = own["files_per_result"], own["worker_MB"]
        print(f"A recording, by a worker of {2 * WORKERS}: {seconds:.2f} s, {files:.0f} files, {size:.0f} kB.")
        print(f"A worker held {held:.0f} MB.")


def _short(reason: str) -> str:
    """A reason without the temporary folder."""
    return re.sub(r"/\S*/(?=day\d)", "", reason)


def _run_as_told(source: Path, out: Path, scheduler: str = "") -> None:
    run(manifest.read(source, COMMON, out), out, _by_scheduler(scheduler) if scheduler else OWN)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--run"]:
        _run_as_told(Path(sys.argv[2]), Path(sys.argv[3]), *sys.argv[4:])
    else:
        main()
