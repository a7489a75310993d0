"""Ball and bar integrated through the impact: Runge-Kutta of fourth order with even steps.

The bar is struck at mid-span: it moves as a rigid body, rolls about its axis and bends across it, alike in both
directions. It does not stretch. Its rocking by friction along its surface and gravity (0.04 mm in 3 ms) are left out.
If the bending moment exceeds the yield moment after a step, plastic curvature takes the excess; its work is counted in
full, so that the balance of energy holds for any step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.paper.bar.beam import beam
from experiments.paper.bar.contact import Contact
from experiments.paper.bar.history import History
from experiments.paper.bar.setup import Setup

Array = NDArray[np.float64]

#: Places in the state vector before the modes' amplitudes and rates, (k, 3) each.
PLACE, VELOCITY, SPIN, QUATERNION = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 13)
BAR_PLACE, BAR_VELOCITY, ROLL, RUBBED, DAMPED, MODES = slice(13, 16), slice(16, 19), 19, 20, 21, 22

#: Least time without contact at the end, in s: a sixth of the first mode's period.
FREE_S = 0.2e-3


@dataclass(frozen=True)
class Touch:
    """Approach (m), normal force (N); force on the ball, direction from bar to ball, sliding velocity, (3,) each."""

    approach_m: float
    normal_N: float  # noqa: N815  (N is newton)
    force_N: Array  # noqa: N815
    outwards: Array
    sliding_m_s: Array


def cross(a: Array, b: Array) -> Array:
    """Cross product (3,) of two vectors (3,), ten times as fast as NumPy's."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))


class _System:
    """Equations of motion of one setup."""

    def __init__(self, setup: Setup) -> None:
        self.setup, self.beam, self.contact = setup, beam(setup), Contact.of(setup)
        self.axis = np.array(setup.bar_axis)
        self.deepest_m = 0.0
        points = len(self.beam.weight_m)
        self.plastic_curvature = np.zeros((points, 3))
        self.accumulated, self.bent_J, self.stored_J = np.zeros(points), 0.0, 0.0
        self.from_plastic_N = np.zeros((setup.modes, 3))

    def start(self) -> Array:
        """The state at first touch: the bar's axis through the origin, the ball's orientation I."""
        setup, state = self.setup, np.zeros(MODES + 6 * self.setup.modes)
        state[PLACE] = setup.offset_m * np.array((0.0, -self.axis[2], self.axis[1]))  # along x cross axis
        state[0] = -np.sqrt(setup.reach_m**2 - setup.offset_m**2)
        state[VELOCITY] = setup.speed_m_s, setup.sideways_m_s, 0.0
        state[SPIN], state[QUATERNION] = setup.spin_rad_s, (0, 0, 0, 1)
        return state

    def modes(self, state: Array) -> tuple[Array, Array]:
        """Amplitudes and their rates (k, 3)."""
        both = state[MODES:].reshape(2, -1, 3)
        return both[0], both[1]

    def touch(self, state: Array) -> Touch:
        """The contact in a state."""
        setup, (amplitude, rate) = self.setup, self.modes(state)
        apart = state[PLACE] - state[BAR_PLACE] - self.beam.middle @ amplitude
        apart -= (apart @ self.axis) * self.axis
        distance = float(np.sqrt(apart @ apart))
        outwards, approach = apart / distance, setup.reach_m - distance
        normal = self.contact.force(approach, self.deepest_m) if approach > 0 else 0.0
        if normal == 0:
            return Touch(approach, 0.0, np.zeros(3), outwards, np.zeros(3))
        ball = state[VELOCITY] - setup.ball_radius_m * cross(state[SPIN], outwards)
        roll = setup.bar_radius_m * state[ROLL] * cross(self.axis, outwards)
        sliding = ball - state[BAR_VELOCITY] - self.beam.middle @ rate - roll
        sliding -= (sliding @ outwards) * outwards
        # Coulomb's law, smooth through rest.
        speed = np.sqrt(sliding @ sliding + setup.creep_m_s**2)
        force = normal * (outwards - setup.friction * sliding / speed)
        return Touch(approach, normal, force, outwards, sliding)

    def rate(self, state: Array) -> Array:
        """Time derivative of the state, with the plastic curvature held."""
        setup, bar, touch = self.setup, self.beam, self.touch(state)
        amplitude, rate = self.modes(state)
        change, force = np.zeros_like(state), touch.force_N
        change[PLACE], change[VELOCITY] = state[VELOCITY], force / setup.ball_mass_kg
        change[BAR_PLACE], change[BAR_VELOCITY] = state[BAR_VELOCITY], -force / bar.mass_kg
        if touch.normal_N:
            change[SPIN] = cross(touch.outwards, force) * (-setup.ball_radius_m / setup.ball_inertia_kg_m2)
            torque = -setup.bar_radius_m * float(cross(touch.outwards, force) @ self.axis)
            change[ROLL] = torque / setup.bar_roll_inertia_kg_m2
            change[RUBBED] = -force @ touch.sliding_m_s
        vector, scalar = state[QUATERNION][:3], state[QUATERNION][3]
        change[QUATERNION][:3] = 0.5 * (scalar * state[SPIN] + cross(state[SPIN], vector))
        change[QUATERNION][3] = -0.5 * (state[SPIN] @ vector)
        across = force - (force @ self.axis) * self.axis
        omega = bar.omega_rad_s[:, None]
        drag = 2 * setup.damping * omega * rate
        change[DAMPED] = bar.mass_kg * np.vdot(drag, rate)
        pushed = self.from_plastic_N - np.multiply.outer(bar.middle, across)
        change[MODES:] = np.concatenate((rate, pushed / bar.mass_kg - drag - omega**2 * amplitude)).ravel()
        return change

    def settle(self, state: Array) -> Touch:
        """Update the deepest approach and the plastic curvature at the end of a step; returns the contact."""
        touch = self.touch(state)
        self.deepest_m = max(self.deepest_m, touch.approach_m)
        bar, amplitude = self.beam, self.modes(state)[0]
        curvature = bar.curvature_m2 @ amplitude
        moment = bar.stiffness_n_m2 * (curvature - self.plastic_curvature)
        size = np.sqrt((moment**2).sum(1))
        excess = np.maximum(size - bar.plastic_moment_n_m(self.accumulated), 0.0)
        if excess.any():
            grown = excess / bar.stiffness_n_m2
            self.plastic_curvature += moment * (grown / np.maximum(size, 1e-300))[:, None]
            self.accumulated += grown
            # The moment falls to the yield moment while the plastic curvature grows.
            self.bent_J += float(bar.weight_m @ (grown * (size - excess / 2)))
            spread = bar.weight_m[:, None] * self.plastic_curvature
            self.from_plastic_N = bar.stiffness_n_m2 * bar.curvature_m2.T @ spread
        half = 0.5 * self.plastic_curvature - curvature
        self.stored_J = bar.stiffness_n_m2 * float(bar.weight_m @ (self.plastic_curvature * half).sum(1))
        return touch


def simulate(setup: Setup) -> History:
    """The impact from first touch to ``length_s``.

    Raises
    ------
    ValueError
        Where the step is too long, or the ball not free of the bar at the end.
    """
    system = _System(setup)
    count, step = round(setup.length_s / setup.step_s), setup.step_s
    state = system.start()
    states = np.empty((count + 1, len(state)))
    # Deepest approach, plastic work of bending, and the bar's elastic energy beyond that of its modes alone.
    extra, forces = np.empty((count + 1, 3)), np.empty((count + 1, 5))
    for i in range(count + 1):
        if i:
            first = system.rate(state)
            second = system.rate(state + step / 2 * first)
            third = system.rate(state + step / 2 * second)
            fourth = system.rate(state + step * third)
            state = state + step / 6 * (first + 2 * (second + third) + fourth)
        touch = system.settle(state)
        states[i], extra[i] = state, (system.deepest_m, system.bent_J, system.stored_J)
        forces[i, :3], forces[i, 3:] = touch.force_N, (touch.normal_N, touch.approach_m)
    if not np.isfinite(states).all():
        raise ValueError(f"step_s = {step!r}: the integration did not stay finite; lower it")
    late = round(FREE_S / step)
    if forces[-late:, 3].any():
        raise ValueError(f"length_s = {setup.length_s!r}: the ball still touches the bar; raise it")
    return _history(setup, system, states, extra, forces)


def _history(setup: Setup, system: _System, states: Array, extra: Array, forces: Array) -> History:
    bar, modes = system.beam, states[:, MODES:].reshape(len(states), 2, -1, 3)
    moving = np.einsum("nkc,nkc->n", modes[:, 1], modes[:, 1])
    bent = np.einsum("nkc,nkc,k->n", modes[:, 0], modes[:, 0], bar.omega_rad_s**2)
    squared = (states**2).T
    give = [system.contact.elastic_energy(a, d) for a, d in zip(forces[:, 4], extra[:, 0], strict=True)]
    return History(
        setup=setup,
        time_s=setup.step_s * np.arange(len(states), dtype=np.float64),
        position_m=states[:, PLACE],
        velocity_m_s=states[:, VELOCITY],
        spin_rad_s=states[:, SPIN],
        quaternion=states[:, QUATERNION] / np.linalg.norm(states[:, QUATERNION], axis=1, keepdims=True),
        force_N=forces[:, :3],
        normal_N=forces[:, 3],
        approach_m=forces[:, 4],
        bar_velocity_m_s=states[:, BAR_VELOCITY],
        middle_m=states[:, BAR_PLACE] + np.einsum("k,nkc->nc", bar.middle, modes[:, 0]),
        bent_rad=float(bar.weight_m @ np.linalg.norm(system.plastic_curvature, axis=1)),
        energy_J={
            "ball, translation": setup.ball_mass_kg / 2 * squared[VELOCITY].sum(0),
            "ball, rotation": setup.ball_inertia_kg_m2 / 2 * squared[SPIN].sum(0),
            "bar, translation": bar.mass_kg / 2 * squared[BAR_VELOCITY].sum(0),
            "bar, roll": setup.bar_roll_inertia_kg_m2 / 2 * squared[ROLL],
            "bar, vibration": bar.mass_kg / 2 * (moving + bent) + extra[:, 2],
            "bar, plastic bending": extra[:, 1],
            "contact, elastic": np.array(give),
            "contact, plastic": np.array([system.contact.plastic_work(d) for d in extra[:, 0]]),
            "friction": states[:, RUBBED],
            "damping": states[:, DAMPED],
        },
    )
