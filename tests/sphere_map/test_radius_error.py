"""The radius on a map of the ball where its outline contradicts it, or its turn hardly tells it."""

import dataclasses
import math

import pytest
import torch
from shots import rotation_matrix

from torchsphere import Circle
from torchsphere.sphere_map import radius_error

MEASURED = Circle(60.0, 60.0, 54.0, 0.1, 0.1, 0.2)
GUESSED = dataclasses.replace(MEASURED, sd_radius=2.0, sd_guessed=True)
GIVEN = Circle(60.0, 60.0, 54.0)


def turned(angle_deg: float, axis: tuple[float, float, float]) -> torch.Tensor:
    """Orientations (3, 3, 3) of a ball that turns by ``angle_deg`` about ``axis``."""
    about = torch.tensor(axis, dtype=torch.float64)
    return torch.stack([rotation_matrix(math.radians(a) * about) for a in (0.0, angle_deg / 2, angle_deg)])


def test_a_turn_about_the_line_of_sight_shows_no_other_side_of_the_ball() -> None:
    assert radius_error.turn_out_of_plane(turned(40.0, (0.0, 0.0, 1.0))) == pytest.approx(0.0, abs=1e-12)
    assert radius_error.turn_out_of_plane(turned(40.0, (0.0, 1.0, 0.0))) == pytest.approx(math.radians(40.0))
    assert radius_error.turn_out_of_plane(turned(150.0, (1.0, 0.0, 0.0))) == pytest.approx(math.radians(150.0))


def test_the_distance_from_a_measured_outline_counts_only_where_it_contradicts_the_map() -> None:
    far = turned(90.0, (0.0, 1.0, 0.0))
    assert radius_error.by_outline(54.5, far, MEASURED) == 0.0
    assert radius_error.by_outline(55.5, far, MEASURED) == pytest.approx(1.5)


def test_a_ball_that_hardly_turns_leaves_the_radius_of_its_map_in_doubt() -> None:
    little, some, far = (turned(angle, (0.0, 1.0, 0.0)) for angle in (0.1, 2.0, 90.0))
    for turn, error in ((little, 2.0), (some, 0.05 / math.radians(2.0)), (far, 0.05 / (math.pi / 2))):
        assert radius_error.by_outline(54.1, turn, GUESSED) == pytest.approx(error)
    assert radius_error.by_outline(54.1, little, GIVEN) == pytest.approx(0.1)
    assert radius_error.by_outline(57.0, some, GIVEN) == pytest.approx(0.05 / math.radians(2.0))
    assert radius_error.by_outline(54.0, little, GIVEN) == 0.0


def test_a_blurred_outline_leaves_its_start_s_error_at_most() -> None:
    assert radius_error.by_blur(0.3, 0.0, GUESSED) == 0.0
    assert radius_error.by_blur(1.3, 0.0, GUESSED) == pytest.approx(0.8)
    assert radius_error.by_blur(1.3, 0.0, MEASURED) == pytest.approx(0.2)


def test_the_model_holds_the_blur_of_the_optics_and_not_that_of_a_codec() -> None:
    assert radius_error.by_blur(0.7, 1.6, GUESSED) == radius_error.by_blur(0.7, 0.0, GUESSED) == pytest.approx(0.32)
    assert radius_error.by_blur(2.0, 1.9, MEASURED) == radius_error.by_blur(2.0, 1.9, GUESSED) == pytest.approx(0.085)


def test_the_blur_of_any_lens_is_held_if_the_outlines_show_it_too() -> None:
    """Of 0.65 px, as lenses have: the radius is 0.003 px off, and 0.3 px was stated."""
    assert radius_error.by_blur(0.65, 0.6, GUESSED) == pytest.approx(0.05 * 0.35)
    # Nothing jumps where a blur begins to count.
    assert radius_error.by_blur(0.301, 0.3, GUESSED) < 1e-4


def test_a_light_from_one_side_leaves_the_dark_outline_in_doubt_and_one_from_the_front_does_not() -> None:
    for x, y, z, error in ((0.0, 0.0, -0.5, 0.0), (0.6, 0.0, -0.2, 0.6), (0.3, -0.4, 0.0, 0.5)):
        light = torch.tensor([1.0, x, y, z], dtype=torch.float64)
        assert radius_error.by_light(light) == pytest.approx(error * radius_error.RADIUS_ERROR_PER_LIGHT)
