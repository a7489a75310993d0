"""Expected standard deviations against those of the tracker, and numbers of the set-up against the paper's."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from plan_setups import BLURRED, GREY, ROUNDING, SMALL, recorded, sides

import torchsphere as ts
from torchsphere.planning.example_image import rendered_examples, rescaled, white_noise
from torchsphere.planning.expected import Setup, differences, increment_covariance


@pytest.mark.parametrize("setup", [SMALL, BLURRED], ids=["small and noisy", "blurred and turning"])
def test_the_expected_standard_deviations_are_those_of_the_tracker(setup: Setup) -> None:
    rounded = replace(setup, noise=math.hypot(setup.noise, ROUNDING))
    covariance = increment_covariance(sides(setup.radius_px), rounded)
    increments = []
    for seed in (1, 2, 3):
        shot = recorded(setup, seed)
        increments.append(ts.track(shot.images, shot.circle, sphere_map=False).increment)
    assert np.isfinite(increments).all()

    def scatter(values: np.ndarray) -> np.ndarray:
        return np.sqrt(values.var(axis=1, ddof=1).mean(0))

    # The plan is good to 20 %; 117 increments give a standard deviation to 8 %.
    assert scatter(np.array(increments)) == pytest.approx(np.sqrt(np.diagonal(covariance)), rel=0.2)
    plain = differences(covariance, setup.frame_rate, setup.m_per_px, setup.mass_kg)
    velocity = np.array(increments)[..., :2] * setup.m_per_px * setup.frame_rate
    assert scatter(velocity) == pytest.approx(plain.velocity_m_s, rel=0.2)
    force = np.diff(velocity, axis=1) * setup.frame_rate * setup.mass_kg
    assert scatter(force) == pytest.approx(plain.force_N, rel=0.2)


def test_blur_frames_in_view_and_steps_follow_from_the_numbers_of_the_paper() -> None:
    # 72 m/s, 36 000 frames/s, 1/81 000 s at 3.6 px/mm: 3.2 px of blur, 7.2 px per frame.
    paper = Setup(
        speed_m_s=72, frame_rate=36_000, shutter_s=1 / 81_000, px_per_mm=3.6, diameter_mm=30, mass_g=110, noise=2
    )
    assert paper.blur_px == pytest.approx(3.2)
    assert paper.increment[:2] == pytest.approx([7.2, 0])
    # The centre may go from 54 to 458 px: 56 steps and the first image.
    assert paper.frames_in_view(512) == 57
    assert replace(paper, spin_rev_s=(0, 100, 0)).turn_deg == pytest.approx(1.0)


def test_motion_blur_costs_precision_along_the_flight_and_not_across() -> None:
    sd = [
        np.sqrt(np.diagonal(increment_covariance(sides(24.0)[:1], replace(BLURRED, shutter_s=exposure))))
        for exposure in (1e-7, 2.7e-5)
    ]
    along, across, _, _, _ = sd[1] / sd[0]
    assert along > 1.3
    assert across < 0.8 * along


def test_noise_in_the_example_image_does_not_count_as_texture() -> None:
    clean = sides(24.0)[0]
    noise = 15.0
    noisy = replace(
        clean,
        image=clean.image + white_noise(clean.image, noise, seed=5),
        noise=white_noise(clean.image, noise, seed=6),
    )
    forgotten = replace(noisy, noise=torch.zeros_like(noisy.image))
    sd = [np.sqrt(np.diagonal(increment_covariance([e], SMALL))) for e in (clean, noisy, forgotten)]
    # A draw of this noise changes the texture by a few per cent.
    assert sd[1] == pytest.approx(sd[0], rel=0.12)
    assert np.abs(sd[1] / sd[0] - 1).max() < np.abs(sd[2] / sd[0] - 1).max()


def test_a_rescaled_example_is_as_precise_as_an_example_rendered_at_that_scale() -> None:
    direct = rendered_examples(24.0, 4.0, *GREY, seed=3)
    larger = rendered_examples(36.0, 6.0, *GREY, seed=3)
    setup = replace(SMALL, px_per_mm=1.6)
    sd = [np.sqrt(np.diagonal(increment_covariance(e, setup))) for e in (direct, larger)]
    assert rescaled(larger[0], 24.0).circle[2] == 24.0
    assert sd[1] == pytest.approx(sd[0], rel=0.1)


def test_a_ball_without_a_pattern_is_refused() -> None:
    plain = replace(sides(24.0)[0], image=torch.full_like(sides(24.0)[0].image, 120.0))
    with pytest.raises(ValueError, match="stronger pattern"):
        increment_covariance([plain], SMALL)


def test_a_noise_that_no_camera_has_is_refused() -> None:
    with pytest.raises(ValueError, match="no camera is so quiet"):
        increment_covariance(sides(18.0)[:1], replace(SMALL, noise=1e-9))
