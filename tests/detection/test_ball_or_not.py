"""Whether a circle is the outline of a ball; a wrong one that was given is reported, as every length scales with it."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from shots import speckle

from torchsphere import Circle
from torchsphere.cli.main import main
from torchsphere.detection.ball_or_not import (
    given_circle_warning,
    lacking_proof,
    needs_proof,
    refined_circle_warning,
    require_ball,
    require_proof,
    shows_outline,
)
from torchsphere.motion.findings import Findings
from torchsphere.sphere_map.decision import MadeMap
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


#: A flake of snow: exact in its own image, and gone.
FLAKE = Circle(14.4, 196.9, 3.2, 0.1, 0.1, 0.1)
BALL = Circle(64.3, 92.6, 40.0, 0.1, 0.1, 0.1)


def test_outlines_that_contradict_each_other_are_not_those_of_a_ball() -> None:
    lack = lacking_proof(BALL, is_proven=False, outline_scatter=0.08)
    with pytest.raises(ValueError, match=r"radii that differ by 8 %, and no map .* give its outline with circle"):
        require_proof(BALL, lack)


def test_a_small_disc_that_the_next_frames_do_not_show_is_no_ball() -> None:
    assert lacking_proof(FLAKE, is_proven=False) == ""
    lack = lacking_proof(FLAKE, is_proven=False, untried_frames=18)
    with pytest.raises(ValueError, match=r"so small that .*, the frames right after it hardly show the same"):
        require_proof(FLAKE, lack)


def test_outlines_alike_a_map_or_a_place_are_enough() -> None:
    assert lacking_proof(BALL, is_proven=False, outline_scatter=0.01) == ""
    assert lacking_proof(BALL, is_proven=True, outline_scatter=0.08) == ""
    assert not Findings().proves_ball
    assert Findings(map=MadeMap()).proves_ball
    assert lacking_proof(BALL, is_proven=False, outline_scatter=0.08) != ""
    require_proof(BALL, "")


def test_a_circle_in_doubt_needs_a_proof_unless_its_radius_is_measured() -> None:
    assert not needs_proof(BALL)
    assert not needs_proof(FLAKE)
    for radius, guessed in ((3.2, False), (40.0, True)):
        vague = Circle(64.3, 92.6, radius, 2.0, 2.0, 2.0, sd_guessed=guessed)
        assert needs_proof(vague)
        assert lacking_proof(vague, is_proven=False) == vague.doubt


def test_a_circle_that_nothing_shows_to_be_a_ball_is_refused_with_the_reason() -> None:
    require_ball(BALL)
    with pytest.raises(ValueError, match="may not be the ball: it does not move; if it is, give its outline"):
        require_ball(dataclasses.replace(BALL, unproven="it does not move"))


def test_an_image_shows_the_outline_of_its_ball_and_none_elsewhere(image: torch.Tensor) -> None:
    assert shows_outline(image, Circle(64.3, 92.6, 40.0))
    assert not shows_outline(image, Circle(64.3, 92.6, 22.0))
