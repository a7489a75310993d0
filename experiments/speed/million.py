"""A million recordings on paper, from the measured cost of a few: ``python -m experiments.speed.million`` (a minute).

The shot is the demo's: 71 frames, ball of 40 px. A worker is a process with one thread, as `torchsphere batch` starts
them. The run's own lists are measured on 10,000 recordings which are all missing.
"""

from __future__ import annotations

import multiprocessing
import resource
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from experiments.experiment import publish, table
from experiments.speed.files import SPINNING, write
from experiments.speed.scope import Scope
from experiments.speed.timed_run import peak_gb
from torchsphere.archive import manifest
from torchsphere.archive.run import run
from torchsphere.archive.work import Job, Outcome, run_job
from torchsphere.measure import Request, measure
from torchsphere.synthetic import demo_shot

#: Recordings on paper, cores that share them, recordings of the lists, and frames of the longer recording.
MILLION, CORES, LISTED, LONGER = 1_000_000, 64, 10_000, 500

#: Times of the shot: the best of so many runs counts.
ROUNDS = 3

#: Ways to measure the shot: name, ``--map``, whether the circle is given, and whether there is a report.
WAYS = (
    ("default", "auto", False, False),
    ("default, circle given", "auto", True, False),
    ("default, with report", "auto", False, True),
    ("by pairs (`--map off`)", "off", False, False),
    ("by pairs, circle given", "off", True, False),
)


@dataclass(frozen=True)
class Shot:
    """Cost of a recording: time, files of its result, and their size."""

    seconds: float
    files: int
    kilobytes: float


@dataclass(frozen=True)
class Lists:
    """Cost of a recording in the run's own lists: time in a first and a second run, memory of the parent."""

    ms_first: float
    ms_second: float
    kilobytes: float


@dataclass(frozen=True)
class Costs:
    """What was measured; memory of a worker, GB, on short recordings and on a longer one with its report."""

    shots: dict[str, Shot]
    lists: Lists
    short_gb: float
    longer_gb: float


def cost_of_lists(folder: Path) -> Lists:
    """Time and memory of the manifest and the records; the growth of this process is the memory."""

    def serial(jobs: Iterator[Job]) -> Iterator[Outcome]:
        return (run_job(job, measure) for job in jobs)

    sheet, out = folder / "list.csv", folder / "out"
    sheet.write_text("recording,fps\n" + "".join(f"{i // 100}/{i}.cine,{1000 + i}\n" for i in range(LISTED)))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    times = []
    for _ in range(2):
        began = time.perf_counter()
        run(manifest.read(sheet, {}, out), out, serial)
        times.append(1e3 * (time.perf_counter() - began) / LISTED)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return Lists(times[0], times[1], grown * 1.024 / LISTED)


def cost_of_shots(folder: Path, shot: Path, circle: tuple[float, float, float], longer: Path) -> dict[str, Any]:
    """Cost of the shot by each way on one thread, and memory of this process, GB."""
    torch.set_num_threads(1)
    found: dict[str, Any] = {"shots": {}}
    for name, sphere_map, is_given, report in WAYS:
        out = folder / "result"
        request = Request(
            input=shot,
            out=out,
            fps=demo_shot.FRAME_RATE,
            diameter_mm=demo_shot.DIAMETER_MM,
            mass_g=demo_shot.MASS_G,
            map=sphere_map,
            circle=circle if is_given else None,
            report=report,
            overwrite=True,
        )
        # The first of the runs also loads and compiles what a worker loads and compiles once.
        seconds = min(_seconds(request) for _ in range(ROUNDS))
        files = [path for path in out.rglob("*") if path.is_file()]
        found["shots"][name] = Shot(seconds, len(files), sum(path.stat().st_size for path in files) / 1e3)
    found["short_gb"] = peak_gb()
    measure(Request(input=longer, out=folder / "longer", fps=20000.0, diameter_mm=30.0, mass_g=110.0))
    return found | {"longer_gb": peak_gb()}


def _seconds(request: Request) -> float:
    began = time.perf_counter()
    measure(request)
    return time.perf_counter() - began


def _alone(work: Callable[..., Any], *arguments: Any) -> Any:
    """The result of ``work`` in a new process, whose memory is its own."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        return pool.submit(work, *arguments).result()


def compute(scope: Scope) -> Costs:
    """All costs."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scope.say("lists of an archive")
        lists = _alone(cost_of_lists, folder)
        scope.say("one shot of an archive")
        made = demo_shot.make_shot()
        path, _ = demo_shot.write_shot(folder, made)
        circle = (*made.position[0].tolist(), demo_shot.RADIUS_PX)
        longer = write(folder / "longer.tif", SPINNING, LONGER)
        return Costs(lists=lists, **_alone(cost_of_shots, folder, path, circle, longer))


def tables(found: Costs) -> list[str]:
    """Table of a million recordings under a sentence, and the memory in words."""
    lines = []
    for name, shot in found.shots.items():
        hours = shot.seconds * MILLION / 3600
        # The run adds a file of its own to each result.
        size = (f"{(shot.files + 1) * MILLION / 1e6:.0f} million", f"{shot.kilobytes * MILLION / 1e9:.2f} TB")
        lines.append((name, f"{shot.seconds:.2f} s", f"{hours:.0f}", f"{hours / CORES:.1f} h", *size))
    head = ("way", "a recording", "core hours", f"on {CORES} cores", "files", "size")
    lists = found.lists
    minutes = [ms * MILLION / 60e3 for ms in (lists.ms_first, lists.ms_second)]
    return [
        "A million shots of 71 frames, ball of 40 px, one thread each; the outline is found unless it is given:\n",
        table(head, lines),
        f"A worker held {found.short_gb:.2f} GB on these shots and {found.longer_gb:.2f} GB on {LONGER} frames with "
        f"report, so {CORES} of them take {CORES * found.short_gb:.0f} to {CORES * found.longer_gb:.0f} GB.\n",
        f"The run's own lists take {minutes[0]:.0f} minutes, {minutes[1]:.0f} in a second run, and "
        f"{lists.kilobytes * MILLION / 1e6:.0f} GB of memory of the parent process.\n",
    ]


def main() -> None:
    """Measure and publish."""
    publish("million", "speed.million", *tables(compute(Scope())))


if __name__ == "__main__":
    main()
