"""A plan from a free flight: the paper's table 3 for any set-up, and recordings that are no free flight."""

import dataclasses
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch
from plan_setups import BALL, SMALL, planned, recorded
from tracks import made_track

import torchsphere as ts
from torchsphere.cli.main import main
from torchsphere.planning import free_flight
from torchsphere.planning.free_flight import FlightCalibration
from torchsphere.planning.plan import from_flight
from torchsphere.planning.presentation import as_table, remarks, text
from torchsphere.planning.rehearsal import Target
from torchsphere.report import plan_figure

pytestmark = pytest.mark.usefixtures("few_recordings")

KNOWN = FlightCalibration(36_000.0, 30.0, 110.0)


def example_track(increment: np.ndarray) -> ts.Track:
    """A track of that motion, errors of 0.01 px and 1e-4 rad, a ball of 18 px."""
    return made_track(increment, np.array([0.01, 0.01, 1e-4, 1e-4, 1e-4]), ts.Circle(100.0, 90.0, 18.0, 0.0, 0.0, 0.0))


def flown(change: float = 0.0) -> np.ndarray:
    """Steps (40, 5) of 5 px, from the middle on longer by ``change`` px."""
    generator = np.random.default_rng(0)
    increment = [5.0, 0, 0, 0.01, 0] + np.array([0.01, 0.01, 1e-4, 1e-4, 1e-4]) * generator.normal(size=(40, 5))
    increment[20:, 0] += change
    return increment


def test_a_free_flight_gives_the_table_of_the_paper_from_film_and_from_result_alike(tmp_path: Path, capsys) -> None:
    shot = recorded(SMALL, 1, frames=16)
    film, result = tmp_path / "flight.tif", tmp_path / "result"
    tifffile.imwrite(film, shot.images.to(torch.uint8).numpy(), photometric="minisblack")
    given = [*BALL, "--fps", "36000", "--circle", "{},{},{}".format(*shot.circle)]
    assert (
        main(["track", str(film), *given, "--map", "off", "--method", "differences", "--out", str(result), "--quiet"])
        == 0
    )
    out = tmp_path / "plan"
    assert planned("--flight", str(film), *given, "--contact-us", "150", "--out", str(out)) == 0
    assert "table 3" in capsys.readouterr().out
    first = json.loads((out / "plan.json").read_text())["free_flight"]
    second = free_flight.from_result(result, FlightCalibration())
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
def test_a_scale_given_without_a_frame_rate_is_taken_from_the_result(tmp_path: Path, scale: tuple[str, str]) -> None:
    shot = recorded(SMALL, 1, frames=16)
    film, result = tmp_path / "flight.tif", tmp_path / "result"
    tifffile.imwrite(film, shot.images.to(torch.uint8).numpy(), photometric="minisblack")
    given = [*scale, "--mass-g", "110", "--circle", "{},{},{}".format(*shot.circle), "--map", "off", "--no-report"]
    assert main(["track", str(film), *given, "--out", str(result), "--quiet"]) == 0
    with pytest.raises(ValueError, match=r"result: a plan needs .* give fps$"):
        free_flight.from_result(result, FlightCalibration())
    found = free_flight.from_result(result, FlightCalibration(36_000.0))
    assert found.setup.diameter_mm == pytest.approx(30.0, rel=1e-6)
    assert found.setup.speed_m_s == pytest.approx(30.0, rel=0.02)


def test_a_flight_tracked_without_rotation_is_refused_for_its_model(tmp_path: Path) -> None:
    shot = recorded(SMALL, 1, frames=16)
    film, result = tmp_path / "flight.tif", tmp_path / "result"
    tifffile.imwrite(film, shot.images.to(torch.uint8).numpy(), photometric="minisblack")
    given = [*BALL, "--fps", "36000", "--model", "translation", "--no-report"]
    assert main(["track", str(film), *given, "--out", str(result), "--quiet"]) == 0
    with pytest.raises(ValueError, match=r"result: it was tracked with the model 'translation'.* model = rigid"):
        free_flight.from_result(result, FlightCalibration())


def test_a_flight_whose_velocity_changes_gives_a_warning() -> None:
    generator = np.random.default_rng(0)
    steady = np.concatenate((np.full((40, 1), 5.0), np.zeros((40, 4))), 1) + 0.01 * generator.normal(size=(40, 5))
    slowed = steady.copy()
    slowed[20:, 0] -= 1.0
    setup = replace(SMALL, speed_m_s=150.0)
    assert free_flight.Flight(steady, np.ones(5), setup, "steady").warnings == ()
    assert "along x" in free_flight.Flight(slowed, np.ones(5), setup, "slowed").warnings[0]


def test_an_impact_is_refused_as_a_free_flight_with_its_change_of_velocity() -> None:
    with pytest.raises(ValueError, match=r"shot\.tif: this is no free flight: .* along x changes by -210 m/s"):
        free_flight.from_track(example_track(flown(-7.0)), "shot.tif", KNOWN)


@pytest.mark.parametrize("place", [6, 20, 33])
def test_an_impact_anywhere_in_the_recording_is_refused(place: int) -> None:
    increment = flown()
    increment[place:, 1] += 6.0
    with pytest.raises(ValueError, match="this is no free flight"):
        free_flight.from_track(example_track(increment), "shot.tif", KNOWN)


@pytest.mark.parametrize(("start", "cause"), [(0.5, "gravity"), (3.0, "gravity"), (100.0, "drag")])
def test_gravity_and_drag_are_no_impact(start: float, cause: str) -> None:
    # 0.1 s of a fall, and a table-tennis ball that loses half of its speed in 60 ms, at 1000 frames/s.
    time = np.arange(100) * 1e-3 if cause == "gravity" else np.arange(60) * 1e-3
    velocity = start + 9.81 * time if cause == "gravity" else start / (1 + time / 0.06)
    generator = np.random.default_rng(0)
    increment = np.array([0.01, 0.01, 1e-4, 1e-4, 1e-4]) * generator.normal(size=(len(time), 5))
    increment[:, 1] += velocity * 1e-3 * 36 / 30e-3
    found = free_flight.from_track(example_track(increment), cause, KNOWN._replace(frame_rate=1000.0))
    assert "drag or gravity is in the standard deviations" in found.warnings[0]


def test_a_velocity_without_any_scatter_does_not_change() -> None:
    increment = np.tile([5.0, 0.0, 0.0, 0.01, 0.0], (40, 1))
    assert free_flight.from_track(example_track(increment), "made", KNOWN).warnings == ()


def test_a_flight_without_scatter_gives_no_plan() -> None:
    increment = np.tile([5.0, 0.0, 0.0, 0.01, 0.0], (40, 1))
    flight = free_flight.from_track(example_track(increment), "made", KNOWN)
    with pytest.raises(ValueError, match="made: a standard deviation of 0 px from frame to frame"):
        from_flight(flight, Target(2e-4, 0.3, "given"))


def test_a_step_across_a_pause_is_no_scatter() -> None:
    increment = flown()
    steady = free_flight.from_track(example_track(increment), "made", KNOWN)
    increment[7] *= 4
    times = np.arange(41.0) + 3 * (np.arange(41) > 7)
    paused = free_flight.from_track(dataclasses.replace(example_track(increment), times=times), "made", KNOWN)
    assert np.nanstd(paused.velocity_m_s[:, 0]) == pytest.approx(np.std(steady.velocity_m_s[:, 0]), rel=0.1)


def test_a_ball_at_rest_is_no_flight() -> None:
    with pytest.raises(ValueError, match="the ball does not move"):
        free_flight.from_track(example_track(np.zeros((40, 5))), "made", KNOWN)


def test_where_no_two_steps_follow_each_other_the_force_is_not_measured_and_velocities_are() -> None:
    increment = flown()
    increment[1::2] = np.nan
    plan = from_flight(free_flight.from_track(example_track(increment), "made", KNOWN), Target(2e-4, 0.3, "given"))
    lines = text(plan).splitlines()
    assert sum("not measured" in line for line in lines) == 2
    assert not any("nan" in line for line in lines)
    measured = as_table(plan)["free_flight"]
    assert np.isnan(measured["force_N"]["mean"]).all()
    assert np.isfinite(measured["velocity_m_s"]["std"]).all()
    figure = plan_figure.plan_figure(plan)
    assert "no two steps follow each other" in figure.axes[1].texts[0].get_text()


def test_means_and_standard_deviations_leave_out_what_was_not_measured() -> None:
    values = np.array([[1.0, np.nan, np.nan], [3.0, 5.0, np.nan], [np.nan, np.nan, np.nan]])
    mean, sd = free_flight.mean_and_sd(values)
    np.testing.assert_array_equal(mean, [2.0, 5.0, np.nan])
    np.testing.assert_allclose(sd, [math.sqrt(2.0), np.nan, np.nan])


def test_a_ball_without_texture_is_refused_for_its_texture_and_not_for_too_few_frames() -> None:
    increment = flown()
    increment[:, 2:] = np.nan
    with pytest.raises(ValueError, match="too little texture: of 40 increments 0 have a rotation") as refusal:
        free_flight.from_track(example_track(increment), "plain.tif", KNOWN)
    assert "longer recording" not in str(refusal.value)


def test_a_doubtful_flight_gives_a_caution_before_the_numbers() -> None:
    target = Target(2e-4, 0.3, "given")
    slowed = from_flight(free_flight.from_track(example_track(flown(-0.2)), "slowed", KNOWN), target)
    first, *others = text(slowed).splitlines()
    assert first.startswith("caution The velocity along x changes by -5.9")
    assert not any("changes by" in line for line in others)
    assert as_table(slowed)["advice"].startswith("The velocity along x changes by")
    steady = from_flight(free_flight.from_track(example_track(flown()), "steady", KNOWN), target)
    assert text(steady).startswith("test ")


def test_a_mass_in_kg_gives_a_caution_before_the_numbers() -> None:
    made = from_flight(free_flight.from_track(example_track(flown()), "kg", KNOWN), Target(2e-4, 0.3, "given"))
    light = replace(made, setup=replace(made.setup, mass_g=1e-3 * made.setup.mass_g))
    assert text(light).startswith("caution The ball's diameter is ")
    assert "check that the units are mm and g" in remarks(light)[0]
    assert not text(made).startswith("caution")
