"""The compiled loops of the ball's map against plain NumPy in double precision."""

import numpy as np
import pytest
import torch
from ball_models import random, random_directions
from numpy.typing import NDArray

from torchsphere.kernels import cube_map as loops
from torchsphere.kernels import sixteen
from torchsphere.sphere_map import cube_map

Array = NDArray[np.float64]

CELLS, COUNT = 12, cube_map.coefficient_count(12)

#: Single precision has 7 digits, of places of some ten cells.
TOLERANCE = {np.float32: 2e-5, np.float64: 1e-12}

both = pytest.mark.parametrize("dtype", [np.float32, np.float64])


def bspline(t: float) -> float:
    """The cubic B-spline around 0."""
    t = abs(t)
    return 2 / 3 - t**2 + t**3 / 2 if t < 1 else max(2 - t, 0.0) ** 3 / 6


def looked_up(direction: Array) -> Array:
    """Weights (m,) of all coefficients in the value of the map in one direction."""
    axis = int(np.abs(direction).argmax())
    forwards, right, up = np.roll(direction, -axis)
    face = axis + (3 if forwards < 0 else 0)
    tangents = np.array((right, up)) / abs(forwards)
    u, v = (tangents * (5 - tangents**2) / 4 + 1) * CELLS / 2
    x, y = (np.array([bspline(t - (node - 1)) for node in range(CELLS + 3)]) for t in (u, v))
    weights = np.zeros((6, CELLS + 3, CELLS + 3))
    weights[face] = np.outer(y, x)
    return weights.ravel()


def by_loops(direction: Array, dtype: type, coefficients: Array) -> tuple[float, Array]:
    """Value of the map in a direction, and the sixteen weights as a sum over the coefficients (m,)."""
    corner, _, _, u, v, _, _ = loops.place(*direction.astype(dtype), CELLS)
    at, width = np.uint64(corner), np.uint64(CELLS + 3)
    total, fours = np.zeros(COUNT, dtype), np.zeros((COUNT, 4), dtype)
    sixteen.add_sixteen(dtype(1), at, width, dtype(u), dtype(v), fours)
    sixteen.join_fours(fours, total)
    return sixteen.sum_sixteen(coefficients.astype(dtype), at, width, dtype(u), dtype(v)), total


@both
def test_value_and_weights_of_the_map_equal_a_sum_over_all_its_splines(dtype: type) -> None:
    coefficients = random(COUNT).numpy()
    for direction in random_directions(60).numpy().T:
        expected = looked_up(direction)
        value, weights = by_loops(direction, dtype, coefficients)
        assert value == pytest.approx(expected @ coefficients, abs=TOLERANCE[dtype])
        np.testing.assert_allclose(weights, expected, rtol=0, atol=TOLERANCE[dtype])


def test_torch_gives_the_values_of_the_splines_too() -> None:
    directions, coefficients = random_directions(200), random(COUNT)
    expected = np.stack([looked_up(direction) for direction in directions.numpy().T])
    places = cube_map.places(directions, CELLS)
    np.testing.assert_allclose(places.value(coefficients), expected @ coefficients.numpy(), rtol=0, atol=1e-12)
    amounts = random(200)
    np.testing.assert_allclose(places.adjoint(amounts, COUNT), amounts.numpy() @ expected, rtol=0, atol=1e-12)


@both
def test_value_and_slopes_of_the_map_are_those_of_the_splines(dtype: type) -> None:
    coefficients, step = random(COUNT).numpy(), 1e-5
    at, width = np.uint64(3 * (CELLS + 3) + 2), np.uint64(CELLS + 3)

    def value(u: float, v: float) -> float:
        return float(sixteen.sum_sixteen(coefficients, at, width, u, v))

    for u, v in ((0.0, 0.2), (0.3, 0.8), (1.0, 0.7)):
        found = sixteen.sum_with_slopes(coefficients.astype(dtype), at, width, dtype(u), dtype(v))
        along, across = value(u + step, v) - value(u - step, v), value(u, v + step) - value(u, v - step)
        expected = value(u, v), along / (2 * step), across / (2 * step)
        # Truncation of the differences of a cubic.
        np.testing.assert_allclose(found, expected, rtol=0, atol=max(TOLERANCE[dtype], 1e-9))


@both
def test_multiples_of_sixteen_numbers_are_added_where_they_belong(dtype: type) -> None:
    values, total = (random(5 * sixteen.LANES).numpy().astype(dtype) for _ in range(2))
    expected = total.copy()
    expected[7 : 7 + sixteen.LANES] += dtype(0.3) * values[20 : 20 + sixteen.LANES]
    sixteen.add_multiple(dtype(0.3), values, np.uint64(20), total, np.uint64(7))
    np.testing.assert_allclose(total, expected, rtol=0, atol=TOLERANCE[dtype])


def test_the_loop_and_torch_choose_the_same_cells() -> None:
    directions = torch.cat((random_directions(200), torch.eye(3).double(), -torch.eye(3).double()), 1)
    places = cube_map.places(directions, CELLS)
    for k, direction in enumerate(directions.numpy().T):
        corner, axis, nearer, u, v, _, _ = loops.place(*direction, CELLS)
        assert int(corner) == int(places.corner[k])
        assert abs(1 / nearer) == pytest.approx(np.abs(direction).max())
        assert axis == np.abs(direction).argmax()
        np.testing.assert_allclose((u, v), places.offset[:, k], rtol=0, atol=1e-12)


def test_a_nan_direction_gives_a_valid_index() -> None:
    corner = int(loops.place(*np.full(3, np.nan, np.float32), CELLS)[0])
    assert corner >= 0
    assert corner + 3 * (CELLS + 4) < COUNT
    places = cube_map.places(torch.full((3, 5), torch.nan), CELLS)
    assert int(places.corner.min()) >= 0
    assert int(places.corner.max()) + 3 * (CELLS + 4) < COUNT
