"""A lens that nobody gave: ``python -m experiments.validation.lens``.

Claim: distortion, pixels that are not square, and a near camera are found by the images of the ball, and velocity and
spin are right within their standard deviations.

Balls of R = 40 px cross images of 420 x 300 px from corner to corner in 50 frames, with noise of 2 grey levels. Their
diameter is known, their camera is not.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import torchsphere as ts
from experiments.experiment import Array, publish, table
from torchsphere.sphere_map.decision import MadeMap
from torchsphere.synthetic import ray_caster

#: First seed of the recordings, which judge nothing else, and recordings of each case.
SEED, COUNT = 54_200, 3

#: Radius, px; frames; images (h, w); frames per second; turn per frame, deg; noise, grey levels.
RADIUS, FRAMES, SHAPE, FRAME_RATE, TURN_DEG, NOISE = 40.0, 50, (300, 420), 10_000.0, 1.0, 2.0

#: Pixels that are drawn along the side of one, where it is not square.
FINER = 6

#: Diameter of the ball, m: a px is a mm.
DIAMETER_M = 0.08


@dataclass(frozen=True)
class Case:
    """What the camera does."""

    name: str
    distortion: float = 0.0  # in the image's corner, a share of the distance from its middle
    ratio: float = 1.0  # width of the pixels over their height
    distance: float = 1000.0  # of the camera, radii


CASES = (
    Case("none"),
    Case("distortion of -8 %", distortion=-0.08),
    Case("distortion of -2 %", distortion=-0.02),
    Case("distortion of -0.3 %", distortion=-0.003),
    Case("distortion of +5 %", distortion=0.05),
    Case("pixels 1.03 wide", ratio=1.03),
    Case("camera at 12 radii", distance=12.0),
)


@dataclass(frozen=True)
class Recording:
    """Images with their true motion."""

    images: NDArray[np.uint8]
    start: Array  # (2,) of the first centre, px as seen
    step: Array  # (2,), mean, px on square pixels of the same area, without distortion
    turn: Array  # (3,), rad


@dataclass(frozen=True)
class Result:
    """What was found, and errors in standard deviations."""

    distortion: float
    ratio: float
    ok: int
    velocity: float  # largest error of a component, relative to the speed
    velocity_sds: float
    spin: float
    spin_sds: float
    seconds: float


def recording(case: Case, seed: int) -> Recording:
    """The recording of a ``case`` with that seed."""
    draw, (height, width) = np.random.default_rng(seed), SHAPE
    axis = draw.normal(size=3)
    axis *= np.radians(TURN_DEG) / np.linalg.norm(axis)
    middle = np.array([(width - 1) / 2, (height - 1) / 2])
    ends = np.array([[70.0, 70.0], [width - 70.0, height - 70.0]])
    if draw.uniform() < 0.5:
        ends[:, 1] = ends[::-1, 1]
    straight = ends[0] + (ends[1] - ends[0]) * np.arange(FRAMES)[:, None] / (FRAMES - 1) + draw.uniform(-0.5, 0.5, 2)
    focal = RADIUS * case.distance
    coefficient = case.distortion / float(middle @ middle) * focal**2
    rays = (straight - middle) / focal
    seen = middle + focal * rays * (1 + coefficient * (rays**2).sum(1, keepdims=True))
    camera = ts.Camera(focal, tuple(middle.tolist()), (coefficient, 0.0, 0.0))
    pattern = ray_caster.speckle(seed, radius_px=RADIUS, speckle_px=5.0)
    images = []
    for number, centre in enumerate(seen):
        turn = torch.from_numpy(Rotation.from_rotvec(number * axis).as_matrix())[None].float()
        drawn = _seen(pattern, centre, turn, camera, case.ratio)
        images.append((drawn + NOISE * draw.standard_normal(drawn.shape)).round().clip(0, 255).astype(np.uint8))
    # Square pixels of the same area as the images' own are larger than those that were drawn.
    step = np.diff(straight, axis=0).mean(0) / np.sqrt(case.ratio)
    start = np.array([(seen[0, 0] + 0.5) / case.ratio - 0.5, seen[0, 1]])
    return Recording(np.stack(images), start, step, axis)


def _seen(pattern: ray_caster.Pattern, centre: Array, turn: torch.Tensor, camera: ts.Camera, ratio: float) -> Array:
    """An image by a ``camera`` whose pixels are wider by a ``ratio``: each is the mean of what lies in it."""
    place = torch.from_numpy(centre)[None].float()
    if ratio == 1:
        drawn = ray_caster.render(pattern, place, RADIUS, turn, 70.0, shape=SHAPE, subsamples=4, camera=camera)
        return drawn[0].numpy()
    # Square pixels, of which `FINER` x `FINER` are one, and a part of those at the ends of a wide one.
    shape = FINER * SHAPE[0], FINER * SHAPE[1]
    given = pattern, FINER * (place + 0.5) - 0.5, FINER * RADIUS, turn, 70.0
    fine = ray_caster.render(*given, shape=shape, subsamples=1)[0].numpy().reshape(SHAPE[0], FINER, -1).mean(1)
    sums = np.concatenate((np.zeros((len(fine), 1)), fine.cumsum(1)), 1)
    edges = FINER * ratio * np.arange(int(SHAPE[1] / ratio) + 1)
    levels = np.stack([np.interp(edges, np.arange(sums.shape[1]), row) for row in sums])
    return np.diff(levels, axis=1) / (FINER * ratio)


def measure(case: Case, seed: int) -> Result:
    """Track a recording, with the circle that its first image shows at that place."""
    made, radius = recording(case, seed), RADIUS / np.sqrt(case.ratio)
    before = time.process_time()
    track = ts.track(made.images, (*made.start.tolist(), radius), log=False, fps=FRAME_RATE, diameter_m=DIAMETER_M)
    seconds = time.process_time() - before
    motion = ts.kinematics(track, log=False)
    true = made.step * FRAME_RATE * DIAMETER_M / (2 * radius), made.turn * FRAME_RATE
    found = (motion.velocity_m_s, motion.sd_velocity_m_s), (motion.spin_rad_s, motion.sd_spin_rad_s)
    errors = []
    for (values, sds), truth in zip(found, true, strict=True):
        off = np.nanmean(values, 0) - truth
        errors += [np.abs(off).max() / np.linalg.norm(truth), np.abs(off / np.nanmedian(sds, 0)).max()]
    about = track.findings.map
    lens = about if isinstance(about, MadeMap) else MadeMap(pixel_ratio=np.nan, lens_distortion=np.nan)
    ok = int((track.status == "ok").sum())
    return Result(lens.lens_distortion, lens.pixel_ratio, ok, *map(float, errors), seconds)


def compute() -> list[tuple[Case, list[Result]]]:
    """Results of all cases."""
    return [(case, [measure(case, SEED + 10 * n + k) for k in range(COUNT)]) for n, case in enumerate(CASES)]


def tables(found: list[tuple[Case, list[Result]]]) -> str:
    """A row per case: what was found in each recording, and the largest errors."""
    head = ("camera", "distortion found", "ratio found", "velocity off", "in sd", "spin off", "in sd")
    lines = [
        (
            case.name,
            ", ".join(f"{100 * result.distortion:.2f}" for result in results) + " %",
            ", ".join(f"{result.ratio:.4f}" for result in results),
            f"{100 * max(result.velocity for result in results):.3f} %",
            f"{max(result.velocity_sds for result in results):.1f}",
            f"{100 * max(result.spin for result in results):.2f} %",
            f"{max(result.spin_sds for result in results):.1f}",
        )
        for case, results in found
    ]
    return table(head, lines)


def main() -> None:
    """Measure and publish."""
    torch.set_num_threads(1)
    text = tables(compute())
    print(text)
    publish("lens", "validation.lens", text)


if __name__ == "__main__":
    main()
