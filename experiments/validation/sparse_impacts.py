"""Impacts of which few frames were measured, against exact truth: ``python -m experiments.validation.sparse_impacts``.

Claim: whatever is stated of such an impact lies within three standard deviations in 97 % of the cases; where too few
frames show the flights there is no impact.

The tracks have exact truth and come without images (`simulated_impacts`): one to eight frames on a side of the contact,
next to it or far from it, frames here and there, and recordings that begin or end in the contact.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

import torchsphere as ts
from experiments.experiment import cached, publish, table
from experiments.validation import simulated_impacts as simulation
from experiments.validation.simulated_impacts import Push, Simulated, rebound, simulated

#: Recordings, those that are smoothed at once, frames of each, and the first seed.
RECORDINGS, BATCH, FRAMES, FIRST_SEED = 120, 8, 64, 210_000

#: Which frames are measured, and lengths of the contact, frames.
KINDS = ("next to the contact", "only outside it", "far from it", "here and there", "begun in it", "ended in it")
LENGTHS = (1.0, 3.0, 6.0, 14.0, 30.0)

#: Errors of the positions, powers of ten of a m.
NOISES = (-6.0, -4.3)


@dataclasses.dataclass(frozen=True)
class Sparse:
    """A simulated impact, of whose track only some frames were measured."""

    kind: str
    shot: Simulated
    track: ts.Track

    @property
    def push(self) -> Push:
        """The only one."""
        return self.shot.pushes[0]

    def truth(self) -> dict[str, NDArray[np.float64]]:
        """True values by their names in `Impact`."""
        before, after = self.shot.velocity_m_s[[0, -1]]
        turns = self.shot.spin_rad_s[[0, -1]] / (2 * np.pi)
        start, duration = self.push.start / simulation.RATE, self.push.length / simulation.RATE
        values = {
            "speed_before": np.linalg.norm(before),
            "speed_after": np.linalg.norm(after),
            "restitution_normal": -after[0] / before[0],
            "contact_start": start,
            "contact_end": start + duration,
            "duration": duration,
            "peak_force": self.push.largest_N,
            "mean_force": abs(self.push.impulse) / duration,
            "impulse_size": abs(self.push.impulse),
            "spin_before": turns[0],
            "spin_after": turns[1],
        }
        return {name: np.atleast_1d(value) for name, value in values.items()}


def sparse(seed: int) -> Sparse:
    """A recording of a random kind, contact, form of the force and noise."""
    rng = np.random.default_rng(seed)
    kind, length = str(rng.choice(KINDS)), float(rng.choice(LENGTHS))
    shape = simulation.SHAPES[rng.integers(len(simulation.SHAPES))]
    start = float(rng.uniform(12, 13))
    shot = simulated([rebound(shape, start, length)], FRAMES, 10 ** rng.uniform(*NOISES), seed)
    frames = np.arange(FRAMES)
    before, after = frames[frames <= start], frames[frames >= start + length]
    inside = frames[(frames > start) & (frames < start + length)]
    few, cut = rng.integers(1, 9, 2), int(start + rng.uniform(0.1, 0.9) * length) + 1
    chosen: dict[str, list[Any]] = {
        "next to the contact": [before[-few[0] :], inside, after[: few[1]]],
        "only outside it": [before[-few[0] :], after[: few[1]]],
        "far from it": [before[: few[0]], inside, after[-few[1] :]],
        "here and there": [frames[rng.random(FRAMES) < rng.uniform(0.1, 0.5)]],
        "begun in it": [inside[inside >= cut], after[: 3 * few[1]]],
        "ended in it": [before[-3 * few[0] :], inside[inside < cut]],
    }
    return Sparse(kind, shot, _seen_in(shot.track, np.isin(frames, np.concatenate(chosen[kind]))))


def _seen_in(track: ts.Track, seen: NDArray[np.bool_]) -> ts.Track:
    """The track, of which only the frames ``seen`` (n,) were measured."""
    both = seen[1:] & seen[:-1]
    return dataclasses.replace(
        track,
        position=np.where(seen[:, None], track.position, np.nan),
        orientation=np.where(seen[:, None, None], track.orientation, np.nan),
        increment=np.where(both[:, None], track.increment, np.nan),
        covariance=np.where(both[:, None, None], track.covariance, np.nan),
        status=np.where(seen, "ok", "lost"),
    )


def measured(seeds: range) -> list[dict[str, Any]]:
    """Kind and errors over standard deviations of each recording; no errors where there is no impact."""
    made = [sparse(seed) for seed in seeds]
    motions = ts.kinematics_of_many(
        [one.track for one in made],
        frame_rate=simulation.RATE,
        m_per_px=simulation.M_PER_PX,
        mass_kg=simulation.MASS_KG,
        log=False,
    )
    found = []
    for one, motion in zip(made, motions, strict=True):
        impact, _ = ts.impact(motion, log=False)
        stated = {} if impact is None else {name: getattr(impact, name) for name in one.truth()}
        errors = {
            name: (np.abs(stated[name].value - value) / stated[name].sd).tolist()
            for name, value in one.truth().items()
            if name in stated and np.isfinite(stated[name].value).all()
        }
        found.append({"kind": one.kind, "errors": errors})
    return found


def compute() -> list[dict[str, Any]]:
    """All recordings, from the cache where they are known."""
    every: list[dict[str, Any]] = []
    for first in range(FIRST_SEED, FIRST_SEED + RECORDINGS, BATCH):
        seeds = range(first, first + BATCH)
        every += cached("sparse_impacts", {"seeds": [first, first + BATCH]}, lambda seeds=seeds: measured(seeds))
    return every


def main() -> None:
    """Measure, and write the table."""
    every = compute()
    rows = []
    for name in sparse(FIRST_SEED).truth():
        errors = np.array([max(one["errors"][name]) for one in every if name in one["errors"]])
        rows.append([name, len(errors), int((errors <= 3).sum()), f"{errors.max():.1f}"])
    stated = sum(bool(one["errors"]) for one in every)
    text = f"{len(every)} recordings, {stated} of them with an impact:\n"
    head = ["Quantity", "stated", "within 3 sd", "largest error, sd"]
    publish("sparse_impacts", "validation.sparse_impacts", text, table(head, rows))


if __name__ == "__main__":
    main()
