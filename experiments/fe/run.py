"""Start CalculiX, where it is installed, and keep what came out."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.experiment import cached
from experiments.fe.cases import BarCase, PlateCase, ball_mesh, bar_deck, plate_deck, target_mesh
from experiments.fe.deck import write
from experiments.fe.read import Motion, velocities

Array = NDArray[np.float64]

PROGRAM = "ccx"
MISSING = (
    f"no finite elements: the program '{PROGRAM}' (CalculiX) is not installed; on Debian and Ubuntu, "
    "'apt-get install calculix-ccx' installs it"
)


class NotInstalledError(OSError):
    """CalculiX is not installed."""


@dataclass(frozen=True)
class Run:
    """One computation: the ball's motion, the size of the model, and the time."""

    case: BarCase | PlateCase
    motion: Motion  # of the ball
    nodes: int
    elements: int
    increments: int  # number of time steps, up to ``print_every`` too large
    wall_s: float  # duration on one thread


def ccx(folder: Path, name: str) -> float:
    """Run ``name.inp`` of a folder on one thread; returns the seconds.

    Raises
    ------
    NotInstalledError
        Where there is no ``ccx``.
    RuntimeError
        Where it stopped with an error, with the end of what it wrote.
    """
    program = shutil.which(PROGRAM)
    if program is None:
        raise NotInstalledError(MISSING)
    start = time.perf_counter()
    with (folder / f"{name}.log").open("w+", encoding="utf-8", errors="replace") as log:
        done = subprocess.run(
            [program, name],
            cwd=folder,
            stdout=log,
            stderr=subprocess.STDOUT,
            env=os.environ | {"OMP_NUM_THREADS": "1"},
            check=False,
        )
        log.seek(0)
        said = log.read()
    if done.returncode != 0 or "*ERROR" in said:
        raise RuntimeError(f"{PROGRAM} gave up on {name}.inp: " + " ".join(said.split())[-400:])
    return time.perf_counter() - start


def _measure(case: BarCase | PlateCase) -> dict[str, Any]:
    """Write the deck, run it, and read the ball's velocity, as lists."""
    ball, target = ball_mesh(case), target_mesh(case)
    text = bar_deck(case) if isinstance(case, BarCase) else plate_deck(case)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        write(folder / "impact.inp", text)
        wall_s = ccx(folder, "impact")
        times, velocity = velocities(folder / "impact.dat", ball.shares())
    if times[-1] < case.length_us * 1e-6 * (1 - 1e-6):
        raise RuntimeError(f"{PROGRAM} stopped at {1e6 * times[-1]:.1f} us of {case.length_us:g} us")
    return {
        "time_s": times.tolist(),
        "velocity_m_s": (1e-3 * velocity).tolist(),
        "nodes": len(ball.nodes_mm) + len(target.nodes_mm),
        "elements": len(ball.elements) + len(target.elements),
        # CalculiX writes no count of explicit steps; the last step is shorter.
        "increments": case.print_every * len(times),
        "wall_s": wall_s,
    }


def run(case: BarCase | PlateCase) -> Run:
    """The impact, computed or from the cache.

    Raises
    ------
    NotInstalledError
        Where it is not in the cache and there is no ``ccx``.
    """
    name = "fe-bar" if isinstance(case, BarCase) else "fe-plate"
    found = cached(name, asdict(case), lambda: _measure(case))
    time_s, velocity = np.array(found["time_s"]), np.array(found["velocity_m_s"])
    start = np.radians(case.angle_deg) if isinstance(case, PlateCase) else 0.0
    first = case.speed_m_s * np.array((np.cos(start), -np.sin(start), 0.0))
    # The state at first touch, which CalculiX does not print.
    time_s, velocity = np.insert(time_s, 0, 0.0), np.insert(velocity, 0, first, axis=0)
    # The meshed part of the ball may move across its planes of symmetry, the whole ball does not.
    velocity[:, 1:] *= (0, 0) if isinstance(case, BarCase) else (1, 0)
    motion = Motion(time_s, velocity, case.ball_mass_kg)
    return Run(case, motion, found["nodes"], found["elements"], found["increments"], found["wall_s"])
