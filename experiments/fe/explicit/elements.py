"""Eight-node bricks with one point of integration: strain, stress in the Jaumann rate, and forces of the nodes.

The gradient is that at the brick's middle (Flanagan and Belytschko, Int. J. Num. Meth. Eng. 17 (1981) 679). The four
hourglass patterns in each direction are held by the stiffness that an assumed strain without locking gives them
(Belytschko and Bindeman, Comp. Meth. Appl. Mech. Eng. 105 (1993) 225), in a frame that turns with the brick. So one
brick through the thickness bends and twists as a plate does. If the brick yields, its hourglass forces return by the
same factor as its stress: no modulus is left to choose.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from experiments.fe.explicit.johnson_cook import DENSITY, HEATING, LAME, SHEAR, YIELD, plastic_step
from experiments.fe.mesh import CORNERS

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: The hourglass patterns (8, 4) at the corners: eta zeta, zeta xi, xi eta, xi eta zeta.
HOURGLASS = np.column_stack(
    (
        CORNERS[:, 1] * CORNERS[:, 2],
        CORNERS[:, 2] * CORNERS[:, 0],
        CORNERS[:, 0] * CORNERS[:, 1],
        CORNERS[:, 0] * CORNERS[:, 1] * CORNERS[:, 2],
    )
)
#: Shares of the linear and the quadratic bulk viscosity, which damp the shortest waves; customary values.
LINEAR_VISCOSITY, QUADRATIC_VISCOSITY = 0.06, 1.2

# Places of the sums over the elements: work of the stress, of the hourglass forces, of the bulk viscosity, and the
# plastic work, which is a part of the first; in mJ.
STRESS_WORK, HOURGLASS_WORK, VISCOUS_WORK, PLASTIC_WORK = range(4)


@numba.njit(cache=True, error_model="numpy")
def gradients(x: Array, jacobian: Array, inverse: Array, slope: Array) -> float:
    """Fill the Jacobian (3, 3), its inverse, and the slopes (8, 3) of a brick's middle; returns the determinant."""
    for i in range(3):
        for j in range(3):
            total = 0.0
            for a in range(8):
                total += CORNERS[a, i] * x[a, j]
            jacobian[i, j] = total / 8.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for m in range(3):
            n, o = (m + 1) % 3, (m + 2) % 3
            inverse[m, i] = jacobian[j, n] * jacobian[k, o] - jacobian[j, o] * jacobian[k, n]
    determinant = 0.0
    for m in range(3):
        determinant += jacobian[0, m] * inverse[m, 0]
    for m in range(3):
        for i in range(3):
            inverse[m, i] /= determinant
    for a in range(8):
        for m in range(3):
            slope[a, m] = (
                CORNERS[a, 0] * inverse[m, 0] + CORNERS[a, 1] * inverse[m, 1] + CORNERS[a, 2] * inverse[m, 2]
            ) / 8.0
    return determinant


@numba.njit(cache=True, error_model="numpy")
def midstep(v: Array, slope: Array, step_s: float, rate: Array) -> None:
    """Velocity gradient (3, 3) at the middle of the step, from the slopes at its end.

    The places at the middle are ``x - v step / 2``, hence ``L (1 - L step / 2)^-1``, here to second order.
    """
    end = np.zeros((3, 3))
    for a in range(8):
        for i in range(3):
            for j in range(3):
                end[i, j] += v[a, i] * slope[a, j]
    for i in range(3):
        for j in range(3):
            square, cube = 0.0, 0.0
            for k in range(3):
                square += end[i, k] * end[k, j]
                for m in range(3):
                    cube += end[i, k] * end[k, m] * end[m, j]
            rate[i, j] = end[i, j] + 0.5 * step_s * square + 0.25 * step_s * step_s * cube


@numba.njit(cache=True, error_model="numpy")
def turned(stress: Array, rate: Array, step_s: float, out: Array) -> None:
    """Turn a stress (3, 3) by the spin of a step, by Cayley's exact rotation (Hughes and Winget, 1980)."""
    spin, turn, half = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    size = 0.0
    for i in range(3):
        for j in range(3):
            spin[i, j] = 0.5 * step_s * (rate[i, j] - rate[j, i])
            size += 0.5 * spin[i, j] * spin[i, j]
    share = 1.0 / (1.0 + 0.25 * size)
    for i in range(3):
        for j in range(3):
            square = spin[i, 0] * spin[0, j] + spin[i, 1] * spin[1, j] + spin[i, 2] * spin[2, j]
            turn[i, j] = (1.0 if i == j else 0.0) + share * (spin[i, j] + 0.5 * square)
    for i in range(3):
        for j in range(3):
            half[i, j] = turn[i, 0] * stress[0, j] + turn[i, 1] * stress[1, j] + turn[i, 2] * stress[2, j]
    for i in range(3):
        for j in range(3):
            out[i, j] = half[i, 0] * turn[j, 0] + half[i, 1] * turn[j, 1] + half[i, 2] * turn[j, 2]


@numba.njit(cache=True, error_model="numpy")
def strained(
    metal: Array, stress: Array, rate: Array, step_s: float, plastic: Array, temperature: Array, e: int, out: Array
) -> tuple[float, float]:
    """Add a step's strain to a turned stress (3, 3) and let it yield.

    Returns the factor by which the deviator returned, and the plastic work per volume.
    """
    trace = (rate[0, 0] + rate[1, 1] + rate[2, 2]) * step_s
    size = 0.0
    for i in range(3):
        for j in range(3):
            strain = 0.5 * (rate[i, j] + rate[j, i]) * step_s
            size += (strain - (trace / 3.0 if i == j else 0.0)) ** 2
            out[i, j] = stress[i, j] + 2.0 * metal[SHEAR] * strain + (metal[LAME] * trace if i == j else 0.0)
    mean = (out[0, 0] + out[1, 1] + out[2, 2]) / 3.0
    deviator = 0.0
    for i in range(3):
        for j in range(3):
            deviator += (out[i, j] - (mean if i == j else 0.0)) ** 2
    trial = math.sqrt(1.5 * deviator)
    if not trial > 0.0 or metal[YIELD] == math.inf:
        return 1.0, 0.0
    growth = plastic_step(metal, trial, plastic[e], temperature[e], step_s, math.sqrt(2.0 / 3.0 * size))
    if growth == 0.0:
        return 1.0, 0.0
    back = 1.0 - 3.0 * metal[SHEAR] * growth / trial
    for i in range(3):
        for j in range(3):
            pressure = mean if i == j else 0.0
            out[i, j] = pressure + back * (out[i, j] - pressure)
    work = back * trial * growth
    plastic[e] += growth
    temperature[e] += metal[HEATING] * work
    return back, work


@numba.njit(cache=True, error_model="numpy")
def frame_of(jacobian: Array, frame: Array, length: Array) -> None:
    """Axes (3, 3) that turn with the brick, in rows, and its edges along them (3,)."""
    for i in range(3):
        frame[0, i] = jacobian[0, i]
    size = math.sqrt(frame[0, 0] ** 2 + frame[0, 1] ** 2 + frame[0, 2] ** 2)
    along = 0.0
    for i in range(3):
        frame[0, i] /= size
        along += frame[0, i] * jacobian[1, i]
    for i in range(3):
        frame[1, i] = jacobian[1, i] - along * frame[0, i]
    size = math.sqrt(frame[1, 0] ** 2 + frame[1, 1] ** 2 + frame[1, 2] ** 2)
    for i in range(3):
        frame[1, i] /= size
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        frame[2, i] = frame[0, j] * frame[1, k] - frame[0, k] * frame[1, j]
    for i in range(3):
        length[i] = 8.0 * (jacobian[i, 0] * frame[i, 0] + jacobian[i, 1] * frame[i, 1] + jacobian[i, 2] * frame[i, 2])


@numba.njit(cache=True, error_model="numpy")
def stiffened(metal: Array, length: Array, grown: Array, out: Array) -> None:
    """Growth (3, 4) of the hourglass forces by that of the patterns' amplitudes, in the brick's frame.

    ``own[i]`` is a third of the volume over the squared half edge, ``both`` the same for two edges.
    """
    shear, poisson = metal[SHEAR], 0.5 * metal[LAME] / (metal[LAME] + metal[SHEAR])
    own = np.empty(3)
    for i in range(3):
        own[i] = length[(i + 1) % 3] * length[(i + 2) % 3] / length[i] / 3.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        # The face across i is warped, which shears both faces beside it.
        out[i, i] = shear * (
            (own[j] + own[k]) * grown[i, i] + length[k] / 3.0 * grown[j, j] + length[j] / 3.0 * grown[k, k]
        )
        out[i, 3] = 2.0 * shear * (1.0 + poisson) / 3.0 * own[i] * grown[i, 3]
    for i in range(3):
        for j in range(3):
            if i != j:
                # Bending, with the stress of a plate.
                both = length[3 - i - j] / 3.0
                out[i, j] = 2.0 * shear / (1.0 - poisson) * (own[i] * grown[i, j] + poisson * both * grown[j, i])


@numba.njit(cache=True, error_model="numpy")
def hourglass(
    metal: Array,
    x: Array,
    v: Array,
    slope: Array,
    jacobian: Array,
    held: Array,
    step_s: float,
    back: float,
    push: Array,
) -> float:
    """Update a brick's hourglass forces ``held`` (3, 4), add them to those of its nodes (8, 3); returns their work."""
    frame, length, gamma = np.empty((3, 3)), np.empty(3), np.empty((8, 4))
    frame_of(jacobian, frame, length)
    for q in range(4):
        first, second, third = 0.0, 0.0, 0.0
        for a in range(8):
            first += HOURGLASS[a, q] * x[a, 0]
            second += HOURGLASS[a, q] * x[a, 1]
            third += HOURGLASS[a, q] * x[a, 2]
        for a in range(8):
            linear = first * slope[a, 0] + second * slope[a, 1] + third * slope[a, 2]
            gamma[a, q] = (HOURGLASS[a, q] - linear) / 8.0
    grown, added = np.zeros((3, 4)), np.empty((3, 4))
    for a in range(8):
        for i in range(3):
            along = frame[i, 0] * v[a, 0] + frame[i, 1] * v[a, 1] + frame[i, 2] * v[a, 2]
            for q in range(4):
                grown[i, q] += gamma[a, q] * along * step_s
    stiffened(metal, length, grown, added)
    work = 0.0
    for i in range(3):
        for q in range(4):
            after = back * (held[i, q] + added[i, q])
            work += 0.5 * (held[i, q] + after) * grown[i, q]
            held[i, q] = after
    for q in range(4):
        for j in range(3):
            force = held[0, q] * frame[0, j] + held[1, q] * frame[1, j] + held[2, q] * frame[2, j]
            for a in range(8):
                push[a, j] += gamma[a, q] * force
    return work


@numba.njit(cache=True, error_model="numpy")
def viscosity(metal: Array, growth_hz: float, thin_mm: float, density: float) -> float:
    """Bulk viscosity as a stress in MPa, of a rate of volume: linear always, quadratic in compression."""
    sound = math.sqrt((metal[LAME] + 2.0 * metal[SHEAR]) / density)
    linear = LINEAR_VISCOSITY * density * sound * thin_mm * growth_hz
    if growth_hz >= 0.0:
        return linear
    return linear - density * (QUADRATIC_VISCOSITY * thin_mm * growth_hz) ** 2


@numba.njit(cache=True, error_model="numpy")
def add_forces(
    metal: Array,
    elements: Index,
    volume: Array,
    nodes: Array,
    velocity: Array,
    stress: Array,
    held: Array,
    plastic: Array,
    temperature: Array,
    step_s: float,
    force: Array,
    work: Array,
) -> float:
    """Bring the stress (e, 3, 3) to the end of a step, and take the bricks' forces from those of the nodes (n, 3).

    Adds the step's work to ``work`` (4,); returns the longest step in s that the bricks allow, before safety. A brick
    turned inside out makes it negative. ``volume`` (e,) is that before the impact.
    """
    x, v, push = np.empty((8, 3)), np.empty((8, 3)), np.empty((8, 3))
    jacobian, inverse, slope, rate = np.empty((3, 3)), np.empty((3, 3)), np.empty((8, 3)), np.empty((3, 3))
    first, last = np.empty((3, 3)), np.empty((3, 3))
    longest = math.inf
    for e in range(elements.shape[0]):
        for a in range(8):
            for i in range(3):
                x[a, i], v[a, i], push[a, i] = nodes[elements[e, a], i], velocity[elements[e, a], i], 0.0
        now = 8.0 * gradients(x, jacobian, inverse, slope)
        if not now > 0.0:
            return -1.0
        steep = 0.0
        for i in range(3):
            steep = max(steep, inverse[0, i] ** 2 + inverse[1, i] ** 2 + inverse[2, i] ** 2)
        thin, density = 2.0 / math.sqrt(steep), metal[DENSITY] * volume[e] / now
        longest = min(longest, thin / math.sqrt((metal[LAME] + 2.0 * metal[SHEAR]) / density))
        midstep(v, slope, step_s, rate)
        turned(stress[e], rate, step_s, first)
        back, plastic_work = strained(metal, first, rate, step_s, plastic, temperature, e, last)
        growth = rate[0, 0] + rate[1, 1] + rate[2, 2]
        middle = now * (1.0 - 0.5 * growth * step_s)
        damped = viscosity(metal, growth, thin, density)
        for i in range(3):
            for j in range(3):
                work[STRESS_WORK] += 0.5 * (first[i, j] + last[i, j]) * rate[i, j] * step_s * middle
                stress[e, i, j] = last[i, j]
        work[VISCOUS_WORK] += damped * growth * step_s * middle
        work[PLASTIC_WORK] += plastic_work * middle
        work[HOURGLASS_WORK] += hourglass(metal, x, v, slope, jacobian, held[e], step_s, back, push)
        for a in range(8):
            for i in range(3):
                own = damped * slope[a, i]
                for j in range(3):
                    own += last[i, j] * slope[a, j]
                force[elements[e, a], i] -= now * own + push[a, i]
    return longest
