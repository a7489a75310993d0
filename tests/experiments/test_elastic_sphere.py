"""The elastic sphere under a pressure on its cap, against equilibrium and the half-space of Boussinesq."""

import dataclasses
import math

import numpy as np
import pytest
import torch

from experiments.paper import flattening
from experiments.paper.bar.elastic_sphere import PushedSphere, _amplitudes

SPHERE = PushedSphere(0.015, 210e9, 0.3, 60e3, 4e-3)


def test_a_pressure_all_around_shrinks_the_sphere_evenly() -> None:
    a, b = _amplitudes(0, 0.3, -1e-3, 0.0)
    # The radial stress over 2 G of an even strain e is (1 + nu) / (1 - 2 nu) e.
    assert a * (-2 + 4 * 0.3) == pytest.approx(-1e-3 * 0.4 / 1.3)
    assert b == 0.0


def test_one_condition_of_the_first_term_follows_from_the_other_by_the_balance_of_forces() -> None:
    inertia = SPHERE.force_N / (4 / 3 * math.pi * SPHERE.radius_m**2)
    assert SPHERE._pressure(1) == pytest.approx(inertia)
    ratio = 0.3 / 0.7
    a, _ = _amplitudes(1, 0.3, 0.0, inertia * (1 - ratio) / 5)
    assert -4 * 1.3 * a == pytest.approx(-SPHERE._pressure(1) + inertia * (3 + 2 * ratio) / 5)


def test_the_pole_goes_in_as_that_of_a_half_space_and_the_far_side_hardly_moves() -> None:
    # A small cap: the pole of a half-space under an even pressure p goes in by 2 (1 - nu^2) p a / E.
    small = dataclasses.replace(SPHERE, force_N=100.0, cap_m=0.5e-3)
    pole, edge, far = small.displacement(np.array([0.0, math.asin(0.5 / 15), math.pi]))[0]
    pressure = 100.0 / (math.pi * 0.5e-3**2)
    expected = 2 * (1 - 0.3**2) * pressure * 0.5e-3 / 210e9
    assert pole == pytest.approx(-expected, rel=0.05)
    # At the cap's edge a share of 2 / pi of it.
    assert edge - far == pytest.approx(-expected * 2 / math.pi, rel=0.08)
    assert abs(far) < 0.05 * expected


def test_displacements_are_proportional_to_the_force_and_along_the_axis_there_is_no_shear() -> None:
    angle = np.linspace(0, math.pi, 7)
    once, twice = SPHERE.displacement(angle), dataclasses.replace(SPHERE, force_N=120e3).displacement(angle)
    np.testing.assert_allclose(np.array(twice), 2 * np.array(once), rtol=1e-9)
    assert once[1][[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-15)


def test_the_outline_goes_in_where_the_ball_is_pushed_and_its_sides_stay_in_their_halves() -> None:
    deformation = flattening.Deformation.of(SPHERE)
    at = torch.tensor([[0.99, 0.0], [0.9, 0.3], [0.9, -0.3], [0.0, 0.0], [1.2, 0.0]], dtype=torch.float64)
    moved = flattening.moved(at, deformation).numpy()
    assert moved[0, 0] < 0
    assert abs(moved[0, 1]) < 1e-15
    np.testing.assert_allclose(moved[1], moved[2] * [1, -1], rtol=1e-9)
    # The front's middle is seen along its own displacement outwards, which leaves the motion along the axis.
    assert abs(moved[3, 1]) < 1e-15
    np.testing.assert_array_equal(moved[4], 0.0)


def test_a_larger_circle_and_one_beside_it_are_round() -> None:
    angle = np.linspace(0.3, math.pi, 50)
    circle = flattening.Deformation(angle, 0.01 + 0.02 * np.cos(angle), np.zeros(50))
    assert flattening.off_round(circle, angle > 0.2) < 1e-15
    assert flattening.off_round(dataclasses.replace(circle, outwards=0.01 * np.cos(2 * angle)), angle > 0.2) > 1e-3
