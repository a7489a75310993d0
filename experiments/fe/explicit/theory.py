"""Theory and published numbers that the explicit solver is compared with."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import brentq

from experiments.fe.explicit.impacts import BarImpact, PlateImpact

Array = NDArray[np.float64]

#: Elements of Timoshenko's beam along half of the bar; twice as many change the frequency by 1e-5.
HALF_ELEMENTS = 100

#: Taylor's test of a copper rod of 32.4 mm, radius 3.2 mm, at 227 m/s on a rigid wall without friction, after 80 us,
#: with E = 117 GPa, Poisson's ratio 0.35, 8930 kg/m^3, a yield stress of 400 MPa and linear hardening of 100 MPa: final
#: length in mm, radius of the struck end in mm, and largest plastic strain, each from and to, by source. Other radii:
#: 7.12 (Simo 1992), 7.11 (Zienkiewicz et al. 1998), 7.22 (Foulk et al. 2021, converged).
TAYLOR = {
    "Kamoulakos (1990)": ((21.47, 21.66), (7.02, 7.12), (2.47, 3.24)),
    "Zhu and Cescotto (1995)": ((21.26, 21.49), (6.97, 7.18), (2.75, 3.03)),
    "Camacho and Ortiz (1997)": ((21.42, 21.44), (7.21, 7.24), (2.97, 3.25)),
}


def bar_hz(case: BarImpact) -> float:
    """First symmetric bending frequency of the bar as Timoshenko's free beam, with Cowper's shear coefficient.

    Two-node elements with one point for the shear, over one half of the bar: symmetry holds the rotation at mid-span.
    """
    metal, radius, half = case.metal, case.bar_radius_mm, case.bar_length_mm / 2
    area, second = math.pi * radius**2, math.pi * radius**4 / 4
    poisson, density = metal.poisson, metal.density_kg_m3 * 1e-12
    shear = 6 * (1 + poisson) / (7 + 6 * poisson) * metal.shear_mpa * area
    length, size = half / HALF_ELEMENTS, 2 * (HALF_ELEMENTS + 1)
    stiff, mass = np.zeros((size, size)), np.zeros((size, size))
    sliding = np.array((-1 / length, -0.5, 1 / length, -0.5))
    curving = np.array((0.0, -1.0, 0.0, 1.0)) / length
    own = shear * length * np.outer(sliding, sliding)
    own += metal.modulus_mpa * second * length * np.outer(curving, curving)
    lump = np.array(((2.0, 1.0), (1.0, 2.0))) * density * length / 6
    inert = np.kron(lump, np.diag((area, second)))
    for e in range(HALF_ELEMENTS):
        part = slice(2 * e, 2 * e + 4)
        stiff[part, part] += own
        mass[part, part] += inert
    keep = np.arange(size) != 1
    squares = eigh(stiff[keep][:, keep], mass[keep][:, keep], eigvals_only=True)
    omega = np.sqrt(np.maximum(squares[:2], 0.0))
    return float(omega[1] / (2 * math.pi))


def plate_hz(case: PlateImpact) -> float:
    """First frequency of the thin plate with two supported ends and two free sides, by Levy's solution.

    With ``w = Y(z) sin(pi x / a)`` and Y even, both conditions of a free side (no moment, no force) leave a
    determinant of two, whose first zero is the frequency.
    """
    metal, (length, width, thick) = case.metal, case.plate_mm
    poisson, along = metal.poisson, math.pi / length
    bending = metal.modulus_mpa * thick**3 / 12 / (1 - poisson**2)

    def determinant(share: float) -> float:
        # ``share`` is the frequency over that of a wide strip; roots of Y'' = p^2 Y and Y'' = q^2 Y, p real.
        p = along * math.sqrt(1 + share)
        q = along * np.sqrt(complex(1 - share))
        rows = [
            (
                (r * r - poisson * along**2) * np.cosh(r * width / 2),
                (r**3 - (2 - poisson) * along**2 * r) * np.sinh(r * width / 2),
            )
            for r in (p, q)
        ]
        # An odd function of q: divided by it, so that it is real and does not vanish with it.
        return float(((rows[0][0] * rows[1][1] - rows[1][0] * rows[0][1]) / q).real)

    share = brentq(determinant, 0.8, 1 - 1e-9)
    density = metal.density_kg_m3 * 1e-12 * thick
    return float(share) * along**2 * math.sqrt(bending / density) / (2 * math.pi)
