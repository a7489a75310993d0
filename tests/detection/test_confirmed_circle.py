"""Warnings about a given circle that does not fit the image: every length scales with its radius."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from shots import speckle

from torchsphere import Circle
from torchsphere.cli.main import main
from torchsphere.detection.detect import given_circle_warning, refined_circle_warning
from torchsphere.synthetic import demo_shot as demo
from torchsphere.synthetic import ray_caster


@pytest.fixture(scope="module")
def image(demo_shot: demo.Shot) -> torch.Tensor:
    """First frame of the demo: a ball of 40 px at (64.3, 92.6)."""
    return torch.as_tensor(demo_shot.images[0]).float()


@pytest.mark.parametrize("circle", [(64.3, 92.6, 40.0), (64.6, 92.3, 40.8)])
def test_a_circle_drawn_by_hand_with_care_is_confirmed(image: torch.Tensor, circle: tuple[float, ...]) -> None:
    assert given_circle_warning(image, Circle(*circle)) == ""


@pytest.mark.parametrize("circle", [(64.3, 92.6, 36.0), (64.3, 92.6, 44.0), (70.3, 92.6, 40.0)])
def test_a_wrong_circle_is_reported_with_the_outline(image: torch.Tensor, circle: tuple[float, ...]) -> None:
    said = given_circle_warning(image, Circle(*circle))
    assert said.startswith(f"The circle that was given, {circle[0]},{circle[1]},{circle[2]} px, is not the outline")
    assert "at 64." in said
    assert ",40." in said


def test_the_warning_about_a_fitted_circle_does_not_ask_for_a_circle(image: torch.Tensor) -> None:
    # The user gave --circle already.
    for radius, guessed, why in ((7.5, False, "so small"), (40.0, True, "no limb")):
        said = refined_circle_warning(Circle(64.3, 92.6, radius, 0.1, 0.1, 0.1, sd_guessed=guessed))
        assert said.startswith(f"The circle that was given was fitted by `refine`, at 64.3,92.6,{radius} px")
        assert why in said
        assert "leave out `refine`" in said
        assert "`circle`" not in said
    assert refined_circle_warning(Circle(64.3, 92.6, 40.0, 0.1, 0.1, 0.1)) == ""


def test_for_a_small_ball_with_a_fitted_circle_the_advice_is_no_fit(tmp_path: Path) -> None:
    moves = torch.tensor([[22.0 + 1.5 * i, 32.3] for i in range(4)])
    images = ray_caster.render(speckle(0, 8.0), moves, 8.0, torch.eye(3).expand(4, 3, 3), 90.0, shape=(64, 64))
    np.save(tmp_path / "small.npy", images.round().numpy().astype(np.uint8))
    for options, advice in (((), "give --circle"), (("--circle", "22.3,32.3,8", "--refine"), "leave out --refine")):
        out = tmp_path / advice[0]
        assert main(["track", str(tmp_path / "small.npy"), "--out", str(out), *options, "--no-report", "--quiet"]) == 0
        warnings = json.loads((out / "summary.json").read_text())["warnings"]
        (said,) = (sentence for sentence in warnings if "so small" in sentence)
        assert advice in said
        assert ("--circle" in said) == (not options)


def test_a_circle_far_from_the_ball_is_not_confirmed(image: torch.Tensor) -> None:
    for radius in (25.0, 30.0, 55.0):
        assert "was not confirmed" in given_circle_warning(image, Circle(64.3, 92.6, radius))
