"""A whole `ts.track` on a GPU: frames per second, share of time in which the GPU works, and equality with the CPU.

Claims: on the map the positions differ from the CPU's by 0.001 px at most. By pairs a position is a sum of steps, and
rounding decides now and then whether a batch is measured once more from better places: there no step differs by more
than one of its standard deviations. ``python -m experiments.speed.speed --part gpu`` on a machine with a GPU writes the
table of the page; the CPU's times are those of all cores of that machine.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

import torchsphere as ts
from experiments.experiment import Row, table
from experiments.speed.footage import SPIN, Array, Footage
from experiments.speed.scope import Scope

#: Radius, px, and frames of the recordings, and runs of each.
RECORDINGS, ROUNDS = ((50.0, 300), (50.0, 2000), (100.0, 300), (150.0, 300)), 3

#: Largest difference from the CPU of a position on the map, px, and of a step by pairs, standard deviations.
SAME_PX, SAME_SD = 1e-3, 1.0

#: Most frames of a track that torch's profiler looks at: it takes minutes for 2,000.
PROFILED_FRAMES = 300

GB = 1e9


@dataclass(frozen=True)
class OnGpu:
    """A recording on the GPU and on the CPU."""

    radius: float
    frames: int
    way: str
    gpu_s: float
    cpu_s: float
    busy_s: float  # time in which the GPU works; NaN where it was not looked at
    peak_gb: float  # memory of the GPU
    difference_px: float  # largest, of a position
    difference_sd: float  # largest, of a step, in its standard deviations
    same_status: bool


def busy_seconds(spans: Iterable[tuple[float, float]]) -> float:
    """Time that the spans (begin, end) cover together, in their unit; spans that overlap count once."""
    total, reached = 0.0, float("-inf")
    for begin, end in sorted(spans):
        total += max(end - max(begin, reached), 0.0)
        reached = max(reached, end)
    return total


def _seconds(images: Array, footage: Footage, sphere_map: bool | None, device: str) -> tuple[float, ts.Track]:
    """Best time of several runs, and the track; the first run on a GPU prepares the device."""
    times = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        # The track is in NumPy, so the GPU has finished when the call returns.
        found = ts.track(images, footage.circle(), sphere_map=sphere_map, device=device)
        times.append(time.perf_counter() - began)
    return min(times), found


def _busy(images: Array, footage: Footage, sphere_map: bool | None) -> float:
    """Time in which the GPU works during a track, s, by torch's profiler."""
    from torch.profiler import ProfilerActivity, profile

    with profile(activities=[ProfilerActivity.CUDA]) as profiled:
        ts.track(images, footage.circle(), sphere_map=sphere_map, device="cuda")
    events: Any = profiled.events()
    on_gpu = [event for event in events if event.device_type.name == "CUDA"]
    return 1e-6 * busy_seconds((event.time_range.start, event.time_range.end) for event in on_gpu)


def compute(scope: Scope) -> list[OnGpu]:
    """All recordings by both ways; none without a GPU."""
    found: list[OnGpu] = []
    if not torch.cuda.is_available():
        return found
    for radius, frames in RECORDINGS[: 1 if scope.quick else None]:
        if scope.allows(frames):
            footage = Footage(SPIN, radius)
            images = footage.images(frames)
            for way, sphere_map in (("default", None), ("by pairs", False)):
                scope.say(f"GPU, R = {radius:g} px, {frames} frames, {way}")
                found.append(_compared(images, footage, way, sphere_map))
    return found


def _compared(images: Array, footage: Footage, way: str, sphere_map: bool | None) -> OnGpu:
    torch.cuda.reset_peak_memory_stats()
    gpu_s, on_gpu = _seconds(images, footage, sphere_map, "cuda")
    peak = torch.cuda.max_memory_allocated() / GB
    cpu_s, on_cpu = _seconds(images, footage, sphere_map, "cpu")
    position = np.abs(on_gpu.position - on_cpu.position)
    sd = np.sqrt(np.diagonal(on_cpu.covariance, axis1=1, axis2=2))
    step = np.abs(on_gpu.increment - on_cpu.increment) / sd
    return OnGpu(
        radius=footage.radius,
        frames=len(images),
        way=way,
        gpu_s=gpu_s,
        cpu_s=cpu_s,
        busy_s=_busy(images, footage, sphere_map) if len(images) <= PROFILED_FRAMES else math.nan,
        peak_gb=peak,
        difference_px=float(np.nanmax(position)),
        difference_sd=float(np.nanmax(step)),
        same_status=bool((on_gpu.status == on_cpu.status).all()),
    )


def rows(found: list[OnGpu]) -> list[Row]:
    """The limits of the differences, where there is a GPU."""
    lines = []
    for way in dict.fromkeys(run.way for run in found):
        runs = [run for run in found if run.way == way]
        same = all(run.same_status for run in runs)
        said = "the same statuses" if same else "other statuses"
        if way == "default":
            worst, limit, unit = max(run.difference_px for run in runs), SAME_PX, "px"
        else:
            worst, limit, unit = max(run.difference_sd for run in runs), SAME_SD, "sd of a step"
        lines.append(
            Row(
                "speed",
                f"GPU as CPU, {way}",
                f"{limit:g} {unit}",
                f"{worst:.1g} {unit}, {said}",
                worst <= limit and same,
            )
        )
    return lines


def tables(found: list[OnGpu]) -> list[str]:
    """Table of the recordings under a sentence; without a GPU a sentence alone."""
    if not found:
        return ["No GPU was at hand, so that nothing was measured there.\n"]
    head = (
        "recording",
        "way",
        "GPU frames/s",
        "CPU frames/s",
        "GPU at work (%)",
        "GPU memory (GB)",
        "largest difference of a position (px)",
        "of a step (sd)",
    )
    lines = [
        (
            f"R = {run.radius:g} px, {run.frames:,} frames",
            run.way,
            f"{run.frames / run.gpu_s:.0f}",
            f"{run.frames / run.cpu_s:.0f}",
            "-" if math.isnan(run.busy_s) else f"{100 * run.busy_s / run.gpu_s:.0f}",
            f"{run.peak_gb:.1f}",
            f"{run.difference_px:.1g}",
            f"{run.difference_sd:.1g}",
        )
        for run in found
    ]
    head_line = f"`track` with a given circle, 0.57 deg per frame, on {torch.cuda.get_device_name()}"
    return [f"{head_line} and on {os.cpu_count()} cores beside it:\n\n{table(head, lines)}"]
