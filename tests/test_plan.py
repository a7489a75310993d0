"""The plan before the test: expected uncertainty against what the tracker then gives, and against known truths."""

import argparse
import json
import math
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from test_kinematics import made_track

import torchsphere as ts
from torchsphere import cli, forward, plan_cli
from torchsphere.arguments import plan as of_plan
from torchsphere.plan import camera_modes, free_flight
from torchsphere.plan import text as plan_text
from torchsphere.plan.advice import remarks
from torchsphere.plan.example_image import Example, blurred, painted, rescaled, white_noise
from torchsphere.plan.expected import Setup, differences, increment_covariance
from torchsphere.plan.plan import Plan, from_flight
from torchsphere.plan.rehearsal import Target, hertz, rehearse
from torchsphere.plan.table import as_table

MARGIN, FRAMES, SPECKLE, GREY = 12, 40, 3.5, (30.0, 220.0)

# Standard deviation that rounding to whole grey levels adds.
ROUNDING = 12**-0.5

# A ball of radius 18 px in noise, and one of 24 px that is blurred by 3 px and turns by 0.6 deg per frame.
SMALL = Setup(
    speed_m_s=30.0, frame_rate=36_000, shutter_s=1e-6, px_per_mm=1.2, diameter_mm=30, mass_g=110, noise=4.0,
    direction_deg=20.0, spin_rev_s=(10.0, 20.0, -10.0),
)  # fmt: skip
BLURRED = replace(
    SMALL, speed_m_s=75.0, shutter_s=2.5e-5, px_per_mm=1.6, noise=2.0, direction_deg=0.0, spin_rev_s=(30.0, -50.0, 10.0)
)


@dataclass(frozen=True)
class Shot:
    """Images (n, h, w) of a flight and the outline in the first."""

    images: torch.Tensor
    circle: tuple[float, float, float]


def recorded(setup: Setup, seed: int, frames: int = FRAMES) -> Shot:
    """What the camera records of that test, by the package's ray caster."""
    radius, step = setup.radius_px, setup.increment
    start = radius + MARGIN + np.random.default_rng(seed).uniform(0, 1, 2)
    moments = max(math.ceil(1.5 * setup.blur_px), 1)
    exposure = ((np.arange(moments) + 0.5) / moments - 0.5) * setup.shutter_s * setup.frame_rate
    times = np.arange(frames)[:, None] + exposure
    centres = start + times[..., None] * step[:2]
    orientations = Rotation.from_rotvec(times.reshape(-1, 1) * step[2:]).as_matrix()
    width, height = (int(v) for v in np.ceil(centres.max((0, 1)) + radius + MARGIN))
    pattern = forward.speckle(seed, radius_px=radius, speckle_px=SPECKLE, low=GREY[0], high=GREY[1])
    poses = torch.from_numpy(centres.reshape(-1, 2)).float(), torch.from_numpy(orientations).float()
    clean = forward.render(pattern, poses[0], radius, poses[1], 90.0, shape=(height, width), subsamples=4)
    clean = clean.unflatten(0, times.shape).mean(1)
    noise = setup.noise * torch.randn(clean.shape, generator=torch.Generator().manual_seed(seed + 50))
    return Shot((clean + noise).round().clamp(0, 255), (*start.tolist(), radius))


@cache
def sides(radius: float) -> tuple[Example, ...]:
    return painted(radius, SPECKLE, *GREY, seed=77)


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
    there = painted(24.0, 4.0, *GREY, seed=3)
    larger = painted(36.0, 6.0, *GREY, seed=3)
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
    assert hertz(setup, modulus) == pytest.approx(path.t_events[0][0], rel=2e-3)


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

    def verdict(width: int, height: int, rate: float) -> camera_modes.Verdict:
        return camera_modes.judge(camera_modes.Mode(width, height, rate), sides, setup, target)

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


def planned(*arguments: str) -> int:
    parser = argparse.ArgumentParser()
    of_plan.add(parser.add_subparsers())
    options = vars(parser.parse_args(["plan", *arguments]))
    assert options.pop("command") == "plan"
    return plan_cli.run(options)


BALL = ["--diameter-mm", "30", "--mass-g", "110"]
TEST = ["--speed", "30", "--fps", "36000", "--px-per-mm", "1.2", *BALL]
GIVEN = [*TEST, "--shutter-us", "5", "--noise", "2", "--contact-us", "200"]


def test_the_command_writes_figure_and_numbers_and_says_what_to_do(tmp_path: Path, capsys) -> None:
    modes = tmp_path / "modes.csv"
    modes.write_text("width_px,height_px,fps_max\n256,64,40000\n256,24,80000\n")
    image = tmp_path / "ball.tif"
    side = sides(18.0)[0]
    tifffile.imwrite(image, side.image.round().to(torch.uint8).numpy(), photometric="minisblack")
    circle = "{},{},{}".format(*side.circle)
    looks = ["--image", str(image), "--circle", circle, "--modes", str(modes), "--width", "256"]
    assert planned(*GIVEN, *looks, "--out", str(tmp_path / "plan"), "--quiet") == 0
    assert {path.name for path in (tmp_path / "plan").iterdir()} == {"plan.json", "plan.png"}
    table = json.loads((tmp_path / "plan" / "plan.json").read_text())
    assert table["advice"].startswith("Film with 256 x 64 px at 40000 frames/s")
    assert table["blur_px"] == pytest.approx(30 * 5e-6 * 1200)
    assert table["frames_in_view"] == 221
    assert [mode["reason_against"] == "" for mode in table["modes"]] == [True, False]
    assert np.array(table["increment_covariance_px_rad"]).shape == (5, 5)
    assert capsys.readouterr().out == ""


def test_a_free_flight_gives_the_table_of_the_paper_from_film_and_from_result_alike(tmp_path: Path, capsys) -> None:
    shot = recorded(SMALL, 1, frames=16)
    film, result = tmp_path / "flight.tif", tmp_path / "result"
    tifffile.imwrite(film, shot.images.to(torch.uint8).numpy(), photometric="minisblack")
    given = [*BALL, "--fps", "36000", "--circle", "{},{},{}".format(*shot.circle)]
    assert (
        cli.main(
            ["track", str(film), *given, "--map", "off", "--method", "differences", "--out", str(result), "--quiet"]
        )
        == 0
    )
    out = tmp_path / "plan"
    assert planned("--flight", str(film), *given, "--contact-us", "150", "--out", str(out)) == 0
    assert "table 3" in capsys.readouterr().out
    first = json.loads((out / "plan.json").read_text())["free_flight"]
    second = free_flight.from_result(result)
    for name in ("velocity_m_s", "force_N", "spin_rad_s"):
        assert getattr(second, name).std(0, ddof=1) == pytest.approx(first[name]["std"], rel=1e-6)
    assert first["velocity_m_s"]["mean"] == pytest.approx(
        [30 * math.cos(math.radians(20)), 30 * math.sin(math.radians(20))], rel=0.02
    )
    track = ts.track(shot.images, shot.circle, sphere_map=False)
    velocity = track.increment[:, :2] * 15e-3 / track.circle.radius * 36_000
    assert first["velocity_m_s"]["std"] == pytest.approx(velocity.std(0, ddof=1), rel=1e-6)
    assert first["force_N"]["std"] == pytest.approx(np.diff(velocity, axis=0).std(0, ddof=1) * 3960, rel=1e-6)


@pytest.mark.parametrize("scale", [("--diameter-mm", "30"), ("--mm-per-px", str(1 / 1.2))])
def test_a_scale_that_was_given_without_a_frame_rate_is_not_asked_for_again(
    tmp_path: Path, scale: tuple[str, str]
) -> None:
    shot = recorded(SMALL, 1, frames=16)
    film, result = tmp_path / "flight.tif", tmp_path / "result"
    tifffile.imwrite(film, shot.images.to(torch.uint8).numpy(), photometric="minisblack")
    given = [*scale, "--mass-g", "110", "--circle", "{},{},{}".format(*shot.circle), "--map", "off", "--no-report"]
    assert cli.main(["track", str(film), *given, "--out", str(result), "--quiet"]) == 0
    with pytest.raises(ValueError, match=r"result: a plan needs .* give --fps$"):
        free_flight.from_result(result)
    found = free_flight.from_result(result, frame_rate=36_000.0)
    assert found.setup.diameter_mm == pytest.approx(30.0, rel=1e-6)
    assert found.setup.speed_m_s == pytest.approx(30.0, rel=0.02)


def test_a_flight_tracked_without_rotation_is_not_told_to_have_no_texture(tmp_path: Path) -> None:
    shot = recorded(SMALL, 1, frames=16)
    film, result = tmp_path / "flight.tif", tmp_path / "result"
    tifffile.imwrite(film, shot.images.to(torch.uint8).numpy(), photometric="minisblack")
    given = [*BALL, "--fps", "36000", "--model", "translation", "--no-report"]
    assert cli.main(["track", str(film), *given, "--out", str(result), "--quiet"]) == 0
    with pytest.raises(ValueError, match=r"result: it was tracked with the model 'translation'.* --model rigid"):
        free_flight.from_result(result)


def test_a_flight_whose_velocity_changes_is_no_free_flight_and_says_so() -> None:
    generator = np.random.default_rng(0)
    steady = np.concatenate((np.full((40, 1), 5.0), np.zeros((40, 4))), 1) + 0.01 * generator.normal(size=(40, 5))
    slowed = steady.copy()
    slowed[20:, 0] -= 1.0
    setup = replace(SMALL, speed_m_s=150.0)
    assert free_flight.Flight(steady, np.ones(5), setup, "steady").warnings == ()
    assert "along x" in free_flight.Flight(slowed, np.ones(5), setup, "slowed").warnings[0]


def example_track(increment: np.ndarray) -> ts.Track:
    """A track of that motion, errors of 0.01 px and 1e-4 rad, a ball of 18 px."""
    return made_track(increment, np.array([0.01, 0.01, 1e-4, 1e-4, 1e-4]), ts.Circle(100.0, 90.0, 18.0, 0.0, 0.0, 0.0))


KNOWN = {"frame_rate": 36_000.0, "diameter_mm": 30.0, "mass_g": 110.0}


def flown(change: float = 0.0) -> np.ndarray:
    """Steps (40, 5) of 5 px that become longer by ``change`` px half way."""
    generator = np.random.default_rng(0)
    increment = [5.0, 0, 0, 0.01, 0] + np.array([0.01, 0.01, 1e-4, 1e-4, 1e-4]) * generator.normal(size=(40, 5))
    increment[20:, 0] += change
    return increment


def test_an_impact_is_refused_as_a_flight_and_says_so() -> None:
    with pytest.raises(ValueError, match=r"shot\.tif: this is no free flight: .* along x changes by -210 m/s"):
        free_flight.from_track(example_track(flown(-7.0)), "shot.tif", **KNOWN)


@pytest.mark.parametrize("place", [6, 20, 33])
def test_an_impact_is_refused_wherever_it_is_in_the_recording(place: int) -> None:
    increment = flown()
    increment[place:, 1] += 6.0
    with pytest.raises(ValueError, match="this is no free flight"):
        free_flight.from_track(example_track(increment), "shot.tif", **KNOWN)


@pytest.mark.parametrize(("start", "cause"), [(0.5, "gravity"), (3.0, "gravity"), (100.0, "drag")])
def test_gravity_and_drag_are_no_impact(start: float, cause: str) -> None:
    # 0.1 s of a fall, and a table-tennis ball that loses half of its speed in 60 ms, at 1000 frames/s.
    time = np.arange(100) * 1e-3 if cause == "gravity" else np.arange(60) * 1e-3
    velocity = start + 9.81 * time if cause == "gravity" else start / (1 + time / 0.06)
    generator = np.random.default_rng(0)
    increment = np.array([0.01, 0.01, 1e-4, 1e-4, 1e-4]) * generator.normal(size=(len(time), 5))
    increment[:, 1] += velocity * 1e-3 * 36 / 30e-3
    found = free_flight.from_track(example_track(increment), cause, **KNOWN | {"frame_rate": 1000.0})
    assert "drag or gravity is in the standard deviations" in found.warnings[0]


def test_a_velocity_without_any_scatter_does_not_change() -> None:
    increment = np.tile([5.0, 0.0, 0.0, 0.01, 0.0], (40, 1))
    assert free_flight.from_track(example_track(increment), "made", **KNOWN).warnings == ()


def test_a_ball_without_texture_is_refused_for_that_and_not_for_too_few_frames() -> None:
    increment = flown()
    increment[:, 2:] = np.nan
    with pytest.raises(ValueError, match="too little texture: of 40 increments 0 have a rotation") as refusal:
        free_flight.from_track(example_track(increment), "plain.tif", **KNOWN)
    assert "longer recording" not in str(refusal.value)


def test_what_makes_a_flight_s_numbers_doubtful_is_said_before_them() -> None:
    target = Target(2e-4, 0.3, "given")
    slowed = from_flight(free_flight.from_track(example_track(flown(-0.2)), "slowed", **KNOWN), target)
    first, *others = plan_text.text(slowed).splitlines()
    assert first.startswith("caution The velocity along x changes by -5.9")
    assert not any("changes by" in line for line in others)
    assert as_table(slowed)["advice"].startswith("The velocity along x changes by")
    steady = from_flight(free_flight.from_track(example_track(flown()), "steady", **KNOWN), target)
    assert plan_text.text(steady).startswith("test ")


def test_a_mass_in_kg_is_doubted_before_the_numbers() -> None:
    made = from_flight(free_flight.from_track(example_track(flown()), "kg", **KNOWN), Target(2e-4, 0.3, "given"))
    light = replace(made, setup=replace(made.setup, mass_g=1e-3 * made.setup.mass_g))
    assert plan_text.text(light).startswith("caution The ball's diameter is ")
    assert "see that the units are mm and g" in remarks(light)[0]
    assert not plan_text.text(made).startswith("caution")


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--noise", "nan"], "noise = nan"),
        (["--speed", "-3"], "speed = -3"),
        (["--direction-deg", "nan"], "direction_deg = nan"),
        (["--shutter-us", "100"], "longer than the 27.78 us"),
        (["--image", "there-is-none.tif"], "each image needs its circle"),
        (["--image", "there-is-none.tif", "--circle", "3,3,3"], "does not exist"),
        (["--flight", "shot.tif"], "leave one of both out"),
        (["--field-mm", "100"], "add --modes"),
        (["--restitution", "2"], "restitution = 2"),
        (["--contact-us", "-1"], "contact_us = -1"),
        (["--speckle-px", "30"], "smaller than the radius"),
        (["--grey", "200,100"], "dark one first"),
        (["--blurred"], "add --image"),
    ],
)
def test_what_cannot_be_planned_is_refused_in_words_and_writes_nothing(
    tmp_path: Path, more: list[str], said: str
) -> None:
    with pytest.raises((ValueError, OSError), match=said):
        planned(*GIVEN, *more, "--out", str(tmp_path / "plan"))
    assert list(tmp_path.iterdir()) == []


def test_a_plan_without_its_numbers_names_those_that_are_missing(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="needs --shutter-us, --noise;"):
        planned(*TEST, "--out", str(tmp_path))
