"""A ball moves against what is still, or turns; a picture of a ball does neither."""

import math

import pytest
import torch
from shots import noisy, rotation_matrix, speckle

from torchsphere.detection.ball_motion import Disc, step_of_ball
from torchsphere.detection.scene import Scene
from torchsphere.imaging.interpolation import blur
from torchsphere.synthetic import ray_caster

RADIUS, SHAPE, START = 16.0, (90, 120), (44.2, 43.6)

#: Motions per frame: steps, px, and turns about an axis, degrees.
STILL, NO_TURN = (0.0, 0.0), (0.0, 0.0, 0.0)


def wall(shape: tuple[int, int] = SHAPE) -> torch.Tensor:
    """A wall with a texture (h, w)."""
    return 110 + 40 * blur(torch.randn(1, *shape, generator=torch.Generator().manual_seed(5)), 1.5)[0]


def filmed(
    step: tuple[float, float],
    turn_deg: tuple[float, float, float] = NO_TURN,
    *,
    behind: torch.Tensor | float = 90.0,
    plain: bool = False,
    count: int = 12,
) -> torch.Tensor:
    """Images (n, h, w) of a ball before a still background."""
    moves = torch.tensor(START) + torch.arange(count)[:, None] * torch.tensor(step)
    turn = torch.deg2rad(torch.tensor(turn_deg, dtype=torch.float64))
    turned = torch.stack([rotation_matrix(turn * i) for i in range(count)]).float()
    pattern = speckle(1, RADIUS, 200.0, 200.01) if plain else speckle(1, RADIUS)
    return noisy(ray_caster.render(pattern, moves, RADIUS, turned, behind, shape=SHAPE), 2.0, 3)


def by_hand(images: torch.Tensor, step_px: int) -> torch.Tensor:
    """The first image, seen by a camera that moves by whole pixels to the right and back."""
    places = [abs(step_px * i) for i in range(len(images))]
    return torch.stack([image.roll(-place, -1) for image, place in zip(images, places, strict=True)])


def step_in(images: torch.Tensor, *, plain: bool = False, hidden: bool = False) -> torch.Tensor | None:
    """Step of the ball in the first frame."""
    scene = Scene.of(lambda start, stop: images[start:stop], len(images), None)
    disc = Disc(torch.tensor([*START, RADIUS], dtype=torch.float64), 0, plain)
    return step_of_ball(scene, disc, hidden=hidden)


@pytest.mark.parametrize("behind", [90.0, wall()], ids=["uniform", "textured"])
@pytest.mark.parametrize("plain", [False, True], ids=["speckled", "plain"])
def test_a_ball_that_moves_is_a_ball(behind: torch.Tensor | float, plain: bool) -> None:
    step = step_in(filmed((3.0, 0.5), behind=behind, plain=plain), plain=plain)
    assert step is not None
    assert (step - torch.tensor([3.0, 0.5])).abs().max() < 0.5


@pytest.mark.parametrize("turn_deg", [(0.0, 2.0, 0.0), (0.0, 0.0, 3.0)])
def test_a_ball_that_turns_in_place_is_a_ball(turn_deg: tuple[float, float, float]) -> None:
    assert step_in(filmed(STILL, turn_deg, behind=wall())) is not None


def test_a_slow_ball_is_seen_to_move_in_later_frames() -> None:
    step = step_in(filmed((0.2, 0.0), behind=wall()))
    assert step is not None
    assert abs(float(step[0]) - 0.2) < 0.05


def test_a_ball_in_two_frames_moves_once() -> None:
    assert step_in(filmed((3.0, 0.5), count=2)) is not None


def test_a_ball_at_the_end_of_a_recording_is_compared_with_the_frames_before() -> None:
    images = filmed((3.0, 0.5)).flip(0)
    scene = Scene.of(lambda start, stop: images[start:stop], len(images), None)
    last = Disc(torch.tensor([*START, RADIUS], dtype=torch.float64), len(images) - 1, plain=False)
    step = step_of_ball(scene, last)
    assert step is not None
    assert (step - torch.tensor([-3.0, -0.5])).abs().max() < 0.5


@pytest.mark.parametrize("plain", [False, True], ids=["poster", "lamp"])
@pytest.mark.parametrize("hand_px", [0, 2], ids=["at rest", "by hand"])
def test_what_moves_as_the_wall_does_is_no_ball(plain: bool, hand_px: int) -> None:
    images = by_hand(filmed(STILL, behind=wall(), plain=plain), hand_px)
    assert step_in(images, plain=plain) is None


def test_a_poster_that_turns_with_the_camera_is_no_ball() -> None:
    picture = filmed(STILL, behind=wall(), count=1)
    rows, columns = torch.arange(SHAPE[0])[:, None] - START[1], torch.arange(SHAPE[1]) - START[0]
    images = []
    for frame in range(6):
        cosine, sine = math.cos(0.03 * frame), math.sin(0.03 * frame)
        x, y = cosine * columns - sine * rows + START[0], sine * columns + cosine * rows + START[1]
        grid = torch.stack((2 * x / (SHAPE[1] - 1) - 1, 2 * y / (SHAPE[0] - 1) - 1), -1)[None].float()
        images.append(torch.nn.functional.grid_sample(picture[None], grid, mode="bicubic", align_corners=True)[0, 0])
    assert step_in(noisy(torch.stack(images), 1.0, 4)) is None


def test_a_ball_of_which_a_part_is_hidden_must_turn() -> None:
    for turn_deg, is_ball in ((NO_TURN, False), ((0.0, 4.0, 0.0), True)):
        images = filmed((1.0, 0.0), turn_deg, behind=wall())
        images[:, 48:] = wall()[48:].round()
        assert (step_in(images, hidden=True) is not None) == is_ball
