"""One measurement with clocks around its stages: ``python -m experiments.speed.timed_run TASK``, TASK being JSON.

The process prints a line of JSON: the fields of `experiments.speed.files.Run`. Only Python's own modules are imported
before the clock starts.
"""

from __future__ import annotations

import importlib
import json
import resource
import sys
import time
from pathlib import Path
from typing import Any

#: Timed functions: module, name, and the name of the time.
STAGES = (
    ("torchsphere.measure", "open_recording", "open_s"),
    ("torchsphere.tracking.start", "find_initial_circle", "circle_s"),
    ("torchsphere.measure", "track", "track_s"),
)


def put_clock(spent: dict[str, float], place: str, name: str, key: str) -> None:
    """Add the time of every call of the function to ``spent[key]``, s."""
    module = importlib.import_module(place)
    inner = getattr(module, name)
    spent[key] = 0.0

    def timed(*args: Any, **settings: Any) -> Any:
        start = time.perf_counter()
        try:
            return inner(*args, **settings)
        finally:
            spent[key] += time.perf_counter() - start

    setattr(module, name, timed)


def peak_gb() -> float:
    """Largest memory of this process alone; what the system counts for a child begins with its parent's memory."""
    status = Path("/proc/self/status").read_text().splitlines()
    return 1024e-9 * int(next(line.split()[1] for line in status if line.startswith("VmHWM")))


def run(task: dict[str, str]) -> dict[str, float]:
    """Measure the recording of a `experiments.speed.files.Task`."""
    begin = time.perf_counter()
    from torchsphere import measure

    spent = {"import_s": time.perf_counter() - begin}
    for stage in STAGES:
        put_clock(spent, *stage)
    request = measure.Request(
        input=Path(task["input"]), out=Path(task["out"]), fps=20000.0, diameter_mm=30.0, mass_g=110.0, map=task["map"]
    )
    done = measure.measure(request)
    wall = time.perf_counter() - begin
    usage = resource.getrusage(resource.RUSAGE_SELF)
    import numpy as np

    np.save(task["position"], done.track.position)
    in_track = spent.pop("track_s")
    return spent | {
        "frames": len(done.track.status),
        "wall_s": wall,
        "cpu_s": usage.ru_utime + usage.ru_stime,
        "follow_s": in_track - spent["circle_s"],
        "rest_s": wall - spent["import_s"] - spent["open_s"] - in_track,
        "peak_gb": peak_gb(),
        "ok": int((done.track.status == "ok").sum()),
        "on_map": getattr(done.track.findings.map, "frames", 0),
    }


if __name__ == "__main__":
    print(json.dumps(run(json.loads(sys.argv[1]))))
