"""The smooth process with a spring against matrix exponentials and sums of many small steps."""

import numpy as np
import pytest
import torch

from torchsphere.estimation.process_model import (
    SPRINGS,
    STATES,
    initial_jerk_snap,
    integrator,
    spring_matrix,
    spring_noise,
    transitions,
    white_noise,
)


def exponential(duration: float, frequency: float) -> np.ndarray:
    rate = np.diag(np.ones(STATES - 1), 1)
    rate[-1, -2] = -(frequency**2)
    return torch.linalg.matrix_exp(torch.from_numpy(duration * rate)).numpy()


@pytest.mark.parametrize("frequency", [0.0, 0.2, 1.0, 6.0])
def test_the_matrix_of_a_spring_is_the_exponential_of_its_rate(frequency: float) -> None:
    found = spring_matrix(np.array([1.0, 0.3]), np.array(frequency))
    for one, duration in zip(found, (1.0, 0.3), strict=True):
        np.testing.assert_allclose(one, exponential(duration, frequency), rtol=1e-9, atol=1e-12)


def test_a_spring_of_no_stiffness_is_an_integrator() -> None:
    duration, none = np.array([0.2, 1.0, 3.0]), np.zeros(3)
    np.testing.assert_allclose(spring_matrix(duration, none), integrator(duration), rtol=1e-12)
    np.testing.assert_allclose(spring_noise(duration, none), white_noise(duration, STATES), rtol=1e-12)


def test_the_noise_of_a_spring_is_the_sum_over_many_small_steps() -> None:
    last = np.stack([exponential(t, 0.8)[:, -1] for t in (np.arange(2000) + 0.5) / 2000])
    found = spring_noise(np.array([1.0]), np.array([0.8]))[0]
    np.testing.assert_allclose(found, last.T @ last / 2000, rtol=1e-6)


def test_without_noise_a_spring_of_a_half_turn_makes_a_half_sine() -> None:
    times, window = np.arange(20.0)[None], np.array([[[2.5, 16.5]]])
    moves = transitions(times, window, np.ones((1, 1)))
    inside = moves.matrix[0, 0, 3:16]
    state = np.array([0.0, 0.0, np.sin(np.pi * 0.5 / 14), np.pi / 14 * np.cos(np.pi * 0.5 / 14), 0.0])
    state[4] = -((np.pi / 14) ** 2) * state[2]
    forces = [state[2]]
    for matrix in inside:
        state = matrix @ state
        forces.append(state[2])
    np.testing.assert_allclose(forces, np.sin(np.pi * (np.arange(14) + 0.5) / 14), atol=1e-9)


@pytest.mark.parametrize("spring", SPRINGS)
def test_without_noise_each_spring_makes_a_force_that_begins_and_ends_at_0(spring: float) -> None:
    first = np.array([0.0, 0.0, 0.0, *initial_jerk_snap(np.array(spring))])
    steps = spring_matrix(np.array([0.25, 0.5, 0.75, 1.0]), np.array(np.pi * spring))
    force = (steps @ first)[:, 2]
    assert force[1] == pytest.approx(1.0, abs=1e-5)
    assert force[3] == pytest.approx(0.0, abs=1e-5)
    assert force[0] == pytest.approx(force[2], abs=1e-5)


def test_springs_without_noise_are_a_parabola_a_half_sine_and_a_squared_sine() -> None:
    for spring, force in ((0.0, 0.75), (1.0, np.sin(np.pi / 4)), (2.0, 0.5)):
        first = np.array([0.0, 0.0, 0.0, *initial_jerk_snap(np.array(spring))])
        assert (spring_matrix(np.array(0.25), np.array(np.pi * spring)) @ first)[2] == pytest.approx(force, abs=1e-5)
