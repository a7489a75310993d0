"""Coverage of the stated bands in flights whose circle is found: ``python -m experiments.validation.flights``.

Claim: in 100 flights, each with a ball, a texture, a noise, a motion, a background and a camera's distance of its own,
the truth lies within the stated 95 % bands in 90 to 99 %. The program gets the images, the frame rate, the ball's
diameter and mass, and runs with its defaults: it finds the circle, and the scale comes from it. It does not know the
camera's distance, which is drawn as the program takes it to be: radius over distance has the standard deviation 0.03.

The shares are means over flights, as an error that all frames of a flight share counts once: with 100 flights the
standard deviation of a share of 95 % is 2 % for such errors. Each quantity is compared along both or all three axes. A
position is compared in the image, with the middle of the outline and without the scale's error, and in metres, with the
ball's centre. A third of the flights have an impact, half a sine of force against a bar. Of the program's constants
`nearness.APPARENT_SD` and `poses.MAX_FACTOR_OF_NEARNESS` were chosen after a look at four of these flights.

Results are kept per flight in ``experiments/cache``, so that a run that was broken off goes on. ``--count N`` measures
the first N and prints a line per flight; it writes no table. ``--anew`` measures again.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

import torchsphere as ts
from experiments.experiment import CACHE, Array, cached, key_of, publish, table
from experiments.validation.attack_footage import MARGIN_PX, Flight, blotches, digitised
from torchsphere.dynamics.shared_errors import SharedErrors
from torchsphere.geometry.camera import outline_distance
from torchsphere.synthetic import ray_caster

SEEDS = tuple(range(500, 600))

#: Frames per second, diameter in m and mass in kg of all balls.
FRAME_RATE, DIAMETER_M, MASS_KG = 20_000.0, 0.03, 0.11

#: Half width of a band of 95 %, standard deviations.
BAND = 1.96

#: Steps of the integration of the true motion in a frame's interval.
SUBSTEPS = 40

#: Rays along a side of a pixel within the outline.
SUBSAMPLES = 3

#: Standard deviation of the ball's radius over the camera's distance, and its largest value.
SD_NEARNESS, MAX_NEARNESS = 0.03, 0.1

#: Points of the true outline.
OUTLINE_POINTS = 64

#: Grey level of the bar that the ball hits.
BAR = 170.0

#: Quantities in the order of the table.
NAMES = ("radius", "place in image", "place in m", "increment", "turn", "velocity", "spin", "force")


@dataclass(frozen=True)
class Drawn:
    """A flight as its seed draws it: per frame, px and rad."""

    radius: float
    noise: float
    speed: float
    turn_deg: float
    frames: int
    contact: tuple[float, float] | None  # start and end, frames
    speckle_px: float
    is_blotched: bool
    nearness: float  # radius over the camera's distance


@dataclass(frozen=True)
class Score:
    """What became of a flight: share of values within the band, and rms and mean of error over standard deviation."""

    drawn: dict[str, Any]
    status: str  # empty, or why there is no result
    on_map: bool
    radius_error: float
    inside: dict[str, float]
    rms: dict[str, float]
    mean: dict[str, list[float]]


def drawn(seed: int) -> Drawn:
    """The flight of a seed."""
    rng = np.random.default_rng(seed)
    radius = 80.0 if rng.random() < 0.05 else rng.uniform(20, 60)
    noise = float(np.exp(rng.uniform(math.log(0.5), math.log(8))))
    speed, turn, frames = rng.uniform(0, 6), rng.uniform(0, 8), int(rng.integers(40, 61))
    has_impact = rng.random() < 1 / 3 and speed > 0.5
    start = rng.uniform(0.35, 0.5) * frames
    contact = (start, start + rng.uniform(6, 12)) if has_impact else None
    speckle_px, is_blotched = rng.uniform(3, 5), bool(rng.random() < 0.5)
    nearness = min(abs(rng.normal(0, SD_NEARNESS)), MAX_NEARNESS)
    return Drawn(radius, noise, speed, turn, frames, contact, speckle_px, is_blotched, nearness)


@dataclass(frozen=True)
class Truth:
    """A flight with its exact rates at the frames."""

    made: Flight
    rate: Array  # (n, 5), px and rad per frame
    acceleration: Array  # (n, 2), px per frame^2


def flown(seed: int, flight: Drawn) -> Truth:
    """Poses and rates by fine integration; half a sine of force turns the flight round and changes the spin."""
    rng = np.random.default_rng(seed + 10_000)
    heading = rng.uniform(-0.35, 0.35) + (math.pi if rng.random() < 0.5 else 0)
    axis = rng.normal(size=3)
    before = np.array([*flight.speed * np.array([math.cos(heading), math.sin(heading)]), 0, 0, 0])
    before[2:] = np.radians(flight.turn_deg) * axis / np.linalg.norm(axis)
    change = np.array([-rng.uniform(1.2, 1.8), rng.uniform(-0.2, 0.2), 0, 0, 0]) * before[[0, 0, 0, 0, 0]]
    change[2:] = np.radians(rng.uniform(-0.3, 0.3, 3))
    times = np.arange((flight.frames - 1) * SUBSTEPS + 1) / SUBSTEPS
    middle = times[:-1] + 0.5 / SUBSTEPS
    fine = before + _share(middle, flight.contact)[:, None] * change
    path = np.concatenate((np.zeros((1, 2)), fine[:, :2].cumsum(0) / SUBSTEPS))
    turned = [Rotation.identity()]
    for step in fine[:, 2:] / SUBSTEPS:
        turned.append(Rotation.from_rotvec(step) * turned[-1])
    path += flight.radius + MARGIN_PX + rng.random(2) - path.min(0)
    width, height = (math.ceil(v) for v in path.max(0) + flight.radius + MARGIN_PX)
    still = torch.full((height, width), float(rng.uniform(50, 150)))
    if flight.is_blotched:
        still = blotches((height, width), seed, 3.0, 20.0)
    if flight.contact is not None:
        _put_bar(still, path[:, 0], flight.radius, is_right=bool(before[0] > 0))
    pattern = ray_caster.speckle(seed, radius_px=flight.radius, speckle_px=flight.speckle_px)
    frames = np.arange(flight.frames)
    turns = Rotation.concatenate([turned[k * SUBSTEPS] for k in frames])
    camera = ts.Camera(focal_px=flight.radius / flight.nearness).settled(tuple(still.shape))
    made = Flight(pattern, flight.radius, path[::SUBSTEPS], turns, still, seed, camera=camera)
    rate = before + _share(frames, flight.contact)[:, None] * change
    return Truth(made, rate, _share_slope(frames, flight.contact)[:, None] * change[:2])


def _put_bar(still: torch.Tensor, x: Array, radius: float, *, is_right: bool) -> None:
    """Draw the bar where the ball turns round."""
    if is_right:
        still[:, math.ceil(x.max() + radius) + 1 :] = BAR
    else:
        still[:, : max(math.floor(x.min() - radius), 0)] = BAR


def _share(times: Array, contact: tuple[float, float] | None) -> Array:
    """Share of the change of velocity that is done at the times."""
    if contact is None:
        return np.zeros(len(times))
    passed = np.clip((times - contact[0]) / (contact[1] - contact[0]), 0, 1)
    return np.asarray(0.5 * (1 - np.cos(math.pi * passed)))


def _share_slope(times: Array, contact: tuple[float, float] | None) -> Array:
    """Derivative of `_share`."""
    if contact is None:
        return np.zeros(len(times))
    length = contact[1] - contact[0]
    passed = (times - contact[0]) / length
    return np.where((passed > 0) & (passed < 1), 0.5 * math.pi / length * np.sin(math.pi * passed), 0.0)


def measure(seed: int) -> Score:
    """Film the flight of a seed, track and compare it."""
    flight = drawn(seed)
    truth = flown(seed, flight)
    made = truth.made
    poses = torch.from_numpy(made.centres).float(), torch.from_numpy(made.turns.as_matrix()).float()
    clean = ray_caster.render(
        made.pattern, poses[0], made.radius, poses[1], made.background, subsamples=SUBSAMPLES, camera=made.camera
    )
    images = digitised(clean, seed, flight.noise)
    try:
        track = ts.track(images, log=False)
        motion = ts.kinematics(track, frame_rate=FRAME_RATE, diameter_m=DIAMETER_M, mass_kg=MASS_KG)
    except ValueError as refusal:
        return Score(asdict(flight), f"refused: {refusal}", False, math.nan, {}, {}, {})
    errors = compared(truth, track, motion)
    known = {name: np.abs(e)[np.isfinite(e)] for name, e in errors.items()}
    return Score(
        asdict(flight),
        "; ".join(track.warnings),
        bool(track.settings["sphere_map"]["used"]),
        track.circle.radius - _seen(truth, track)[1],
        {name: float((e <= BAND).mean()) for name, e in known.items() if len(e)},
        {name: float(np.sqrt((e**2).mean())) for name, e in known.items() if len(e)},
        {name: np.nanmean(np.atleast_2d(e), axis=0).tolist() for name, e in errors.items() if np.isfinite(e).any()},
    )


def _seen(truth: Truth, track: ts.Track) -> tuple[Array, float]:
    """True places (n, 2) and radius, px, as the track means them: of the outline where no near camera was found."""
    made = truth.made
    assert made.camera is not None
    if track.settings["sphere_map"].get("radius_over_distance", 0.0):
        return made.centres, made.radius
    balls = torch.from_numpy(np.column_stack((made.centres, np.full(len(made.centres), made.radius))))
    angles = torch.arange(OUTLINE_POINTS, dtype=torch.float64) * (2 * math.pi / OUTLINE_POINTS)
    reach = outline_distance(balls, angles, made.camera).numpy()
    rays = np.stack((angles.cos().numpy(), angles.sin().numpy()), -1)
    # Along the outline of an ellipse of axes alike the distance from the point is radius plus offset times cosine.
    return made.centres + 2 * (reach[..., None] * rays).mean(1), float(reach.mean())


def compared(truth: Truth, track: ts.Track, motion: ts.Kinematics) -> dict[str, Array]:
    """Errors over stated standard deviations (m, k), by the names of `NAMES`."""
    made, pixel = truth.made, DIAMETER_M / (2 * truth.made.radius)
    places, radius = _seen(truth, track)
    assert motion.force_N is not None
    assert motion.sd_force_N is not None
    true = np.concatenate((np.diff(made.centres, axis=0), (made.turns[1:] * made.turns[:-1].inv()).as_rotvec()), 1)
    step = (track.increment - true) / np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2) + track.sd_steady**2)
    step[track.status[1:] != "ok"] = np.nan
    found = motion.scale
    by_scale = SharedErrors.of(track, found).scale * motion.position_m
    sd_place = np.sqrt(np.clip(motion.sd_position_m**2 - by_scale**2, 0, None)) / found.m_per_px
    velocity, force = truth.rate[:, :2] * pixel * FRAME_RATE, MASS_KG * truth.acceleration * pixel * FRAME_RATE**2
    return {
        "radius": np.array([[(track.circle.radius - radius) / track.circle.sd_radius]]),
        "place in image": (motion.position_m / found.m_per_px - places) / sd_place,
        "place in m": (motion.position_m - made.centres * pixel) / motion.sd_position_m,
        "increment": step[:, :2],
        "turn": step[:, 2:],
        "velocity": (motion.velocity_m_s - velocity) / motion.sd_velocity_m_s,
        "spin": (motion.spin_rad_s - truth.rate[:, 2:] * FRAME_RATE) / motion.sd_spin_rad_s,
        "force": (motion.force_N - force) / motion.sd_force_N,
    }


def compute(seeds: Sequence[int], *, anew: bool = False, tell: bool = False) -> list[Score]:
    """Scores of the flights, from the cache where they are known."""
    scores = []
    for seed in seeds:
        settings = {"seed": seed}
        if anew:
            (CACHE / f"{key_of('flights', settings)}.json").unlink(missing_ok=True)
        scores.append(Score(**cached("flights", settings, lambda seed=seed: asdict(measure(seed)))))
        if tell:
            print(_line(seed, scores[-1]), flush=True)
    return scores


def _line(seed: int, score: Score) -> str:
    """One flight in a line: how it was drawn, and error over standard deviation of each quantity."""
    d = Drawn(**score.drawn)
    kind = ("map" if score.on_map else "pairs", "impact" if d.contact else "-", "blotches" if d.is_blotched else "-")
    head = f"{seed}: R {d.radius:.0f} noise {d.noise:.1f} {d.speed:.1f} px {d.turn_deg:.1f} deg {' '.join(kind)}"
    head += f" near {d.nearness:.3f}"
    rms = ", ".join(f"{name} {value:.1f} ({100 * score.inside[name]:.0f})" for name, value in score.rms.items())
    return f"{head} | dR {score.radius_error:.3f}; {rms} | {score.status[:150]}"


def rows(scores: Sequence[Score]) -> str:
    """The table: shares within the band of all flights, of those without and with an impact, and of slow and fast."""
    measured = [score for score in scores if score.inside]
    groups = {
        "all": measured,
        "free flight": [s for s in measured if s.drawn["contact"] is None],
        "impact": [s for s in measured if s.drawn["contact"] is not None],
        "turn below 2 deg": [s for s in measured if s.drawn["turn_deg"] < 2],
        "turn above 2 deg": [s for s in measured if s.drawn["turn_deg"] >= 2],
        "camera nearer than 33 radii": [s for s in measured if s.drawn["nearness"] > SD_NEARNESS],
        "noise below 2": [s for s in measured if s.drawn["noise"] < 2],
        "noise above 2": [s for s in measured if s.drawn["noise"] >= 2],
    }
    lines = []
    for name, group in groups.items():
        shares = ([s.inside[key] for s in group if key in s.inside] for key in NAMES)
        lines.append((name, len(group), *(f"{100 * np.mean(share):.0f} %" if share else "-" for share in shares)))
    return table(("flights", "number", *NAMES), lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and write the table unless only a part was asked for."""
    parser = argparse.ArgumentParser(prog="python -m experiments.validation.flights")
    parser.add_argument("--count", type=int, help="only so many flights")
    parser.add_argument("--anew", action="store_true", help="measure again what is in the cache")
    options = parser.parse_args(arguments)
    scores = compute(SEEDS[: options.count], anew=options.anew, tell=options.count is not None)
    text = rows(scores)
    if options.count is None:
        publish("flights", "validation.flights", text)
    else:
        print(text)


if __name__ == "__main__":
    main()
