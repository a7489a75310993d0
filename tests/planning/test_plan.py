"""The plan before the test: expected uncertainty against what the tracker then gives, and against known truths."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from plan_setups import BLURRED, GREY, ROUNDING, SMALL, recorded, sides
from scipy.integrate import solve_ivp

import torchsphere as ts
from torchsphere.planning import camera_modes
from torchsphere.planning.advice import remarks
from torchsphere.planning.example_image import Example, blurred, rendered_examples, rescaled, white_noise
from torchsphere.planning.expected import Setup, differences, increment_covariance
from torchsphere.planning.plan import Plan
from torchsphere.planning.rehearsal import Target, hertz_contact_s, rehearse


@pytest.mark.parametrize("setup", [SMALL, BLURRED], ids=["small and noisy", "blurred and turning"])
def test_the_expected_standard_deviations_are_those_that_the_tracker_then_shows(setup: Setup) -> None:
    told = replace(setup, noise=math.hypot(setup.noise, ROUNDING))
    covariance = increment_covariance(sides(setup.radius_px), told)
    increments = []
    for seed in (1, 2, 3):
        shot = recorded(setup, seed)
        increments.append(ts.track(shot.images, shot.circle, sphere_map=False).increment)
    assert np.isfinite(increments).all()

    def scatter(values: np.ndarray) -> np.ndarray:
        return np.sqrt(values.var(axis=1, ddof=1).mean(0))

    # 20 % is what the planner promises; 117 increments tell a standard deviation to 8 %.
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


def test_blurring_by_two_px_averages_the_moments_of_the_exposure() -> None:
    ramp = torch.arange(40.0).square()[None].expand(40, -1).contiguous()
    example = Example(ramp, torch.zeros_like(ramp), (20.0, 20.0, 10.0), "a parabola")
    # The mean of x^2 over four moments at -0.75, -0.25, 0.25, 0.75 px is x^2 + 0.3125.
    seen = blurred(example, (2.0, 0.0)).image
    assert (seen - ramp)[10:-10, 10:-10].numpy() == pytest.approx(0.3125, abs=2e-3)


def test_noise_in_the_example_image_does_not_pass_for_texture() -> None:
    clean = sides(24.0)[0]
    noise = 15.0
    noisy = replace(
        clean,
        image=clean.image + white_noise(clean.image, noise, seed=5),
        noise=white_noise(clean.image, noise, seed=6),
    )
    forgotten = replace(noisy, noise=torch.zeros_like(noisy.image))
    sd = [np.sqrt(np.diagonal(increment_covariance([e], SMALL))) for e in (clean, noisy, forgotten)]
    # One draw of such noise changes the texture itself by a few per cent.
    assert sd[1] == pytest.approx(sd[0], rel=0.12)
    assert np.abs(sd[1] / sd[0] - 1).max() < np.abs(sd[2] / sd[0] - 1).max()


def test_an_example_brought_to_another_scale_is_worth_what_one_made_at_that_scale_is() -> None:
    there = rendered_examples(24.0, 4.0, *GREY, seed=3)
    larger = rendered_examples(36.0, 6.0, *GREY, seed=3)
    setup = replace(SMALL, px_per_mm=1.6)
    sd = [np.sqrt(np.diagonal(increment_covariance(e, setup))) for e in (there, larger)]
    assert rescaled(larger[0], 24.0).circle[2] == 24.0
    assert sd[1] == pytest.approx(sd[0], rel=0.1)


def test_a_ball_without_a_pattern_is_refused() -> None:
    plain = replace(sides(24.0)[0], image=torch.full_like(sides(24.0)[0].image, 120.0))
    with pytest.raises(ValueError, match="stronger pattern"):
        increment_covariance([plain], SMALL)


def test_the_duration_of_an_elastic_impact_is_that_of_the_integrated_contact() -> None:
    radius, modulus, speed, mass = 0.015, 60e9, 72.0, 0.110
    stiffness = 4 / 3 * modulus * math.sqrt(radius)

    def released(_: float, state: np.ndarray) -> float:
        return state[0] + 1e-12

    released.terminal, released.direction = True, -1  # type: ignore[attr-defined]
    path = solve_ivp(
        lambda _, s: (s[1], -stiffness / mass * max(s[0], 0.0) ** 1.5),
        (0, 1e-3), (0.0, speed), events=released, rtol=1e-8, atol=1e-12, max_step=1e-6,
    )  # fmt: skip
    setup = replace(SMALL, speed_m_s=speed)
    # 2.87 is the rounded 2.868 of the book.
    assert hertz_contact_s(setup, modulus) == pytest.approx(path.t_events[0][0], rel=2e-3)


def test_the_rehearsed_force_is_right_within_what_it_states() -> None:
    covariance = np.diag([0.005**2, 0.005**2, 1e-4**2, 1e-4**2, 4e-5**2])
    setup = replace(SMALL, speed_m_s=72.0, px_per_mm=3.6, direction_deg=90.0)
    found = rehearse(covariance, setup, Target(4e-4, 0.3, "given"))
    assert found.found
    # Half a sine that turns 72 m/s into -0.3 times that.
    assert found.peak_N == pytest.approx(math.pi / 2 * 0.110 * 1.3 * 72 / 4e-4)
    assert np.trapezoid(found.true_force_N, found.time_s) == pytest.approx(-0.110 * 1.3 * 72, rel=0.02)
    assert found.force_error_N[1] < 2 * found.force_N[1, 0]
    assert found.force_N[1, 0] < 0.02 * found.peak_N
    # In flight the smoother knows the velocity better than one increment does.
    plain = differences(covariance, setup.frame_rate, setup.m_per_px, setup.mass_kg)
    assert (found.velocity_m_s[0] < plain.velocity_m_s).all()


def test_a_mode_that_cannot_show_the_ball_or_the_contact_is_left_out_with_its_reason() -> None:
    setup, target = replace(SMALL, noise=2.0), Target(3e-4, 0.3, "given")

    def verdict(width: int, height: int, rate: float) -> camera_modes.Assessment:
        return camera_modes.assess(camera_modes.Mode(width, height, rate), sides, setup, target)

    low, tiny, slow, good = (verdict(*m) for m in ((256, 24, 4e4), (37, 64, 4e4), (256, 64, 9e3), (256, 64, 4e4)))
    assert "does not fit" in low.reason
    assert "in view" in tiny.reason
    assert "2.7 images during the contact" in slow.reason
    assert good.reason == ""
    assert camera_modes.best([low, tiny, slow, good]) is good
    assert camera_modes.best([low, slow]) is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("width,height\n1,2\n", "no column width_px"),
        ("width_px,height_px,fps_max\n", "lists no mode"),
        ("width_px,height_px,fps_max\n512,x,3\n", "line 2"),
        ("width_px,height_px,fps_max\n512,128,0\n", "line 2"),
    ],
)
def test_a_table_of_modes_that_cannot_be_used_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "modes.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=said):
        camera_modes.read_modes(path)


def test_too_much_blur_is_the_first_thing_that_is_said() -> None:
    setup = replace(SMALL, speed_m_s=180.0, shutter_s=2.77e-5)
    plain = differences(np.eye(5), setup.frame_rate, setup.m_per_px, setup.mass_kg)
    made = Plan(setup, "-", Target(2e-4, 0.3, "given"), np.eye(5), plain, None, None, np.zeros((0, 2)), None)
    assert setup.blur_px == pytest.approx(5.98, abs=0.01)
    # 5 px at 180 m/s and 1.2 px/mm.
    assert "exposure to 23.1 us" in remarks(made)[0]
    assert "exposure" not in remarks(replace(made, setup=replace(setup, shutter_s=2.3e-5)))[0]
