"""A small benchmark folder in the format of `torchsphere benchmark make`, rendered by the ray caster."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import tifffile
import torch
from shots import noisy, rotation_matrix

from torchsphere.benchmark.folder import (
    IMAGES,
    INDEX,
    NAME,
    TRUTH,
    TRUTH_COLUMNS,
    VERSION,
    index_checksum,
    suite_checksum,
)
from torchsphere.geometry.orientation import quaternions
from torchsphere.synthetic import ray_caster

RADIUS, SHAPE, FRAMES = 16.0, (64, 112), 8
STEP, TURN = (3.2, 0.4), (0.01, 0.03, -0.02)
SUITES = ("plain", "fast-flight")


def write_benchmark(folder: Path, suites: tuple[str, ...] = SUITES) -> Path:
    """Suites that differ in their pattern and start, ``FRAMES`` each; the folder is returned."""
    entries = [_suite(folder / name, seed) for seed, name in enumerate(suites)]
    index = {"benchmark": NAME, "version": VERSION, "size": "smoke", "suites": entries}
    index |= {"checksum": index_checksum(index), "renderer": {}}
    (folder / INDEX).write_text(json.dumps(index, indent=2))
    return folder


def true_motion(seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Centres (n, 2) and orientations (n, 3, 3) of a suite."""
    frame = torch.arange(FRAMES, dtype=torch.float64)[:, None]
    centres = torch.tensor([28.3 + 20 * seed, 30.6]) + frame * torch.tensor(STEP)
    turn = torch.tensor(TURN, dtype=torch.float64)
    return centres, torch.stack([rotation_matrix(float(k) * turn) for k in frame])


def _suite(folder: Path, seed: int) -> dict[str, object]:
    centres, orientations = true_motion(seed)
    pattern = ray_caster.speckle(seed, radius_px=RADIUS)
    images = ray_caster.render(pattern, centres.float(), RADIUS, orientations.float(), 90.0, shape=SHAPE)
    frames = noisy(images, 1.0, seed).numpy().astype(np.uint8)
    folder.mkdir(parents=True)
    tifffile.imwrite(folder / IMAGES, frames)
    count = np.arange(FRAMES, dtype=np.float64)
    columns = (count, count / 1000, *centres.numpy().T, np.full(FRAMES, RADIUS), *quaternions(orientations.numpy()).T)
    truth = dict(zip(TRUTH_COLUMNS, (*columns, np.ones(FRAMES)), strict=True))
    with (folder / TRUTH).open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(truth)
        writer.writerows(zip(*(map(repr, column.tolist()) for column in truth.values()), strict=True))
    return {
        "name": folder.name,
        "kind": folder.name,
        "title": "a small ball",
        "seed": seed,
        "frames": FRAMES,
        "width": SHAPE[1],
        "height": SHAPE[0],
        "frame_rate_hz": 1000.0,
        "diameter_mm": 30.0,
        "camera": None,
        "circle": [*centres[0].tolist(), RADIUS],
        "checksum": suite_checksum(frames, truth),
    }
