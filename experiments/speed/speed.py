"""Time of a pair of images and of a whole recording, and memory over the number of frames.

Claim: at R = 50 px a pair takes 0.5 ms or less on two cores, or a quarter of OpenCV's ECC and of a plain numpy
Gauss-Newton. A whole track from an 8 bit TIFF of 256 x 512 px runs at 500 frames per second, including all files that
are written. The memory does not grow with the number of frames.

Command: ``python -m experiments.speed.speed`` (ten minutes, and 3 GB of temporary files; ``--quick`` a minute, without
the 20,000 frames). Nothing is cached, because a time belongs to its machine. All methods take the same pairs in turns.
The best of several rounds counts, because other programs can only make a time longer.

Paper: 0.38 s per pair of 256 x 512 px images, in Matlab on a laptop of 2013 (section 2.3).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

import torchsphere as ts
from experiments.experiment import Row, claims, publish, table
from experiments.speed.files import Run, measured
from experiments.speed.rivals import ecc, lucas_kanade, plain_gauss_newton
from experiments.validation.accuracy import Case, Shot, make_shot

Array = NDArray[Any]

RADII, BATCHES, ROUNDS = (15, 30, 50, 100, 150), (1, 4, 8, 16, 32, 64, 128), 7

#: Pairs of each timing at R = 50 px, and the least number of pairs: larger balls get fewer.
PAIRS, FEWEST_PAIRS = 128, 4

#: Limits: ms per pair, share of the rivals' time, frames per second, MiB, and growth of the memory.
PAIR_MS, SHARE, FRAMES_PER_S, PEAK_MIB, GROWTH = 0.5, 0.25, 500.0, 1536.0, 1.10

#: Suffixes of recordings with the names of their formats.
FORMATS = {"tif": "TIFF", "cih": "MRAW", "mp4": "MP4 (H.264)"}

#: Frames of the recordings by format, and those whose memory is compared.
FILES, LENGTHS = (("tif", 2000), ("cih", 2000), ("mp4", 2000)), (500, 1000, 2000, 5000, 20000)


@dataclass(frozen=True)
class Timing:
    """Times per pair, ms: wall time, and processor time of all threads."""

    wall_ms: float
    cpu_ms: float


def _timed(work: Callable[[], Any], pairs: int, rounds: int) -> Timing:
    """The best of several rounds."""
    walls, cpus = [], []
    for _ in range(rounds):
        wall, cpu = time.perf_counter(), time.process_time()
        work()
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    return Timing(1e3 * min(walls) / pairs, 1e3 * min(cpus) / pairs)


def _torchsphere_work(shot: Shot, n: int, device: str) -> Callable[[], Any]:
    """`ts.correlate` on ``n`` pairs at once, from the mean step without rotation, as a tracker predicts."""
    images = shot.images[: n + 1].to(device)
    circles = np.column_stack((shot.position[:n], np.full(n, shot.radius)))
    start = np.array([*shot.increment[:, :2].mean(0), 0, 0, 0])

    def work() -> None:
        found = ts.correlate(images[:-1], images[1:], circles, start=start)
        if set(found.status) != {"ok"}:
            raise RuntimeError(f"pairs were not measured: {found.status}")

    return work


def _rival_work(shot: Shot, n: int, way: Callable[[Array, Array, Array], Array]) -> Callable[[], Any]:
    """A rival on the same pairs, one after the other."""
    images = shot.images[: n + 1].numpy().astype(np.uint8)
    circles = np.column_stack((shot.position[:n], np.full(n, shot.radius)))
    return lambda: [way(f, g, circle) for f, g, circle in zip(images[:-1], images[1:], circles, strict=True)]


def ways(shot: Shot, n: int, threads: int) -> dict[str, Timing]:
    """Times of all methods on ``n`` pairs, in one run."""
    import cv2

    found: dict[str, Timing] = {}
    rivals = {
        "plain five-mode Gauss-Newton, numpy and scipy": plain_gauss_newton,
        "OpenCV ECC (two translations)": ecc,
        "OpenCV Lucas-Kanade with a five-mode fit": lucas_kanade,
    }
    for count in sorted({1, threads}):
        torch.set_num_threads(count)
        cv2.setNumThreads(count)
        found[f"torchsphere, {count} thread"] = _timed(_torchsphere_work(shot, n, "cpu"), n, ROUNDS)
        for name, way in rivals.items():
            found[f"{name}, {count} thread"] = _timed(_rival_work(shot, n, way), n, ROUNDS)
    if torch.cuda.is_available():
        # The status is on the CPU, so the GPU has finished when the call returns.
        work = _torchsphere_work(shot, n, "cuda")
        work()
        found["torchsphere, GPU"] = _timed(work, n, ROUNDS)
    return found


def shot_of(radius: float, pairs: int) -> Shot:
    """The example shot at another size: the pattern grows with the ball."""
    return make_shot(Case(radius=radius, speckle=4 * max(radius / 50, 0.7), frames=pairs + 1), 0)


def compute(quick: bool, threads: int) -> dict[str, Any]:
    """All times: by radius, by batch, by format and by length."""
    by_radius = {}
    for radius in (50,) if quick else RADII:
        pairs = max(FEWEST_PAIRS, min(PAIRS, round(PAIRS * (50 / radius) ** 2)))
        print(f"radius {radius} px", file=sys.stderr, flush=True)
        by_radius[radius] = ways(shot_of(radius, pairs), pairs, threads)
    torch.set_num_threads(1)
    shot = shot_of(50, max(BATCHES))
    by_batch = {n: _timed(_torchsphere_work(shot, n, "cpu"), n, ROUNDS) for n in BATCHES}
    torch.set_num_threads(threads)
    runs = {}
    for kind, count in FILES:
        print(f"{count} frames, {kind}", file=sys.stderr, flush=True)
        runs[kind] = measured(kind, count)
    lengths = {}
    for count in LENGTHS[:3] if quick else LENGTHS:
        print(f"{count} frames", file=sys.stderr, flush=True)
        lengths[count] = measured("cih", count)
    return {"radius": by_radius, "batch": by_batch, "files": runs, "lengths": lengths, "threads": threads}


def rows(found: dict[str, Any]) -> list[Row]:
    """The limits beside the times."""
    best = {name: time.wall_ms for name, time in found["radius"][50].items()}
    ours = min(ms for name, ms in best.items() if name.startswith("torchsphere") and "GPU" not in name)
    limits = [SHARE * min(ms for name, ms in best.items() if name.startswith(way)) for way in ("OpenCV ECC", "plain")]
    limit = min(PAIR_MS, *limits)
    tiff = found["files"]["tif"]
    rate = tiff.frames / tiff.wall_s
    of_track = tiff.frames / (tiff.open_s + tiff.circle_s + tiff.follow_s)
    results = [
        Row("speed", "a pair at R = 50 px", f"{limit:.2f} ms", f"{ours:.2f} ms", ours <= limit),
        Row(
            "speed",
            "2,000 frames of a TIFF, everything written",
            f"{FRAMES_PER_S:.0f} frames/s",
            f"{rate:.0f} frames/s; opened, found and followed alone {of_track:.0f}",
            rate >= FRAMES_PER_S,
        ),
    ]
    if 20000 in found["lengths"]:
        peak, before = found["lengths"][20000].peak_mib, found["lengths"][5000].peak_mib
        results.append(
            Row(
                "speed",
                "peak memory of 20,000 frames, against 5,000",
                f"{PEAK_MIB:.0f} MiB, {GROWTH:.2f}",
                f"{peak:.0f} MiB, {peak / before:.2f}",
                peak <= PEAK_MIB and peak <= GROWTH * before,
            )
        )
    return results


def _recording_cells(label: str, run: Run) -> list[str]:
    stages = (run.import_s, run.open_s, run.circle_s, run.follow_s, run.rest_s)
    cells = [f"{run.wall_s:.1f}", f"{run.frames / run.wall_s:.0f}", *(f"{s:.1f}" for s in stages)]
    return [label, *cells, f"{run.peak_mib:.0f}", str(run.ok)]


def tables(found: dict[str, Any]) -> list[str]:
    """Tables of the times by radius, by batch and by recording, each under a sentence."""
    times, batches = found["radius"], found["batch"].items()
    lines = [[name, *(f"{t[name].wall_ms:.2f} ({t[name].cpu_ms:.2f})" for t in times.values())] for name in times[50]]
    by_radius = table(("way", *(f"R = {radius} px" for radius in times)), lines)
    by_batch = table(("pairs at once", "ms"), [(n, f"{t.wall_ms:.2f} ({t.cpu_ms:.2f})") for n, t in batches])
    runs = [_recording_cells(f"{run.frames:,} frames, {FORMATS[kind]}", run) for kind, run in found["files"].items()]
    runs += [_recording_cells(f"{count:,} frames, MRAW", run) for count, run in found["lengths"].items()]
    head = ("recording", "s", "frames/s", "load", "open", "find", "follow", "the rest", "peak MiB", "frames ok")
    return [
        f"A pair of images, ms; the processor's time in brackets:\n\n{by_radius}",
        f"Pairs of R = 50 px on one thread, by the number of pairs at once:\n\n{by_batch}",
        f"A whole `track`, in a process of its own:\n\n{table(head, runs)}",
    ]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="R = 50 px alone, and no long recordings")
    options = parser.parse_args()
    found = compute(options.quick, torch.get_num_threads())
    if options.quick:
        print("\n".join(tables(found)))
    else:
        publish("speed", "speed.speed", *tables(found))
    counts = np.array(list(found["lengths"]))
    seconds = np.array([run.follow_s for run in found["lengths"].values()])
    slope = np.polyfit(np.log(counts), np.log(seconds), 1)[0]
    print(f"\nThe time to follow goes with the number of frames to the power {slope:.2f}.\n")
    print(claims(rows(found)))


if __name__ == "__main__":
    main()
