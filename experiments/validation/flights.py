"""Coverage of the stated bands in flights whose circle is found: ``python -m experiments.validation.flights``.

Claim: in 100 flights, each with a ball, a texture, a noise, a motion, a background and a camera's distance of its own,
the truth lies within the stated 95 % bands in 90 to 99 %. The program gets the images, the frame rate, the ball's
diameter and mass, and runs with its defaults: it finds the circle, and the scale comes from it. It does not know the
camera's distance, which is drawn as the program takes it to be: radius over distance has the standard deviation 0.03.

The shares are means over flights, as an error that all frames of a flight share counts once: with 100 flights the
standard deviation of a share of 95 % is 2 % for such errors. Each quantity is compared along both or all three axes. A
position is compared in the image, with the middle of the outline and without the scale's error, and in metres, with the
ball's centre. A third of the flights have an impact, half a sine of force against a bar. No constant is chosen on these
flights (`seeds`).

Half of the flights are filmed by the ray caster, a quarter by the renderer under uniform light, and a quarter by the
renderer with a lamp.

Results are kept per flight in ``experiments/cache``, so that a run that was broken off goes on. ``--count N`` measures
the first N and prints a line per flight, and ``--spent`` measures the flights that may serve to choose constants;
neither writes the table. ``--anew`` measures again.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch

import torchsphere as ts
from experiments.experiment import CACHE, Array, cached, key_of, publish, table
from experiments.validation import seeds
from experiments.validation.flight_footage import SD_NEARNESS, Drawn, Truth, drawn, filmed, flown
from experiments.validation.rendered_footage import RADIUS_M
from torchsphere.dynamics.shared_errors import SharedErrors
from torchsphere.geometry.camera import outline_distance

#: Seeds of the flights, on which no constant is chosen.
SEEDS = seeds.FLIGHTS

#: Frames per second, and mass of all balls, kg.
FRAME_RATE, MASS_KG = 20_000.0, 0.11

#: Half width of a band of 95 %, standard deviations.
BAND = 1.96

#: Points of the true outline.
OUTLINE_POINTS = 64

#: Quantities in the order of the table.
NAMES = ("radius", "place in image", "place in m", "increment", "turn", "velocity", "spin", "force")


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


def measure(seed: int) -> Score:
    """Film the flight of a seed, track and compare it."""
    flight = drawn(seed)
    truth = flown(seed, flight)
    try:
        track = ts.track(filmed(flight, truth.made), log=False)
        motion = ts.kinematics(track, frame_rate=FRAME_RATE, diameter_m=2 * RADIUS_M, mass_kg=MASS_KG)
    except ValueError as refusal:
        return Score(asdict(flight), f"refused: {refusal}", False, math.nan, {}, {}, {})
    errors = compared(truth, track, motion)
    known = {name: np.abs(e)[np.isfinite(e)] for name, e in errors.items()}
    return Score(
        asdict(flight),
        "; ".join(track.warnings),
        track.findings.is_on_map,
        track.circle.radius - _seen(truth, track)[1],
        {name: float((e <= BAND).mean()) for name, e in known.items() if len(e)},
        {name: float(np.sqrt((e**2).mean())) for name, e in known.items() if len(e)},
        {name: np.nanmean(np.atleast_2d(e), axis=0).tolist() for name, e in errors.items() if np.isfinite(e).any()},
    )


def _seen(truth: Truth, track: ts.Track) -> tuple[Array, float]:
    """True places (n, 2) and radius, px, as the track means them: of the outline where no near camera was found."""
    made = truth.made
    assert made.camera is not None
    if track.findings.radius_over_distance:
        return made.centres, made.radius
    balls = torch.from_numpy(np.column_stack((made.centres, np.full(len(made.centres), made.radius))))
    angles = torch.arange(OUTLINE_POINTS, dtype=torch.float64) * (2 * math.pi / OUTLINE_POINTS)
    reach = outline_distance(balls, angles, made.camera).numpy()
    rays = np.stack((angles.cos().numpy(), angles.sin().numpy()), -1)
    # Along the outline of an ellipse of axes alike the distance from the point is radius plus offset times cosine.
    return made.centres + 2 * (reach[..., None] * rays).mean(1), float(reach.mean())


def compared(truth: Truth, track: ts.Track, motion: ts.Kinematics) -> dict[str, Array]:
    """Errors over stated standard deviations (m, k), by the names of `NAMES`."""
    made, pixel = truth.made, RADIUS_M / truth.made.radius
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


def compute(chosen: Sequence[int], *, anew: bool = False, tell: bool = False) -> list[Score]:
    """Scores of the flights, from the cache where they are known."""
    scores = []
    for seed in chosen:
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
    head += f" near {d.nearness:.3f} {d.film}"
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
        "by the ray caster": [s for s in measured if s.drawn["film"] == "ray caster"],
        "by the renderer, uniform light": [s for s in measured if s.drawn["film"] == "uniform"],
        "by the renderer, a lamp": [s for s in measured if s.drawn["film"] == "lamp"],
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
    parser.add_argument("--spent", action="store_true", help="the flights on which constants were chosen")
    options = parser.parse_args(arguments)
    every, is_part = seeds.SPENT["flights"] if options.spent else SEEDS, options.spent or options.count is not None
    text = rows(compute(every[: options.count], anew=options.anew, tell=is_part))
    if is_part:
        print(text)
    else:
        publish("flights", "validation.flights", text)


if __name__ == "__main__":
    main()
