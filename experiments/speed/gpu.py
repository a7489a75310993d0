"""A whole `ts.track` on a GPU: frames per second, share of time in which the GPU works, and equality with the CPU.

Claim: the positions differ from the CPU's by 0.001 px at most. On a machine without a GPU the table says so.
"""

from __future__ import annotations

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

#: Frames of the recordings, runs of each, and largest difference of a position from the CPU's, px.
LENGTHS, ROUNDS, SAME_PX = (300, 2000), 3, 1e-3


@dataclass(frozen=True)
class OnGpu:
    """A recording on the GPU and on the CPU."""

    frames: int
    way: str
    gpu_s: float
    cpu_s: float
    busy_s: float  # time in which the GPU works
    difference_px: float
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
    footage = Footage(SPIN)
    for frames in filter(scope.allows, LENGTHS[:1] if scope.quick else LENGTHS):
        images = footage.images(frames)
        for name, sphere_map in (("default", None), ("by pairs", False)):
            scope.say(f"GPU, {frames} frames, {name}")
            gpu_s, on_gpu = _seconds(images, footage, sphere_map, "cuda")
            cpu_s, on_cpu = _seconds(images, footage, sphere_map, "cpu")
            difference = np.abs(on_gpu.position - on_cpu.position)
            same = bool((on_gpu.status == on_cpu.status).all())
            busy = _busy(images, footage, sphere_map)
            found.append(OnGpu(frames, name, gpu_s, cpu_s, busy, float(np.nanmax(difference)), same))
    return found


def rows(found: list[OnGpu]) -> list[Row]:
    """The limit of the difference, where there is a GPU."""
    if not found:
        return []
    worst = max(run.difference_px for run in found)
    same = all(run.same_status for run in found)
    ours = f"{worst:.1g} px, {'the same' if same else 'other'} statuses"
    return [Row("speed", "positions on the GPU as on the CPU", f"{SAME_PX:g} px", ours, worst <= SAME_PX and same)]


def tables(found: list[OnGpu]) -> list[str]:
    """Table of the recordings under a sentence; without a GPU a sentence alone."""
    if not found:
        return ["No GPU was at hand, so that nothing was measured there.\n"]
    head = ("recording", "way", "GPU frames/s", "CPU frames/s", "GPU at work (%)", "largest difference (px)")
    lines = [
        (
            f"{run.frames:,} frames",
            run.way,
            f"{run.frames / run.gpu_s:.0f}",
            f"{run.frames / run.cpu_s:.0f}",
            f"{100 * run.busy_s / run.gpu_s:.0f}",
            f"{run.difference_px:.1g}",
        )
        for run in found
    ]
    name = torch.cuda.get_device_name()
    return [f"`track` with a given circle, R = 50 px, 0.57 deg per frame, on {name}:\n\n{table(head, lines)}"]
