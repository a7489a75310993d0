"""Central differences: a meshed body, a rigid ball, and the history of their motion and energies."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from experiments.fe.explicit.elements import HOURGLASS_WORK, PLASTIC_WORK, STRESS_WORK, VISCOUS_WORK, add_forces
from experiments.fe.explicit.johnson_cook import KG_M3, Metal
from experiments.fe.explicit.sphere_contact import CONTACT_ENERGY, FRICTION_WORK, Sphere, add_contact
from experiments.fe.mesh import Mesh

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

#: Share of the longest step by the bricks' edges over the speed of sound. A brick that swells alike in all directions
#: allows 0.73 of it.
SAFETY = 0.6
#: A contact's spring in units of the node's mass by the squared first step: as stiff as stays stable beside the bricks.
SPRING = 0.7
#: Largest growth of the step from one to the next.
GROWTH = 1.02

# Places of the clock: time and last step in s, number of steps; kinetic energy of the mesh and of the ball in mJ and
# their time in s, one step before.
TIME, STEP, COUNT, KINETIC, BALL_KINETIC, SEEN = range(6)


@dataclass(frozen=True)
class Body:
    """A mesh of one metal: what is held, and how it moves at the start."""

    mesh: Mesh
    metal: Metal
    held: Flags  # directions (n, 3) in which nodes keep their velocity, which is mostly zero
    velocity_m_s: Array  # of the nodes (n, 3) at the start
    surface: Index = field(default_factory=lambda: np.zeros(0, np.int64))  # nodes that the ball may touch
    # Mass of the true body in kg, where flat faces cut a round one; that of the mesh otherwise.
    mass_kg: float | None = None

    @property
    def density_kg_m3(self) -> float:
        """Density that gives the mesh its mass."""
        if self.mass_kg is None:
            return self.metal.density_kg_m3
        return 1e-3 * self.mass_kg / KG_M3 / float(self.mesh.volumes_mm3().sum())

    @property
    def node_mass_t(self) -> Array:
        """Mass of each node (n,) in t."""
        return self.mesh.shares() * self.density_kg_m3 * KG_M3 * self.mesh.volumes_mm3().sum()


@dataclass(frozen=True)
class History:
    """Motion and energies at ``t`` times in m, s and J; energies are those of the whole, planes of symmetry undone."""

    time_s: Array  # (t,)
    place_mm: Array  # of the ball's centre (t, 3)
    velocity_m_s: Array  # of the ball (t, 3)
    spin_rad_s: Array  # of the ball (t, 3)
    momentum_kg_m_s: Array  # of the meshed body (t, 3)
    energy_J: dict[str, Array]  # noqa: N815  (energies (t,) by name; their sum does not change)
    plastic_work_J: Array  # noqa: N815  (part of the work of the stress (t,))
    steps: int

    @property
    def total_energy_J(self) -> Array:  # noqa: N802
        """Sum of all energies (t,); it is constant."""
        return np.sum(list(self.energy_J.values()), axis=0)

    @property
    def imbalance(self) -> float:
        """Largest change of the sum of the energies over its first value."""
        total = self.total_energy_J
        return float(np.abs(total / total[0] - 1).max())


@dataclass
class State:
    """What changes from step to step: the mesh in mm, t, s, and the ball."""

    nodes: Array  # (n, 3)
    velocity: Array  # (n, 3)
    stress: Array  # (e, 3, 3)
    hourglass: Array  # (e, 3, 4)
    plastic_strain: Array  # (e,)
    temperature_k: Array  # (e,)
    ball: Array  # (3, 3): centre, velocity, spin
    seen: Array  # (3, 3): the same at the time of the energies
    clock: Array  # (6,)
    work: Array  # (4,) of the elements
    contact: Array  # (2,)
    push: Array  # (2, 3) on the ball
    rubbed: Array  # friction on the nodes of the surface (s, 3)

    @classmethod
    def at_start(cls, body: Body, sphere: Sphere | None) -> State:
        """The state before the first step."""
        count = len(body.mesh.elements)
        ball = np.zeros((3, 3))
        if sphere:
            ball[:] = sphere.centre_mm, 1e3 * np.array(sphere.velocity_m_s), sphere.spin_rad_s
        return cls(
            nodes=body.mesh.nodes_mm.astype(np.float64),
            velocity=1e3 * body.velocity_m_s,
            stress=np.zeros((count, 3, 3)),
            hourglass=np.zeros((count, 3, 4)),
            plastic_strain=np.zeros(count),
            temperature_k=np.full(count, body.metal.start_k),
            ball=ball,
            seen=ball.copy(),
            clock=np.zeros(6),
            work=np.zeros(4),
            contact=np.zeros(2),
            push=np.zeros((2, 3)),
            rubbed=np.zeros((len(body.surface), 3)),
        )


@numba.njit(cache=True, error_model="numpy")
def move_ball(
    sphere: Array, moves: Array, push: Array, between_s: float, step_s: float, ball: Array, seen: Array
) -> float:
    """Bring the ball (3, 3) to the end of a step; ``seen`` becomes its state before. Returns its kinetic energy there.

    ``sphere`` is radius, friction, mass, inertia and parts; ``moves`` (2, 3) is 0 where the ball is held, else 1.
    """
    kinetic = 0.0
    for i in range(3):
        seen[0, i] = ball[0, i]
        for k in range(2):
            before, heavy = ball[1 + k, i], sphere[2 + k]
            ball[1 + k, i] += between_s * sphere[4] * push[k, i] / heavy * moves[k, i]
            kinetic += 0.5 * heavy * before * ball[1 + k, i]
            seen[1 + k, i] = 0.5 * (before + ball[1 + k, i])
        ball[0, i] += step_s * ball[1, i]
    return kinetic


@numba.njit(cache=True, error_model="numpy")
def advance(
    metal: Array,
    elements: Index,
    volume: Array,
    mass: Array,
    moves: Array,
    surface: Index,
    spring: Array,
    sphere: Array,
    ball_moves: Array,
    nodes: Array,
    velocity: Array,
    stress: Array,
    held: Array,
    plastic: Array,
    temperature: Array,
    ball: Array,
    seen: Array,
    clock: Array,
    work: Array,
    contact: Array,
    push: Array,
    rubbed: Array,
    until_s: float,
) -> bool:
    """Integrate up to the first step that begins at a time or after it; returns False if a brick turned inside out.

    Velocities are those of the middles of the steps, energies those at the last step's begin. ``moves`` (n, 3) is 0
    where a node is held, else 1.
    """
    force = np.empty_like(nodes)
    while True:
        force[:] = 0.0
        last = clock[STEP]
        longest = add_forces(
            metal, elements, volume, nodes, velocity, stress, held, plastic, temperature, last, force, work
        )
        if not longest > 0.0:
            return False
        add_contact(
            surface, spring, rubbed, mass, nodes, velocity, ball, sphere[0], sphere[1], last, force, push, contact
        )
        step = SAFETY * longest
        if last > 0.0:
            step = min(step, GROWTH * last)
        between = 0.5 * (last + step)
        kinetic = 0.0
        for n in range(nodes.shape[0]):
            for i in range(3):
                before = velocity[n, i]
                velocity[n, i] += between * force[n, i] / mass[n] * moves[n, i]
                kinetic += 0.5 * mass[n] * before * velocity[n, i]
                nodes[n, i] += step * velocity[n, i]
        clock[KINETIC] = kinetic
        clock[BALL_KINETIC] = move_ball(sphere, ball_moves, push, between, step, ball, seen)
        clock[SEEN] = clock[TIME]
        clock[STEP] = step
        clock[TIME] += step
        clock[COUNT] += 1.0
        if clock[SEEN] >= until_s:
            return True


class _System:
    """The arrays of one impact that do not change, and the step over them."""

    def __init__(self, body: Body, sphere: Sphere | None) -> None:
        self.sphere, self.parts = sphere, sphere.parts if sphere else 1
        self.mass = body.node_mass_t
        metal = replace(body.metal, density_kg_m3=body.density_kg_m3).constants()
        elements, volume = body.mesh.elements, body.mesh.volumes_mm3()
        moves = np.where(body.held, 0.0, 1.0)
        size = (sphere.radius_mm, sphere.friction, sphere.mass_t, sphere.inertia_t_mm2) if sphere else (0, 0, 1, 1)
        free = (sphere.free, sphere.spin_free) if sphere else np.zeros((2, 3))
        surface = body.surface if sphere else np.zeros(0, np.int64)
        rest = State.at_start(body, None)
        longest = add_forces(
            metal, elements, volume, rest.nodes, 0 * rest.velocity, rest.stress, rest.hourglass,
            rest.plastic_strain, rest.temperature_k, 0.0, np.zeros_like(rest.nodes), np.zeros(4),
        )  # fmt: skip
        spring = SPRING * self.mass[surface] / (SAFETY * longest) ** 2
        #: The arguments of `advance` before the state.
        self.fixed: tuple[Any, ...] = (
            *(metal, elements, volume, self.mass, moves, surface, spring),
            *(np.array((*size, self.parts), dtype=np.float64), np.array(free, dtype=np.float64)),
        )

    def advance(self, state: State, until_s: float) -> None:
        """Integrate a state up to the first step at a time or after it."""
        good = advance(*self.fixed, *vars(state).values(), until_s)
        if not (good and np.isfinite(state.clock).all()):
            raise RuntimeError(
                f"an element turned inside out at {1e6 * state.clock[TIME]:.1f} us; a finer or more even mesh may help"
            )

    def energies(self, state: State) -> dict[str, float]:
        """Energies in J at the time of the state's energies."""
        part = 1e-3 * self.parts
        return {
            "body, moving": part * state.clock[KINETIC],
            "body, stress": part * state.work[STRESS_WORK],
            "body, hourglass": part * state.work[HOURGLASS_WORK],
            "body, bulk viscosity": part * state.work[VISCOUS_WORK],
            "ball": 1e-3 * state.clock[BALL_KINETIC] if self.sphere else 0.0,
            "contact": part * state.contact[CONTACT_ENERGY],
            "friction": part * state.contact[FRICTION_WORK],
        }


def integrate(
    body: Body,
    sphere: Sphere | None,
    length_s: float,
    record_s: float,
    each: Callable[[State], None] = lambda _: None,
) -> tuple[History, State]:
    """Integrate an impact from 0 to ``length_s``; a record about every ``record_s``, with a call of ``each``.

    Raises
    ------
    ValueError
        Where a time is not above 0.
    RuntimeError
        Where an element turned inside out.
    """
    if not (0 < record_s <= length_s < math.inf):
        raise ValueError(f"length_s = {length_s!r}, record_s = {record_s!r}: expected times above 0, the first longer")
    system, state = _System(body, sphere), State.at_start(body, sphere)
    rows: list[Array] = []
    energies: list[dict[str, float]] = []
    for time in np.arange(0.0, length_s + record_s / 2, record_s):
        system.advance(state, float(time))
        momentum = system.mass @ state.velocity * system.parts
        rows.append(np.concatenate(((state.clock[SEEN], state.work[PLASTIC_WORK]), state.seen.ravel(), momentum)))
        energies.append(system.energies(state))
        each(state)
    found = np.array(rows)
    place, velocity, spin, momentum = (found[:, 2 + 3 * i : 5 + 3 * i] for i in range(4))
    history = History(
        time_s=found[:, 0],
        place_mm=place,
        velocity_m_s=1e-3 * velocity,
        spin_rad_s=spin,
        momentum_kg_m_s=momentum,
        energy_J={name: np.array([one[name] for one in energies]) for name in energies[0]},
        plastic_work_J=1e-3 * system.parts * found[:, 1],
        steps=int(state.clock[COUNT]),
    )
    return history, state
