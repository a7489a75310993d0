"""The two impacts of the paper with a rigid ball, integrated or from the cache."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.experiment import cached
from experiments.fe.explicit.johnson_cook import Heat, Metal
from experiments.fe.explicit.solver import TIME, Body, History, State, integrate
from experiments.fe.explicit.sphere_contact import Sphere
from experiments.fe.hardening import ALUMINIUM, STEEL
from experiments.fe.mesh import Mesh
from experiments.fe.read import Motion
from experiments.fe.shapes import half_plate, quarter_bar

Array = NDArray[np.float64]

#: Largest distance of a node from a plane of symmetry, in mm.
PLANE_MM = 1e-6
#: Names of what is recorded of the metal at each time.
STRAIN, RATE, WARMTH = "largest plastic strain", "largest plastic strain rate (1/s)", "largest warming (K)"

#: Table 4; the density is that of `experiments.paper.bar.setup`, the capacity of heat that of aluminium alloys, 880.
BAR_METAL = Metal(72e3, 0.27, 2800.0, ALUMINIUM, Heat(293.0, 933.0, 1.34, 880.0))
#: Table 5; density and capacity of heat of steel, not in the paper: 7850 and 470.
PLATE_METAL = Metal(190e3, 0.25, 7850.0, STEEL, Heat(293.0, 1700.0, 1.0, 470.0))


@dataclass(frozen=True, kw_only=True)
class BarImpact:
    """Frontal impact on the bar (sections 5.1 and 5.3.1), a quarter of it: x along the barrel, y along the bar."""

    size_mm: float = 1.8  # bricks at the contact
    coarse_mm: float = 2.5  # bricks on the bar's far side
    long_mm: float = 6.0  # bricks at the bar's ends
    length_us: float = 900.0
    record_us: float = 1.0
    speed_m_s: float = 70.0
    radius_mm: float = 15.0
    mass_kg: float = 0.110
    friction: float = 0.3  # as in `experiments.paper.bar.setup`
    bar_radius_mm: float = 9.0
    bar_length_mm: float = 300.0
    metal: Metal = BAR_METAL

    def sphere(self) -> Sphere:
        """The ball at first touch."""
        return Sphere(
            radius_mm=self.radius_mm,
            mass_kg=self.mass_kg,
            centre_mm=(-self.radius_mm - self.bar_radius_mm, 0.0, 0.0),
            velocity_m_s=(self.speed_m_s, 0.0, 0.0),
            friction=self.friction,
            parts=4,
            free=(True, False, False),
            spin_free=(False, False, False),
        )

    def body(self) -> Body:
        """The quarter of the bar."""
        half_mm = self.bar_length_mm / 2
        mesh = quarter_bar(self.bar_radius_mm, half_mm, self.size_mm, self.coarse_mm, self.long_mm)
        top = np.unique(mesh.elements[mesh.side(0, 0)])
        # The nodes of the struck side on the surface itself.
        out = np.hypot(mesh.nodes_mm[top, 0], mesh.nodes_mm[top, 2]) > self.bar_radius_mm - PLANE_MM
        near = mesh.nodes_mm[top, 1] < self.radius_mm
        true_mm3 = math.pi * self.bar_radius_mm**2 / 2 * half_mm
        return Body(
            mesh=mesh,
            metal=self.metal,
            held=on_planes(mesh, (1, 2)),
            velocity_m_s=np.zeros_like(mesh.nodes_mm),
            surface=top[out & near],
            mass_kg=self.metal.density_kg_m3 * true_mm3 * 1e-9,
        )


@dataclass(frozen=True, kw_only=True)
class PlateImpact:
    """Oblique impact on the plate (section 6), half of it: x along the plate, y off it, z across.

    The ends of the plate rest on supports that they neither leave nor sink into, and slide freely on them. The ball
    hits the middle, the long side is along its path; the paper gives neither. Friction is that of the preset
    ``paper-plate``.
    """

    size_mm: float = 2.5  # bricks along the ball's path
    layers: int = 2  # of bricks through the thickness
    long_mm: float = 12.0  # bricks at the edges
    path_mm: tuple[float, float] = (-15.0, 60.0)  # where along x the bricks are small
    length_us: float = 1400.0
    record_us: float = 1.0
    speed_m_s: float = 80.0
    angle_deg: float = 15.0
    radius_mm: float = 9.5
    mass_kg: float = 0.028
    friction: float = 0.05
    spin_rad_s: float = 0.0  # about z
    plate_mm: tuple[float, float, float] = (400.0, 200.0, 1.0)
    metal: Metal = PLATE_METAL

    def sphere(self) -> Sphere:
        """The ball at first touch."""
        angle = math.radians(self.angle_deg)
        return Sphere(
            radius_mm=self.radius_mm,
            mass_kg=self.mass_kg,
            centre_mm=(0.0, self.radius_mm, 0.0),
            velocity_m_s=(self.speed_m_s * math.cos(angle), -self.speed_m_s * math.sin(angle), 0.0),
            spin_rad_s=(0.0, 0.0, self.spin_rad_s),
            friction=self.friction,
            parts=2,
            free=(True, True, False),
            spin_free=(False, False, True),
        )

    def body(self) -> Body:
        """The half of the plate."""
        mesh = half_plate(*self.plate_mm, self.path_mm, self.size_mm, self.long_mm, self.layers)
        x, y, z = mesh.nodes_mm.T
        held = on_planes(mesh, (2,))
        held[:, 1] |= (np.abs(np.abs(x) - self.plate_mm[0] / 2) < PLANE_MM) & (y < PLANE_MM - self.plate_mm[2])
        low, high = self.path_mm
        near = (x > low - 20) & (x < high + 60) & (z < 2 * self.radius_mm)
        return Body(
            mesh=mesh,
            metal=self.metal,
            held=held,
            velocity_m_s=np.zeros_like(mesh.nodes_mm),
            surface=np.flatnonzero((np.abs(y) < PLANE_MM) & near),
        )


@dataclass(frozen=True)
class Done:
    """An integrated impact: the ball, the energies, and the metal's extremes over time."""

    case: BarImpact | PlateImpact
    motion: Motion  # of the ball, in the body's axes
    place_mm: Array  # of the ball's centre (t, 3)
    spin_rad_s: Array  # of the ball (t, 3)
    metal: dict[str, Array]  # extremes of the metal (t,) by name
    energy_J: dict[str, Array]  # noqa: N815  (energies (t,) by name)
    imbalance: float  # largest change of the sum of the energies, as a share
    bricks: int
    steps: int
    plastic_strain: Array  # of the bricks at the end (e,)
    nodes_mm: Array  # at the end (n, 3)

    @property
    def name(self) -> str:
        """Size of the bricks."""
        return f"{self.case.size_mm:g} mm"


def on_planes(mesh: Mesh, axes: tuple[int, ...]) -> NDArray[np.bool_]:
    """What planes of symmetry through the origin hold (n, 3), across each of the axes."""
    held = np.zeros(mesh.nodes_mm.shape, bool)
    for axis in axes:
        held[:, axis] = np.abs(mesh.nodes_mm[:, axis]) < PLANE_MM
    return held


def extremes(start_k: float) -> tuple[dict[str, list[float]], Callable[[State], None]]:
    """The metal's extremes by name, and what is to be called with each recorded state."""
    found: dict[str, list[float]] = {STRAIN: [], RATE: [], WARMTH: []}
    last: dict[str, Any] = {}

    def each(state: State) -> None:
        lapse = state.clock[TIME] - last.get("time", 0.0)
        grown = state.plastic_strain - last.get("strain", 0.0)
        found[STRAIN].append(float(state.plastic_strain.max()))
        found[RATE].append(float(grown.max() / lapse))
        found[WARMTH].append(float(state.temperature_k.max()) - start_k)
        last["time"], last["strain"] = float(state.clock[TIME]), state.plastic_strain.copy()

    return found, each


def _measure(case: BarImpact | PlateImpact) -> dict[str, Any]:
    """Integrate an impact; what the cache holds."""
    found, each = extremes(case.metal.start_k)
    history, state = integrate(case.body(), case.sphere(), 1e-6 * case.length_us, 1e-6 * case.record_us, each)
    return {**_lists(history), "metal": found, "plastic": state.plastic_strain.tolist(), "nodes": state.nodes.tolist()}


def _lists(history: History) -> dict[str, Any]:
    return {
        "time_s": history.time_s.tolist(),
        "velocity_m_s": history.velocity_m_s.tolist(),
        "place_mm": history.place_mm.tolist(),
        "spin_rad_s": history.spin_rad_s.tolist(),
        "energy": {name: values.tolist() for name, values in history.energy_J.items()},
        "imbalance": history.imbalance,
        "steps": history.steps,
    }


def impact(case: BarImpact | PlateImpact) -> Done:
    """The impact, integrated or from the cache."""
    name = "explicit-bar" if isinstance(case, BarImpact) else "explicit-plate"
    found = cached(name, asdict(case), lambda: _measure(case))
    return Done(
        case=case,
        motion=Motion(np.array(found["time_s"]), np.array(found["velocity_m_s"]), case.mass_kg),
        place_mm=np.array(found["place_mm"]),
        spin_rad_s=np.array(found["spin_rad_s"]),
        metal={key: np.array(values) for key, values in found["metal"].items()},
        energy_J={key: np.array(values) for key, values in found["energy"].items()},
        imbalance=found["imbalance"],
        bricks=len(found["plastic"]),
        steps=found["steps"],
        plastic_strain=np.array(found["plastic"]),
        nodes_mm=np.array(found["nodes"]),
    )
