"""CalculiX's input of a body that flies into another: explicit dynamics, contact by penalty."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.fe.mesh import FACES, Index, Mesh

Array = NDArray[np.float64]

#: Nodes of the ball, whose velocities are printed.
BALL = "BALL"
#: Tension in MPa that the contact's law tends to in the open: CalculiX wants one, a thousandth of any pressure here.
TENSION_MPA = 0.5
#: Most numbers on a line of a set.
PER_LINE = 12


@dataclass(frozen=True)
class Material:
    """Modulus and yield table in MPa, density in t/mm^3; ``table`` (n, 2) of stress and plastic strain, or elastic."""

    modulus_mpa: float
    poisson: float
    density_t_mm3: float
    table: Array | None = None


@dataclass(frozen=True)
class Body:
    """A mesh with its materials and its contact face."""

    name: str  # in capital letters
    mesh: Mesh
    # Elements by the material's name: numbers (from 0, within the body) and the material.
    materials: dict[str, tuple[Index, Material]]
    # Axis and end of the block's contact side, and the elements (from 0, within the body) that may touch.
    contact: tuple[int, int, Index]
    held: dict[int, Index] = field(default_factory=dict)  # held nodes (from 0) by direction (1, 2, 3)
    # CalculiX's type of the bricks: C3D8 with full integration, C3D8I with incompatible modes (for bending; increments
    # are eight times as short).
    kind: str = "C3D8"


@dataclass(frozen=True)
class Step:
    """Settings of the integration: duration in s, increments between printed velocities, and the contact.

    ``stiffness_mpa_mm`` is the pressure per penetration; with ``ball_is_slave`` the ball's nodes are kept
    out of the target's faces, otherwise the target's nodes out of the ball's faces.
    """

    length_s: float
    print_every: int
    stiffness_mpa_mm: float
    ball_is_slave: bool


def _lines(numbers: Iterable[int]) -> list[str]:
    """Numbers of a set, at most `PER_LINE` a line."""
    found = [str(number) for number in numbers]
    return [", ".join(found[i : i + PER_LINE]) for i in range(0, len(found), PER_LINE)]


def _mesh(body: Body, first_node: int, first_element: int) -> list[str]:
    """Nodes, elements, materials and the contact surface of a body whose numbers start at the given ones."""
    mesh, name = body.mesh, body.name
    text = [f"*NODE, NSET={name}"]
    text += [f"{first_node + i}, {x:.9g}, {y:.9g}, {z:.9g}" for i, (x, y, z) in enumerate(mesh.nodes_mm.tolist())]
    for label, (members, material) in body.materials.items():
        text.append(f"*ELEMENT, TYPE={body.kind}, ELSET={label}")
        corners = mesh.elements[members] + first_node
        for number, nodes in zip((members + first_element).tolist(), corners.tolist(), strict=True):
            text.append(f"{number}, " + ", ".join(map(str, nodes)))
        text += [f"*MATERIAL, NAME={label}", "*ELASTIC", f"{material.modulus_mpa:.9g}, {material.poisson:.9g}"]
        text += ["*DENSITY", f"{material.density_t_mm3:.9g}"]
        if material.table is not None:
            text.append("*PLASTIC")
            text += [f"{stress:.9g}, {strain:.9g}" for stress, strain in material.table.tolist()]
        text.append(f"*SOLID SECTION, ELSET={label}, MATERIAL={label}")
    axis, end, members = body.contact
    text.append(f"*SURFACE, NAME={name}FACE, TYPE=ELEMENT")
    text += [f"{number}, S{FACES[axis][end]}" for number in (members + first_element).tolist()]
    return text


def _held(body: Body, first_node: int) -> list[str]:
    text = []
    for direction, nodes in body.held.items():
        text += [f"*NSET, NSET={body.name}HELD{direction}", *_lines((nodes + first_node).tolist())]
        text += ["*BOUNDARY", f"{body.name}HELD{direction}, {direction}"]
    return text


def deck(ball: Body, target: Body, velocity_mm_s: Sequence[float], step: Step) -> str:
    """The whole input: the ball, whose nodes come first, flies into the target.

    Raises
    ------
    ValueError
        Where an element has no material or two, or a length is not above 0.
    """
    for body in (ball, target):
        given = np.sort(np.concatenate([members for members, _ in body.materials.values()]))
        if not np.array_equal(given, np.arange(len(body.mesh.elements))):
            raise ValueError(f"{body.name}: expected one material for each of {len(body.mesh.elements)} elements")
    if not (step.length_s > 0 and step.print_every > 0 and step.stiffness_mpa_mm > 0):
        raise ValueError(f"{step!r}: expected a length, a number of increments and a stiffness above 0")
    starts = (1, len(ball.mesh.nodes_mm) + 1), (1, len(ball.mesh.elements) + 1)
    text = []
    for body, node, element in zip((ball, target), *starts, strict=True):
        text += _mesh(body, node, element)
    for body, node in zip((ball, target), starts[0], strict=True):
        text += _held(body, node)
    pair = (ball, target) if step.ball_is_slave else (target, ball)
    text += [
        "*SURFACE INTERACTION, NAME=TOUCH",
        "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR",
        f"{step.stiffness_mpa_mm:.9g}, {TENSION_MPA:.9g}",
        "*CONTACT PAIR, INTERACTION=TOUCH, TYPE=NODE TO SURFACE",
        f"{pair[0].name}FACE, {pair[1].name}FACE",
        "*INITIAL CONDITIONS, TYPE=VELOCITY",
        *(f"{ball.name}, {i + 1}, {component:.9g}" for i, component in enumerate(velocity_mm_s)),
        "*STEP, NLGEOM, INC=100000000",
        "*DYNAMIC, EXPLICIT",
        # CalculiX shortens the first increment to a stable length.
        f"{step.length_s / 100:.9g}, {step.length_s:.9g}",
        f"*NODE PRINT, NSET={ball.name}, FREQUENCY={step.print_every}",
        "V",
        "*END STEP",
    ]
    return "\n".join(text) + "\n"


def write(path: Path, text: str) -> Path:
    """Write an input file; returns its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="ascii")
    return path
