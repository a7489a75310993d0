"""Which circle of a recording is the ball, and when none is."""

import numpy as np
import pytest
import torch
from shots import noisy, speckle

import torchsphere as ts
from experiments.validation import no_ball_footage as footage
from experiments.validation.no_ball_footage import Empty, View
from torchsphere.detection.ball_search import HEAD, MAX_TRIES, _frames_to_try, find
from torchsphere.geometry.circle import Circle
from torchsphere.settings.limits import SettingError
from torchsphere.synthetic import demo_shot as demo
from torchsphere.synthetic import ray_caster

RADIUS, SHAPE = 16.0, (90, 140)


def found_in(images: torch.Tensor) -> Circle:
    return find(lambda start, stop: images[start:stop], len(images))


def crossing(behind: torch.Tensor, first: int, count: int, *, plain: bool, step: float = 8.0) -> torch.Tensor:
    """Images (n, h, w) before a still background, which a ball crosses from frame ``first`` on."""
    pattern = speckle(2, RADIUS, 30.0, 30.01) if plain else speckle(2, RADIUS)
    moves = torch.tensor([[step * (i - first) - RADIUS, 46.0 + 0.2 * i] for i in range(count)])
    return noisy(ray_caster.render(pattern, moves, RADIUS, torch.eye(3).expand(count, 3, 3), behind), 2.0, 4)


def blotch() -> torch.Tensor:
    """A wall (h, w) with a dark blotch that is nearly round, and a round lamp."""
    rows, columns = torch.arange(SHAPE[0])[:, None], torch.arange(SHAPE[1])
    wall = torch.full(SHAPE, 120.0)
    wall[((rows - 20) / 13.0).square() + ((columns - 110) / 15.0).square() < 1] = 70.0
    wall[(rows - 70).square() + (columns - 24).square() < 14**2] = 200.0
    return wall


@pytest.mark.parametrize("plain", [False, True], ids=["speckled", "plain"])
def test_a_ball_that_comes_late_is_preferred_to_what_stays(plain: bool) -> None:
    circle = found_in(crossing(blotch(), 6, 20, plain=plain))
    # The whole ball is in view 32 px after its first pixel.
    assert 10 <= circle.frame <= 12
    assert circle.x == pytest.approx(8.0 * (circle.frame - 6) - RADIUS, abs=0.5)
    assert circle.radius == pytest.approx(RADIUS, abs=0.5)
    assert circle.doubt == ""


def test_a_ball_that_its_background_hides_in_part_is_found_in_its_first_frame() -> None:
    # In the first frame 11 of 14 arcs show the outline: too few to know a ball by, enough for one that is known.
    count, thrown_back = 40, 21
    times = torch.arange(count)
    x = 22.0 + 6.0 * times.clamp(max=thrown_back) - 1.5 * (times - thrown_back).clamp(min=0)
    waves = torch.sin(torch.arange(220) / 9.0) * torch.cos(torch.arange(90)[:, None] / 11.0)
    behind = 90.0 + 20.0 * torch.linspace(-1, 1, 220) + 8.0 * waves
    behind[:, int(x.max()) + 17 :] = 170.0
    moves, still = torch.stack((x, torch.full_like(x, 46.0)), -1), torch.eye(3).expand(count, 3, 3)
    circle = found_in(noisy(ray_caster.render(speckle(3, RADIUS), moves, RADIUS, still, behind), 2.0, 4))
    assert circle.frame == 0
    assert (circle.x, circle.y, circle.radius) == pytest.approx((22.0, 46.0, RADIUS), abs=0.3)
    assert circle.others == ()


def test_a_ball_that_comes_out_from_behind_a_plate_is_found_with_its_own_circle() -> None:
    images = crossing(torch.full((90, 160), 120.0), 4, 26, plain=False, step=6.0)
    images[:, :, :60] = noisy(torch.full((26, 90, 60), 170.0), 2.0, 6)
    circle = found_in(images)
    true = 6.0 * (circle.frame - 4) - RADIUS
    # Not before two thirds of its width are in view.
    assert 60 + RADIUS / 3 <= true <= 60 + RADIUS + 12
    assert (circle.x, circle.radius) == pytest.approx((true, RADIUS), abs=0.5)


def test_a_short_flight_in_a_long_recording_is_found_from_its_first_frames() -> None:
    flight = crossing(blotch(), 0, 18, plain=False)
    empty = noisy(blotch()[None], 2.0, 5)

    def images(start: int, stop: int) -> torch.Tensor:
        return torch.cat([flight[i - 150 : i - 149] if 150 <= i < 168 else empty for i in range(start, stop)])

    circle = find(images, 400)
    assert 154 <= circle.frame <= 156
    assert circle.x == pytest.approx(8.0 * (circle.frame - 150) - RADIUS, abs=0.5)


# The first five were found at the ball and its shadow in the median of the frames, with 41.9 to 46.5 px for 40.
CUTS = [(1, 35, 13), (1, 34, 17), (1, 33, 24), (1, 32, 28), (1, 36, 13), (1, 26, 12), (1, 58, 13)]


@pytest.mark.parametrize(("seed", "first", "count"), [*CUTS, (2, 34, 17), (3, 33, 24), (4, 38, 12)])
def test_a_cut_of_the_demo_from_any_first_frame_has_the_radius_of_its_ball(seed: int, first: int, count: int) -> None:
    demo_shot = demo.make_shot(seed)
    images = torch.from_numpy(demo_shot.images[first : first + count]).float()
    circle = found_in(images)
    assert abs(circle.radius - demo.RADIUS_PX) < 3 * circle.sd_radius
    assert circle.sd_radius < 0.005 * demo.RADIUS_PX
    true = demo_shot.position[first + circle.frame]
    assert np.hypot(circle.x - true[0], circle.y - true[1]) < 0.5
    assert circle.doubt == ""


def test_a_recording_that_begins_in_contact_is_measured_with_the_radius_of_its_ball(demo_shot: demo.Shot) -> None:
    track = ts.track(demo_shot.images[35:48], log=False)
    off = abs(track.circle.radius - demo.RADIUS_PX)
    assert off < min(3 * track.circle.sd_radius, 0.005 * demo.RADIUS_PX)
    assert (track.status == "ok").all()


SMALL = View(5, 72, 96)
EMPTY = {
    "noise": footage.noise_alone(SMALL, 12.0),
    "wall by hand": footage.smooth_wall_by_hand(SMALL),
    "switch by hand": footage.light_switch(SMALL, is_held=True),
    "texture by hand": footage.pan(SMALL, 4.0, 2.0),
    "spot of light": footage.drifting_light(SMALL, 12.0),
    "people": footage.people(View(5, 100, 120)),
    "cloth": footage.cloth(SMALL, 2.0, 45.0),
    "clock": footage.clock(SMALL, is_held=False),
    "clock by hand": footage.clock(SMALL, is_held=True),
    "poster": footage.poster(SMALL, 18.0, is_held=False),
    "poster by hand": footage.poster(SMALL, 18.0, is_held=True),
    "lamp": footage.lamp(SMALL, 12.0),
}


@pytest.mark.parametrize("make", EMPTY.values(), ids=EMPTY)
def test_no_circle_in_a_recording_without_a_ball_is_without_doubt(make: Empty) -> None:
    try:
        circle = found_in(make(1))
    except SettingError:
        return
    assert circle.unproven


def test_a_ball_that_neither_moves_nor_turns_is_refused_with_the_way_on() -> None:
    images = EMPTY["poster"](2)
    with pytest.raises(
        ValueError, match=r"it neither moves against what surrounds it nor turns .* with circle as x, y"
    ):
        ts.track(images, log=False)
    # Who knows the ball may give it.
    assert ts.track(images, (48.0, 36.0, 18.0), sphere_map=False, log=False).status[0] == "ok"


def test_one_image_of_a_ball_does_not_show_its_motion() -> None:
    assert (
        found_in(crossing(blotch(), -8, 1, plain=False)).unproven == "one frame does not show whether it moves or turns"
    )


def test_the_frames_that_are_tried_cover_a_long_recording_evenly() -> None:
    tried = _frames_to_try(100_000)
    assert len(set(tried)) == len(tried) == MAX_TRIES
    assert tried[:HEAD] == list(range(HEAD))
    assert max(np.diff(sorted(tried[HEAD:]))) < 1.01 * 100_000 / (MAX_TRIES - HEAD - 1)
    # Half of these leave gaps of about twice that.
    half = sorted([0, *tried[HEAD : (MAX_TRIES + HEAD) // 2], 99_999])
    assert max(np.diff(half)) < 2.1 * 100_000 / (MAX_TRIES - HEAD - 1)
    assert _frames_to_try(30) == list(range(30))
