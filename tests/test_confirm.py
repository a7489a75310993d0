"""A circle that was given is held against the image, since every length scales with its radius."""

import pytest
import torch

from torchsphere import Circle, demo
from torchsphere.confirm import confirm


@pytest.fixture(scope="module")
def image(demo_shot: demo.Shot) -> torch.Tensor:
    """The demo's first frame: a ball of 40 px at (64.3, 92.6)."""
    return torch.as_tensor(demo_shot.images[0]).float()


@pytest.mark.parametrize("circle", [(64.3, 92.6, 40.0), (64.6, 92.3, 40.8)])
def test_a_circle_that_a_careful_hand_gives_is_confirmed(image: torch.Tensor, circle: tuple[float, ...]) -> None:
    assert confirm(image, Circle(*circle)) == ""


@pytest.mark.parametrize("circle", [(64.3, 92.6, 36.0), (64.3, 92.6, 44.0), (70.3, 92.6, 40.0)])
def test_one_that_is_off_is_told_with_the_outline_that_is_seen(image: torch.Tensor, circle: tuple[float, ...]) -> None:
    said = confirm(image, Circle(*circle))
    assert said.startswith(f"The circle that was given, {circle[0]},{circle[1]},{circle[2]} px, is not the outline")
    assert "at 64." in said
    assert ",40." in said


def test_one_that_is_far_off_is_not_confirmed(image: torch.Tensor) -> None:
    for radius in (25.0, 30.0, 55.0):
        assert "was not confirmed" in confirm(image, Circle(64.3, 92.6, radius))
