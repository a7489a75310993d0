"""Speed and memory, in one run: pairs, whole tracks, recordings from the file to the report, GPU, a million recordings.

Command: ``python -m experiments.speed.speed`` (a quarter of an hour, and 3 GB of temporary files). Nothing is cached,
because a time belongs to its machine. The claims stand in the modules of the parts. ``--quick`` takes about a minute,
with small recordings. ``--part`` (once or more) measures these parts alone, ``--frames-limit N`` leaves out longer
recordings. Only a full run writes the tables of the pages, and ``--part gpu`` that of the GPU, where there is one.
"""

from __future__ import annotations

import argparse
from types import ModuleType

from experiments.experiment import Row, claims, publish
from experiments.speed import gpu, million, pairs, recordings, tracks
from experiments.speed.scope import Scope

#: Parts in the order of the page; `million` and `gpu` have tables of their own.
PARTS: dict[str, ModuleType] = {"pairs": pairs, "tracks": tracks, "recordings": recordings, "gpu": gpu}


def main() -> None:
    """Measure and print; publish a full run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="small recordings of R = 50 px alone")
    parser.add_argument("--part", action="append", choices=(*PARTS, "million"), help="measure this part alone")
    parser.add_argument("--frames-limit", type=int, metavar="N", help="leave out recordings of more frames")
    options = parser.parse_args()
    scope = Scope(options.quick, options.frames_limit)
    is_full = not options.quick and options.part is None and options.frames_limit is None
    chosen = options.part or (list(PARTS) if options.quick else [*PARTS, "million"])
    shown: list[str] = []
    limits: list[Row] = []
    for name, part in PARTS.items():
        if name in chosen:
            found = part.compute(scope)
            limits += part.rows(found)
            if part is gpu:
                _show_gpu(found, is_whole=not options.quick and options.frames_limit is None)
            else:
                shown += part.tables(found)
                print("\n".join(part.tables(found)), flush=True)
    if is_full:
        publish("speed", "speed.speed", *shown)
    if "million" in chosen:
        costs = million.tables(million.compute(scope))
        print("\n".join(costs), flush=True)
        if is_full:
            publish("million", "speed.million", *costs)
    print(claims(limits))


def _show_gpu(found: list[gpu.OnGpu], *, is_whole: bool) -> None:
    """Publish the table of the GPU; one that is not whole, or of no GPU, is only printed."""
    if found and is_whole:
        publish("gpu", "speed.speed --part gpu", *gpu.tables(found))
    else:
        print("\n".join(gpu.tables(found)), flush=True)


if __name__ == "__main__":
    main()
