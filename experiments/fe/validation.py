"""The explicit solver against theory and published numbers: ``python -m experiments.fe.validation``.

Claim: `experiments.fe.explicit` gives the length of Taylor's bar within 2 % of published values, the first bending
frequencies of the paper's bar and plate within 3 % of theory, and the balance of energy within 1 %.

Taylor's bar is the common test of a copper rod (32.4 mm, radius 3.2 mm, 227 m/s; see `explicit.theory`), on two meshes.
Its wall is a plane of symmetry. Frequencies are those of the very meshes of the impacts, from the solver's forces
(`explicit.modes`). The wave runs along an elastic bar that hits a wall: the momentum turns its sign after length over
speed of sound. Writes ``docs/tables/explicit.md``.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.experiment import cached, publish, table
from experiments.fe.explicit.impacts import BarImpact, impact, on_planes
from experiments.fe.explicit.johnson_cook import Metal
from experiments.fe.explicit.modes import frequencies_hz
from experiments.fe.explicit.solver import Body, integrate
from experiments.fe.explicit.theory import TAYLOR, bar_hz, plate_hz
from experiments.fe.hardening import JohnsonCook
from experiments.fe.mesh import block
from experiments.fe.shapes import quarter_bar
from experiments.paper.table4 import MESHES as BARS
from experiments.paper.table5 import MESHES as PLATES

Array = NDArray[np.float64]

#: Copper of Taylor's test: linear hardening without rate and heat.
COPPER = Metal(117e3, 0.35, 8930.0, JohnsonCook(400.0, 100.0, 1.0, 0.0, 1.0))
ROD_MM, ROD_RADIUS_MM, ROD_M_S, ROD_US = 32.4, 3.2, 227.0, 80.0
#: Sizes of the rod's bricks in mm.
ROD_SIZES_MM = (0.8, 0.5)
#: Elastic bar of the wave: length, edge and number of bricks along it.
WAVE_MM, WAVE_EDGE_MM, WAVE_BRICKS = 100.0, 1.0, 100


@dataclass(frozen=True)
class Comparison:
    """One number of the solver, and its range by theory or in publications."""

    what: str
    ours: float
    low: float
    high: float
    unit: str
    source: str

    @property
    def off(self) -> float:
        """How far the number is from the range, as a share of its nearer end; 0 within."""
        if self.low <= self.ours <= self.high:
            return 0.0
        near = self.low if self.ours < self.low else self.high
        return self.ours / near - 1


def rod(size_mm: float) -> dict[str, float]:
    """Taylor's bar: final length and radius in mm, plastic strain, imbalance of energy, number of bricks."""

    def measure() -> dict[str, float]:
        mesh = quarter_bar(ROD_RADIUS_MM, ROD_MM, size_mm, size_mm, size_mm)
        velocity = np.zeros_like(mesh.nodes_mm)
        held = on_planes(mesh, (1, 2))
        velocity[:, 1] = np.where(held[:, 1], 0.0, -ROD_M_S)
        true_kg = COPPER.density_kg_m3 * math.pi / 2 * ROD_RADIUS_MM**2 * ROD_MM * 1e-9
        history, state = integrate(Body(mesh, COPPER, held, velocity, mass_kg=true_kg), None, 1e-6 * ROD_US, 1e-6)
        foot = state.nodes[held[:, 1]]
        return {
            "length": float(np.ptp(state.nodes[:, 1])),
            "radius": float(np.hypot(foot[:, 0], foot[:, 2]).max()),
            "strain": float(state.plastic_strain.max()),
            "imbalance": history.imbalance,
            "hourglass": float(history.energy_J["body, hourglass"][-1] / history.total_energy_J[0]),
            "bricks": len(mesh.elements),
        }

    found: dict[str, float] = cached("explicit-rod", {"size_mm": size_mm, **asdict(COPPER)}, measure)
    return found


def wave_m_s() -> float:
    """Speed of sound in an elastic bar that hits a wall with its end."""
    mesh = block(np.linspace(0, WAVE_MM, WAVE_BRICKS + 1), *2 * (np.array((0.0, WAVE_EDGE_MM)),))
    metal = BarImpact().metal
    held = on_planes(mesh, (0, 1, 2))
    velocity = np.zeros_like(mesh.nodes_mm)
    velocity[:, 0] = np.where(held[:, 0], 0.0, -0.1)
    body = Body(mesh, Metal(metal.modulus_mpa, metal.poisson, metal.density_kg_m3), held, velocity)
    history, _ = integrate(body, None, 30e-6, 0.1e-6)
    along = -history.momentum_kg_m_s[:, 0]
    turn = float(np.interp(0.0, -along[: along.argmin()], history.time_s[: along.argmin()]))
    return 1e-3 * WAVE_MM / turn


def compute() -> tuple[Comparison, ...]:
    """All comparisons."""
    found = []
    for size in ROD_SIZES_MM:
        own = rod(size)
        name = f"Taylor's bar, {size:g} mm ({own['bricks']:.0f} bricks)"
        for place, (key, what, unit) in enumerate(
            (("length", "length", "mm"), ("radius", "radius", "mm"), ("strain", "plastic strain", ""))
        ):
            ends = [ranges[place] for ranges in TAYLOR.values()]
            low, high = min(e[0] for e in ends), max(e[1] for e in ends)
            found.append(Comparison(f"{name}: {what}", own[key], low, high, unit, ", ".join(TAYLOR)))
        found.append(Comparison(f"{name}: energy that is lost or won", own["imbalance"], 0, 0, "of all", "balance"))
    metal = BarImpact().metal
    sound = math.sqrt(1e6 * metal.modulus_mpa / metal.density_kg_m3)
    found.append(Comparison("wave along a bar", wave_m_s(), sound, sound, "m/s", "sqrt(E / density)"))
    for bar in BARS:
        own_hz, theory = float(frequencies_hz(bar.body(), 900.0, 2)[0]), bar_hz(bar)
        what = f"paper's bar, {bar.size_mm:g} mm: first bending frequency"
        found.append(Comparison(what, own_hz, theory, theory, "Hz", "Timoshenko's beam"))
    for plate in PLATES:
        own_hz, theory = float(frequencies_hz(plate.body(), 14.0, 2)[0]), plate_hz(plate)
        what = f"paper's plate, {plate.size_mm:g} mm: first bending frequency"
        found.append(Comparison(what, own_hz, theory, theory, "Hz", "Levy's thin plate"))
    for case in (*BARS, *PLATES):
        kind = "bar" if isinstance(case, BarImpact) else "plate"
        what = f"impact on the {kind}, {case.size_mm:g} mm: energy that is lost or won"
        found.append(Comparison(what, impact(case).imbalance, 0, 0, "of all", "balance"))
    return tuple(found)


def _line(one: Comparison) -> tuple[str, ...]:
    if one.source == "balance":
        return one.what, f"{100 * one.ours:.2f} %", "0", "-", "balance of energy"
    ends = f"{one.low:.5g}" if one.low == one.high else f"{one.low:.5g} to {one.high:.5g}"
    return one.what, f"{one.ours:.5g} {one.unit}", f"{ends} {one.unit}", f"{100 * one.off:+.1f} %", one.source


def main() -> None:
    """Compare, and publish the table."""
    head = ("what", "explicit solver", "theory or published", "off", "source")
    publish("explicit", "fe.validation", table(head, map(_line, compute())))


if __name__ == "__main__":
    main()
