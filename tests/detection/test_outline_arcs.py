"""An outline that is there all round, and what only looks like one."""

import pytest
import torch
from shots import noisy, speckle

from torchsphere.detection.outline_arcs import Arcs, arcs_of
from torchsphere.synthetic import ray_caster

CIRCLE = torch.tensor([60.3, 50.7, 24.0], dtype=torch.float64)
SHAPE = (100, 120)


def distances() -> torch.Tensor:
    """Distance of each pixel from the circle, px outwards."""
    rows, columns = torch.arange(SHAPE[0])[:, None], torch.arange(SHAPE[1])
    return (columns - CIRCLE[0]).hypot(rows - CIRCLE[1]) - CIRCLE[2]


def speckled(background: torch.Tensor | float = 90.0) -> torch.Tensor:
    pose = CIRCLE[None, :2].float(), torch.eye(3)[None]
    return noisy(ray_caster.render(speckle(0, 24.0), pose[0], 24.0, pose[1], background, shape=SHAPE), 2.0, 1)[0]


def plain(edge_px: float = 1.0) -> torch.Tensor:
    """A plain disc whose edge is so wide."""
    return noisy(60 + 100 * (0.5 - distances() / edge_px).clamp(0, 1)[None], 2.0, 1)[0]


@pytest.mark.parametrize("image", [speckled(), plain()], ids=["speckled", "plain"])
def test_a_ball_has_its_outline_all_round(image: torch.Tensor) -> None:
    assert arcs_of(image, CIRCLE).are_all_round
    # A circle beside it has not.
    assert not arcs_of(image, CIRCLE + torch.tensor([3.0, 0.0, 0.0])).are_all_round
    assert not arcs_of(image, CIRCLE + torch.tensor([0.0, 0.0, 4.0])).are_all_round


def test_an_outline_that_is_half_hidden_has_half_of_its_arcs() -> None:
    image = speckled()
    image[50:] = 170.0
    arcs = arcs_of(image, CIRCLE)
    assert 0.3 < arcs.share < 0.7
    assert not arcs.are_all_round


def test_a_soft_spot_of_light_and_a_box_have_no_outline_all_round() -> None:
    assert arcs_of(plain(edge_px=40.0), CIRCLE).share < 0.5
    rows, columns = torch.arange(SHAPE[0])[:, None], torch.arange(SHAPE[1])
    box = ((columns - CIRCLE[0]).abs() < 21) & ((rows - CIRCLE[1]).abs() < 21)
    assert not arcs_of(noisy(torch.where(box, 160.0, 60.0)[None], 2.0, 1)[0], CIRCLE).are_all_round


@pytest.mark.parametrize("seed", range(4))
def test_noise_and_texture_have_no_outline(seed: int) -> None:
    noise = torch.randn(1, *SHAPE, generator=torch.Generator().manual_seed(seed))
    assert arcs_of(noisy(100 + 10 * noise, 0.0, 0)[0], CIRCLE).share < 0.5
    blotches = torch.nn.functional.avg_pool2d(noise[None], 5, stride=1, padding=2)[0, 0]
    assert not arcs_of(noisy(100 + 150 * blotches[None], 2.0, 0)[0], CIRCLE).are_all_round


@pytest.mark.parametrize(("gain", "offset"), [(1 / 255, 0.0), (257.0, 1000.0)])
def test_gain_and_offset_of_the_levels_change_nothing(gain: float, offset: float) -> None:
    for image in (speckled(), plain()):
        assert torch.equal(arcs_of(image, CIRCLE).seen, arcs_of(gain * image + offset, CIRCLE).seen)


def test_an_image_without_noise_shows_its_outline() -> None:
    assert arcs_of(torch.where(distances() < 0, 200.0, 100.0), CIRCLE).are_all_round
    assert arcs_of(torch.full(SHAPE, 100.0), CIRCLE).share == 0


def test_arcs_beyond_the_image_are_not_known() -> None:
    at_border = torch.tensor([10.0, 50.0, 24.0], dtype=torch.float64)
    known = arcs_of(speckled(), at_border).known
    # From x towards y: the arcs in the middle look to the left, out of the image.
    assert not known[7:9].any()
    assert known[[0, 15]].all()


def test_lacking_arcs_in_a_row_are_worse_than_as_many_spread() -> None:
    known, spread, row = (torch.ones(16, dtype=torch.bool) for _ in range(3))
    spread[[0, 5, 10]] = False
    assert Arcs(known, spread).are_all_round
    row[[15, 0, 1]] = False
    assert Arcs(known, row).are_all_round
    row[2] = False
    assert not Arcs(known, row).are_all_round
