"""Images of a ball that moves while the shutter is open."""

import math
from dataclasses import replace

import pytest
import torch
from ball_models import RADIUS, dense_rows, poses, smooth_ball, windows

from torchsphere.sphere_map import exposure, exposure_share, forward_model
from torchsphere.sphere_map.pixel_weights import uniform_profile
from torchsphere.sphere_map.state import State

#: Motion per frame: dx, dy, and turns times the radius, px.
MOTION = torch.tensor([5.0, -2.0, 1.0, -2.0, 3.0], dtype=torch.float64)


def test_images_without_exposure_or_with_a_small_smear_are_sharp() -> None:
    motion = MOTION.expand(4, 5)
    assert exposure.moments(motion, 0.0, RADIUS) is None
    assert exposure.moments(motion, 0.1, RADIUS) is None
    assert exposure.moments(motion[:0], 0.5, RADIUS) is None


def test_moments_lie_around_the_middle_of_the_exposure_and_longer_smears_have_more() -> None:
    motion = torch.stack((MOTION, -0.5 * MOTION))
    few, many = (exposure.moments(motion, share, RADIUS) for share in (0.3, 0.9))
    assert few is not None
    assert many is not None
    assert few.shape[1] < many.shape[1]
    torch.testing.assert_close(many.sum(1), torch.zeros(2, 5, dtype=torch.float64))
    # They end within the exposure.
    assert bool((many.abs().amax(1) < 0.45 * motion.abs()).all())
    torch.testing.assert_close(many[1], -0.5 * many[0])


def test_a_smeared_image_is_the_mean_of_the_images_during_the_exposure() -> None:
    at, ball = poses(), smooth_ball()
    plain = windows(at)
    moved = exposure.moments(MOTION.expand(len(plain), 5), 0.6, RADIUS)
    smeared = exposure.linearise(replace(plain, moments=moved), at, ball)
    instants = (torch.arange(60, dtype=torch.float64) + 0.5) / 60 - 0.5
    models = [
        forward_model.linearise(plain, at.moved(0.6 * float(t) * MOTION.expand(len(plain), 5), RADIUS), ball)
        for t in instants
    ]
    mean = torch.stack([model.levels for model in models]).mean(0)
    sharp = forward_model.linearise(plain, at, ball).levels
    # Of a range of 180 grey levels; the sharp image differs by up to 29.
    assert float((smeared.levels - mean).abs().max()) < 5
    assert float((smeared.levels - mean).square().mean().sqrt()) < 0.5
    assert float((sharp - mean).abs().max()) > 20
    slopes = torch.stack([model.jacobian for model in models]).mean(0)
    assert float((smeared.jacobian - slopes).square().mean().sqrt()) < 0.1 * float(slopes.square().mean().sqrt())


def test_the_design_of_a_smeared_image_gives_its_levels() -> None:
    at, ball = poses(), smooth_ball()
    plain = windows(at)
    seen = replace(plain, moments=exposure.moments(MOTION.expand(len(plain), 5), 0.6, RADIUS))
    drawn = exposure.design(seen, at, ball)
    levels = (dense_rows(drawn) @ ball.coefficients).reshape(drawn.fixed.shape) + drawn.fixed
    torch.testing.assert_close(levels.flatten(), exposure.linearise(seen, at, ball).levels.flatten())


def test_sharp_windows_are_drawn_by_the_forward_model_itself() -> None:
    at, ball = poses(), smooth_ball()
    plain = windows(at)
    torch.testing.assert_close(
        exposure.linearise(plain, at, ball).levels, forward_model.linearise(plain, at, ball).levels, rtol=0, atol=0
    )


def test_moments_follow_the_rows_of_windows() -> None:
    plain = windows(poses())
    moved = exposure.moments(torch.arange(1.0, len(plain) + 1).double()[:, None] * MOTION, 0.6, RADIUS)
    seen = replace(plain, moments=moved)
    rows = seen.take(slice(1, 3))
    assert rows.moments is not None
    torch.testing.assert_close(rows.moments, moved[1:3])
    joined = type(seen).joined([seen.take(slice(0, 1)), seen.take(slice(1, len(seen)))])
    torch.testing.assert_close(joined.moments, moved)


def test_the_change_of_an_exposure_is_told_from_its_moments_and_is_none_where_the_ball_rests() -> None:
    at, ball = poses(), smooth_ball()
    plain = windows(at)
    size = torch.tensor(RADIUS, dtype=torch.float64)

    def shown(motion: torch.Tensor) -> State:
        moved = exposure.moments(MOTION.expand(len(plain), 5), 0.6, RADIUS)
        assert moved is not None
        return State(replace(plain, moments=moved * motion), at, ball, uniform_profile(size, 4.0))

    moving, resting = shown(torch.ones(5)), shown(torch.zeros(5))
    unknown = exposure_share.unknown_from(moving.windows)
    assert unknown is not None
    longer = unknown.changed(moving, torch.tensor(0.25))
    assert exposure_share.factor_between(moving.windows.moments, longer.windows.moments) == pytest.approx(
        math.exp(0.25)
    )
    assert float(unknown.value(longer)) == pytest.approx(0.25)
    assert exposure_share.factor_between(resting.windows.moments, resting.windows.moments) == 1.0
    assert exposure_share.unknown_from(resting.windows) is None
