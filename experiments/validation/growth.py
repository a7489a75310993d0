"""A ball that comes nearer or goes away: ``python -m experiments.validation.growth``.

Claim: the map serves such a ball, places and turns are as right as those of a ball that keeps its distance, and the
distance is right within its standard deviation.

Each ball is seen by a camera at a metre, which the program knows; it has R = 50 px at that distance, and noise of 2
grey levels. The motion in depth is steady, or turns at an impact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import torchsphere as ts
from experiments.experiment import Array, publish, table
from torchsphere.synthetic import ray_caster

#: First seed of the recordings, which judge nothing else.
SEED = 54_100

#: Radius of the ball, m, its distance in the first frame, m, and the focal length, px: R = 50 px there.
RADIUS_M, DISTANCE_M, FOCAL_PX = 0.015, 1.0, 50 / 0.015

#: Frames per second.
FRAME_RATE = 36_000.0

#: Noise of the images, grey levels.
NOISE = 2.0


@dataclass(frozen=True)
class Case:
    """Change of the distance per frame as a share of the first, before and after an impact in the middle; frames."""

    before: float
    after: float
    frames: int


#: What is measured: no motion in depth, steady ones away and nearer, and motions that an impact turns.
CASES = (
    Case(0.0, 0.0, 60),
    Case(0.001, 0.001, 60),
    Case(-0.001, -0.001, 60),
    Case(0.003, 0.003, 60),
    Case(-0.005, -0.005, 60),
    Case(0.01, 0.01, 60),
    Case(0.03, 0.03, 60),
    Case(-0.001, 0.0007, 60),
    Case(0.01, -0.006, 60),
    Case(0.001, 0.001, 400),
    Case(0.004, 0.004, 400),
)


@dataclass(frozen=True)
class Recording:
    """Images with their true motion."""

    images: NDArray[np.uint8]
    position: Array  # (n, 2), px
    depth: Array  # (n,), m
    orientation: Array  # (n, 3, 3)
    camera: ts.Camera

    @property
    def radius(self) -> Array:
        """Radius (n,) of the outline, px."""
        return FOCAL_PX * RADIUS_M / self.depth


@dataclass(frozen=True)
class Result:
    """Errors of a recording."""

    frames: int
    ok: int
    on_map: int
    place: float  # standard deviation, px
    turn: float  # px on the surface
    drift: float  # largest mean error of the turn over a tenth of the frames, px
    depth_mm: float  # standard deviation of the steps' errors over the root of two
    depth_sd: float  # root mean square of the depth's errors, without their mean, in their standard deviations


def recording(case: Case, seed: int) -> Recording:
    """The recording of a ``case`` with that seed."""
    draw, n = np.random.default_rng(seed), case.frames
    steps = np.where(np.arange(1, n) < n / 2, case.before, case.after)
    depth = DISTANCE_M * (1 + np.concatenate(([0.0], steps.cumsum())))
    at = np.arange(n)[:, None]
    turns = Rotation.from_rotvec(np.radians(0.7) * at * _unit(draw.normal(size=3))).as_matrix()
    path = min(1.5, 120 / n) * at * _unit(draw.normal(size=2)) * (depth[0] / depth)[:, None]
    reach = float(FOCAL_PX * RADIUS_M / depth.min()) + 14
    position = path - path.min(0) + reach + draw.uniform(-0.5, 0.5, 2)
    width, height = np.ceil(position.max(0) + reach).astype(int).tolist()
    camera = ts.Camera(focal_px=FOCAL_PX, principal_px=((width - 1) / 2, (height - 1) / 2))
    pattern = ray_caster.speckle(seed, radius_px=50.0, speckle_px=5.0)
    images = []
    for place, z, turn in zip(torch.from_numpy(position), depth, torch.from_numpy(turns), strict=True):
        given = pattern, place[None].float(), FOCAL_PX * RADIUS_M / float(z), turn[None].float(), 70.0
        drawn = ray_caster.render(*given, shape=(height, width), subsamples=4, camera=camera)[0].numpy()
        images.append((drawn + NOISE * draw.standard_normal(drawn.shape)).round().clip(0, 255).astype(np.uint8))
    return Recording(np.stack(images), position, depth, turns, camera)


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)


def measure(made: Recording) -> Result:
    """Track the recording from its true circle, with its camera."""
    circle = (*made.position[0].tolist(), float(made.radius[0]))
    track = ts.track(made.images, circle, camera=made.camera, log=False)
    place = track.position - made.position
    known = np.isfinite(track.orientation[:, 0, 0])
    turned = Rotation.from_matrix(track.orientation[known]) * Rotation.from_matrix(made.orientation[known]).inv()
    left = np.full((len(known), 3), np.nan)
    left[known] = made.radius[known, None] * (turned * turned[0].inv()).as_rotvec()
    depth = FOCAL_PX * RADIUS_M / track.radius
    steps = np.diff(depth - made.depth)
    sd = track.sd_growth * depth[1:]
    parts = np.array_split(left, 10)
    found = track.findings.map
    return Result(
        frames=len(depth),
        ok=int((track.status == "ok").sum()),
        on_map=getattr(found, "frames", 0),
        place=float(np.nanstd(place, axis=0).mean()),
        turn=float(np.nanstd(left, axis=0).mean()),
        drift=float(max(np.abs(np.nanmean(part, axis=0)).max() for part in parts)),
        depth_mm=1e3 * float(np.nanstd(steps)) / np.sqrt(2),
        depth_sd=float(np.sqrt(np.nanmean((steps / np.where(sd > 0, sd, np.nan)) ** 2))) if (sd > 0).any() else np.nan,
    )


def compute() -> list[tuple[Case, Result]]:
    """Results of all cases."""
    return [(case, measure(recording(case, SEED + number))) for number, case in enumerate(CASES)]


def tables(found: list[tuple[Case, Result]]) -> str:
    """A row per case."""
    head = ("depth per frame", "frames", "on map", "place, px", "turn, px", "drift, px", "depth, mm", "over its sd")
    lines = [
        (
            f"{100 * case.before:+.1f} %" + (f", then {100 * case.after:+.2f} %" if case.after != case.before else ""),
            f"{result.frames}",
            f"{result.on_map}",
            f"{result.place:.4f}",
            f"{result.turn:.4f}",
            f"{result.drift:.4f}",
            f"{result.depth_mm:.4f}" if case.before or case.after else "held",
            f"{result.depth_sd:.2f}" if case.before or case.after else "",
        )
        for case, result in found
    ]
    return table(head, lines)


def main() -> None:
    """Measure and publish."""
    torch.set_num_threads(1)
    text = tables(compute())
    print(text)
    publish("growth", "validation.growth", text)


if __name__ == "__main__":
    main()
