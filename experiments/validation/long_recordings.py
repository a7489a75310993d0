"""Long recordings, several impacts and none, against exact truth: ``python -m experiments.validation.long_recordings``.

Claims: one impact of 14 frames in 2,000, 5,000 and 20,000 frames is found with its peak within 0.5 %; 200 flights of 60
frames and 20 of 5,000 have no impact; of three impacts in 240 frames all three are found, and a second contact of 5 %
of the force of the first is found in each of 8 shots.

The tracks have exact truth and come without images (`simulated_impacts`); positions err by 1.5 um.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

import torchsphere as ts
from experiments.experiment import cached, publish, table
from experiments.validation import simulated_impacts as simulation
from experiments.validation.simulated_impacts import Push, Simulated, half_sine, rebound, simulated
from torchsphere.dynamics.impact_estimate import Impact

NOISE_M, CONTACT = 1.5e-6, 14

#: Frames of the long recordings, and shots of each.
LONG, LONG_SHOTS = (2_000, 5_000, 20_000), 4

#: Flights without an impact: frames and number.
FLIGHTS = ((60, 200), (5_000, 20))

#: Shots with three impacts, and with a second contact whose force is this share of the first.
SHOTS, SECOND = 8, 0.05

#: First seed.
FIRST_SEED = 200_000

#: Quantities that are compared with the truth, in the order of `_true`.
QUANTITIES = ("contact_start", "duration", "peak_force", "impulse_size")


@dataclass(frozen=True)
class Result:
    """A kind of recording: impacts that are there and that were found, and their errors."""

    name: str
    frames: int
    recordings: int
    true: int
    found: int
    errors_over_sd: float  # root mean square over the `QUANTITIES` of all impacts; NaN without one
    peak_error: float  # largest error of a peak force, share of it; NaN without one
    seconds: float  # per recording


def measure(name: str, shots: Sequence[Simulated]) -> Result:
    """Impacts of all ``shots``, each compared with the push that starts next to it."""
    ball = ts.ball(simulation.MASS_KG, 2 * simulation.RADIUS_PX * simulation.M_PER_PX)
    found, errors, peaks = 0, [], []
    before = time.perf_counter()
    for shot in shots:
        motion = ts.kinematics(
            shot.track,
            frame_rate=simulation.RATE,
            m_per_px=simulation.M_PER_PX,
            mass_kg=simulation.MASS_KG,
            log=False,
        )
        impacts = ts.impacts(motion, ball, log=False)
        found += len(impacts)
        for push in shot.pushes:
            nearest = min(
                impacts, key=lambda one: abs(one.contact_start.value - push.start / simulation.RATE), default=None
            )
            if nearest is not None:
                errors += _errors(nearest, push)
                peaks.append(abs(float(nearest.peak_force.value) / push.largest_N - 1))
    seconds = (time.perf_counter() - before) / len(shots)
    over_sd = float(np.sqrt(np.mean(np.square(errors)))) if errors else np.nan
    true = sum(len(shot.pushes) for shot in shots)
    return Result(name, len(shots[0].position_m), len(shots), true, found, over_sd, max(peaks, default=np.nan), seconds)


def _errors(impact: Impact, push: Push) -> list[float]:
    true = [push.start / simulation.RATE, push.length / simulation.RATE, push.largest_N, abs(push.impulse)]
    estimates = [getattr(impact, name) for name in QUANTITIES]
    return [float((one.value - value) / one.sd) for one, value in zip(estimates, true, strict=True)]


def one_impact(frames: int, seed: int) -> Simulated:
    """A contact at a random moment in the middle part of a recording."""
    start = float(np.random.default_rng(seed).uniform(0.3, 0.7)) * frames
    return simulated([rebound(half_sine, start, CONTACT)], frames, NOISE_M, seed)


def flight(frames: int, seed: int) -> Simulated:
    """No contact."""
    return simulated([], frames, NOISE_M, seed)


def three_impacts(seed: int) -> Simulated:
    """Three contacts of 14 frames in 240: thrown back, thrown back again with half of the change, and once more."""
    phase = np.random.default_rng(seed).random(3)
    first = rebound(half_sine, 50 + phase[0], CONTACT)
    others = [
        Push(half_sine, start, CONTACT, share * first.peak_N)
        for start, share in ((110 + phase[1], -0.7), (170 + phase[2], 0.5))
    ]
    return simulated([first, *others], 240, NOISE_M, seed)


def second_contact(seed: int) -> Simulated:
    """A secondary hit of 5 % of the force, 40 frames after the first contact."""
    first = rebound(half_sine, 50 + float(np.random.default_rng(seed).random()), CONTACT)
    second = Push(half_sine, first.start + CONTACT + 40, CONTACT, SECOND * first.peak_N)
    return simulated([first, second], 160, NOISE_M, seed)


def compute() -> list[Result]:
    """All kinds of recordings, from the cache where they are known."""
    kinds = [(f"one impact in {n:,} frames", LONG_SHOTS, lambda s, n=n: one_impact(n, s)) for n in LONG]
    kinds += [(f"flight of {n:,} frames", count, lambda s, n=n: flight(n, s)) for n, count in FLIGHTS]
    kinds += [("three impacts", SHOTS, three_impacts), ("a second contact of 5 %", SHOTS, second_contact)]
    results = []
    for number, (name, count, made) in enumerate(kinds):
        first = FIRST_SEED + 1000 * number
        results.append(
            Result(
                **cached(
                    "long_recordings",
                    {"name": name, "recordings": count, "noise": NOISE_M},
                    lambda name=name, made=made, count=count, first=first: asdict(
                        measure(name, [made(first + k) for k in range(count)])
                    ),
                )
            )
        )
        print(" | ".join(_row(results[-1])), flush=True)
    return results


def _row(one: Result) -> list[str]:
    errors = (
        ["-", "-"] if np.isnan(one.errors_over_sd) else [f"{one.errors_over_sd:.2f}", f"{100 * one.peak_error:.2f}"]
    )
    return [one.name, f"{one.recordings}", f"{one.true}", f"{one.found}", *errors, f"{one.seconds:.1f}"]


def main() -> None:
    """Measure, and write the table."""
    heading = [
        "Recordings",
        "number",
        "impacts",
        "found",
        "error over stated, rms",
        "largest error of a peak, %",
        "s each",
    ]
    publish("long_recordings", "validation.long_recordings", table(heading, [_row(one) for one in compute()]))


if __name__ == "__main__":
    main()
