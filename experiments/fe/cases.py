"""The parameters of both impacts, each a dataclass, and the bodies for their decks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.fe.deck import BALL, Body, Material, Step, deck
from experiments.fe.hardening import ALUMINIUM, STEEL, JohnsonCook
from experiments.fe.mesh import Index, Mesh
from experiments.fe.shapes import half_ball, half_plate, quarter_ball, quarter_bar

Array = NDArray[np.float64]

#: 1 kg/m^3 in t/mm^3.
KG_M3 = 1e-12
#: Largest distance of a node from its plane of symmetry, in mm.
PLANE_MM = 1e-6
#: Modulus and Poisson's ratio of the steel ball; not in the paper.
BALL_MPA, BALL_POISSON = 210e3, 0.3


@dataclass(frozen=True, kw_only=True)
class BarCase:
    """Frontal impact on the bar (section 5.1, table 4), a quarter of it: x along the barrel, y along the bar."""

    size_mm: float = 2.0  # elements at the contact
    coarse_mm: float = 2.5  # elements on the bar's far side
    long_mm: float = 6.0  # elements at the bar's ends
    length_us: float = 900.0  # integrated from first touch
    ball_radius_mm: float = 15.0
    ball_mass_kg: float = 0.110
    speed_m_s: float = 70.0
    bar_radius_mm: float = 9.0
    bar_length_mm: float = 300.0
    modulus_mpa: float = 72e3
    poisson: float = 0.27
    density_kg_m3: float = 2800.0  # of the bar, as in `experiments.paper.bar.setup`
    hardening: JohnsonCook = ALUMINIUM
    # Strain rates of the table within ``zone_mm`` of first touch (70 m/s over a contact's radius of 4 mm), and beyond
    # (in bending): those of `experiments.paper.bar.setup`.
    contact_rate_hz: float = 20_000.0
    bending_rate_hz: float = 100.0
    zone_mm: float = 9.0
    # Pressure per penetration, in units of the bar's modulus by ``size_mm``. 1 costs no shorter increments and lets the
    # bodies overlap by 2 % of an element at 1.5 GPa.
    stiffness_factor: float = 1.0
    print_every: int = 4

    #: The whole ball over the meshed part.
    PARTS = 4


@dataclass(frozen=True, kw_only=True)
class PlateCase:
    """Oblique impact on the plate (section 6, table 5), half of it: x along the plate, y off it, z across.

    The edges at the ends of x rest on supports that they neither leave nor sink into, and slide freely on them. The
    impact is at the middle and without friction, since the paper's ball "slides on the plate" with "almost no
    dissipation"; the paper gives neither number.
    """

    size_mm: float = 4.0  # elements along the ball's path; one element through the thickness
    long_mm: float = 10.0  # elements at the edges
    path_mm: tuple[float, float] = (-20.0, 60.0)  # where along x the elements are small
    # Elements of the ball at the contact; smaller than the plate's, into whose faces its nodes must not sink.
    ball_size_mm: float = 2.0
    length_us: float = 800.0
    ball_radius_mm: float = 9.5
    ball_mass_kg: float = 0.028
    speed_m_s: float = 80.0
    angle_deg: float = 15.0
    plate_mm: tuple[float, float, float] = (400.0, 200.0, 1.0)
    modulus_mpa: float = 190e3
    poisson: float = 0.25
    density_kg_m3: float = 7850.0  # of steel, not in the paper
    hardening: JohnsonCook = STEEL
    rate_hz: float = 200.0  # strain rate of the table: 20 m/s of normal speed over a span of 100 mm
    stiffness_factor: float = 1.0
    print_every: int = 40
    # Type of the plate's bricks. One brick through the thickness bends only with incompatible modes (C3D8I); with full
    # integration (C3D8) the same mesh is far too stiff.
    kind: str = "C3D8I"

    PARTS = 2


def ball_mesh(case: BarCase | PlateCase) -> Mesh:
    """The meshed part of the ball, at first touch."""
    if isinstance(case, BarCase):
        mesh = quarter_ball(case.ball_radius_mm, case.size_mm, 2.5 * max(case.size_mm, 1.4))
        return mesh.moved((-case.ball_radius_mm - case.bar_radius_mm, 0.0, 0.0))
    mesh = half_ball(case.ball_radius_mm, case.ball_size_mm, 2 * case.ball_size_mm)
    return mesh.moved((0.0, case.ball_radius_mm, 0.0))


def target_mesh(case: BarCase | PlateCase) -> Mesh:
    """The meshed part of the bar or the plate."""
    if isinstance(case, BarCase):
        return quarter_bar(case.bar_radius_mm, case.bar_length_mm / 2, case.size_mm, case.coarse_mm, case.long_mm)
    return half_plate(*case.plate_mm, case.path_mm, case.size_mm, case.long_mm)


def _plane(mesh: Mesh, axis: int) -> Index:
    return np.flatnonzero(np.abs(mesh.nodes_mm[:, axis]) < PLANE_MM)


def _ball(case: BarCase | PlateCase, side: tuple[int, int], planes: tuple[int, ...]) -> Body:
    """The elastic ball; its density is the one that gives the meshed ball its true mass."""
    mesh = ball_mesh(case)
    density = case.ball_mass_kg * 1e-3 / case.PARTS / mesh.volumes_mm3().sum()
    every = np.arange(len(mesh.elements))
    material = Material(BALL_MPA, BALL_POISSON, density)
    held = {axis + 1: _plane(mesh, axis) for axis in planes}
    return Body(BALL, mesh, {"STEELBALL": (every, material)}, (*side, mesh.side(*side)), held)


def bar_deck(case: BarCase) -> str:
    """CalculiX's input of the frontal impact."""
    mesh = target_mesh(case)
    # The density makes up for the mass between the flat faces and the circle, as for the ball.
    true_mm3 = math.pi * case.bar_radius_mm**2 / 2 * case.bar_length_mm / 2
    density = case.density_kg_m3 * KG_M3 * true_mm3 / mesh.volumes_mm3().sum()
    middle = np.array((-case.bar_radius_mm, 0.0, 0.0))
    near = np.linalg.norm(mesh.centres_mm - middle, axis=1) < case.zone_mm
    tables = {"NEAR": (near, case.contact_rate_hz), "FAR": (~near, case.bending_rate_hz)}
    materials = {
        name: (np.flatnonzero(chosen), Material(case.modulus_mpa, case.poisson, density, case.hardening.table(rate)))
        for name, (chosen, rate) in tables.items()
    }
    top = mesh.side(0, 0)
    touching = top[mesh.centres_mm[top, 1] < case.ball_radius_mm]
    bar = Body("BAR", mesh, materials, (0, 0, touching), {axis + 1: _plane(mesh, axis) for axis in (1, 2)})
    step = Step(case.length_us * 1e-6, case.print_every, case.stiffness_factor * case.modulus_mpa / case.size_mm, False)
    return deck(_ball(case, (0, 1), (1, 2)), bar, (1e3 * case.speed_m_s, 0.0, 0.0), step)


def plate_deck(case: PlateCase) -> str:
    """CalculiX's input of the oblique impact."""
    mesh = target_mesh(case)
    every = np.arange(len(mesh.elements))
    table = case.hardening.table(case.rate_hz)
    steel = Material(case.modulus_mpa, case.poisson, case.density_kg_m3 * KG_M3, table)
    x, y = mesh.nodes_mm[:, 0], mesh.nodes_mm[:, 1]
    edges = (np.abs(np.abs(x) - case.plate_mm[0] / 2) < PLANE_MM) & (y < -PLANE_MM)
    held = {2: np.flatnonzero(edges), 3: _plane(mesh, 2)}
    top = mesh.side(1, 1)
    reached = (mesh.centres_mm[top, 0] > case.path_mm[0]) & (mesh.centres_mm[top, 0] < case.path_mm[1] + 20)
    touching = top[reached & (mesh.centres_mm[top, 2] < 2 * case.ball_radius_mm)]
    plate = Body("PLATE", mesh, {"PLATESTEEL": (every, steel)}, (1, 1, touching), held, case.kind)
    angle = math.radians(case.angle_deg)
    velocity = (1e3 * case.speed_m_s * math.cos(angle), -1e3 * case.speed_m_s * math.sin(angle), 0.0)
    stiffness = case.stiffness_factor * case.modulus_mpa / case.ball_size_mm
    step = Step(case.length_us * 1e-6, case.print_every, stiffness, True)
    return deck(_ball(case, (1, 0), (2,)), plate, velocity, step)
