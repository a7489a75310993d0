"""Presets: those of the package load and do what they describe; bad ones are refused by name and field."""

import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from render import preset, rotation
from render.shot import Shot
from render.trajectory import FrontalImpact, ObliqueImpact

GOOD = """
frame_rate_hz = 1000
frames = 5
[trajectory]
kind = "free-flight"
velocity_m_s = [1, 2, 0]
"""


def write(folder: Path, text: str, name: str = "mine.toml") -> str:
    path = folder / name
    path.write_text(text)
    return str(path)


def test_the_presets_that_the_readme_lists_are_there() -> None:
    assert {"example", "free-flight", "frontal-impact", "oblique-impact", "spin-in-place", "drop-weight"} <= set(
        preset.names()
    )
    assert {"perspective", "paper-flight", "paper-bar", "paper-plate", "paper-drop-weight"} <= set(preset.names())


@pytest.mark.parametrize("name", preset.names())
def test_every_preset_loads_and_says_what_it_is(name: str) -> None:
    shot = preset.load(name)
    assert shot.name == name
    assert 20 < len(shot.description) < 100
    assert (preset.FOLDER / f"{name}.toml").read_text().startswith("# ")


@pytest.mark.parametrize("name", preset.names())
def test_every_preset_keeps_its_ball_in_sight(name: str) -> None:
    shot = preset.load(name)
    camera = shot.setup.camera
    state = shot.trajectory.state(shot.times_s)
    x, y = camera.project(state.position_m).T
    radius = shot.setup.ball.radius_m * camera.px_per_m(float(state.position_m[:, 2].min()))
    assert x.min() > radius
    assert x.max() < camera.width - radius
    assert y.min() > radius
    assert y.max() < camera.height - radius


def test_the_example_moves_and_turns_as_the_project_states() -> None:
    shot = preset.load("example")
    state = shot.trajectory.state(shot.times_s)
    steps = np.diff(shot.setup.camera.project(state.position_m), axis=0)
    assert np.abs(steps - [1.3, 0.2]).max() < 1e-12
    assert np.abs(np.degrees(rotation.increments(state.orientation)) - [0.2, 0.5, 0.2]).max() < 1e-12
    assert (shot.setup.camera.height, shot.setup.camera.width, shot.frames) == (256, 512, 40)
    assert shot.setup.ball.radius_m * shot.setup.camera.px_per_m(0.0) == pytest.approx(50.0)
    assert 255 * shot.setup.pattern.darkest == pytest.approx(30, abs=0.01)
    assert 255 * shot.setup.pattern.brightest == pytest.approx(220, abs=0.01)


def test_the_perspective_preset_is_at_ten_radii_and_turns_half_a_degree_per_frame() -> None:
    shot = preset.load("perspective")
    state = shot.trajectory.state(shot.times_s)
    assert np.allclose(state.position_m[:, 2] / shot.setup.ball.radius_m, 10.0)
    turned = np.linalg.norm(rotation.increments(state.orientation), axis=1)
    assert np.allclose(np.degrees(turned), 0.5, atol=1e-9)


def test_the_papers_shots_have_the_papers_numbers() -> None:
    bar, plate = preset.load("paper-bar"), preset.load("paper-plate")
    assert isinstance(bar.trajectory, FrontalImpact)
    assert isinstance(plate.trajectory, ObliqueImpact)
    assert (bar.setup.ball.diameter_mm, bar.trajectory.mass_g, bar.trajectory.velocity_m_s[0]) == (30, 110, 70)
    assert (bar.frame_rate_hz, bar.setup.camera.width, bar.setup.camera.height) == (36_000, 512, 128)
    force = bar.trajectory.state(np.linspace(0, 3e-3, 30_001)).force_N[:, 0]
    assert -force.min() == pytest.approx(60e3, rel=0.05)
    peaks = (force[1:-1] < force[:-2]) & (force[1:-1] < force[2:])
    assert peaks.sum() == 4
    assert np.linalg.norm(bar.trajectory.spin_after_rev_s) == pytest.approx(20, abs=1)
    assert (plate.setup.ball.diameter_mm, plate.trajectory.mass_g, plate.trajectory.velocity_m_s[0]) == (19, 28, 80)
    assert (plate.frame_rate_hz, plate.setup.camera.width, plate.setup.camera.height) == (20_000, 512, 512)
    assert plate.setup.shutter.exposure_s == pytest.approx(1 / 81_000)
    assert math.degrees(math.acos(-plate.trajectory.normal[1])) == pytest.approx(15.0)
    assert preset.load("paper-drop-weight").frame_rate_hz == 5000


def test_a_file_of_ones_own_may_state_only_what_differs(tmp_path: Path) -> None:
    shot = preset.load(write(tmp_path, GOOD))
    assert isinstance(shot, Shot)
    assert (shot.name, shot.frames, shot.frame_rate_hz) == ("mine", 5, 1000.0)
    assert shot.times_s.tolist() == [0.0, 0.001, 0.002, 0.003, 0.004]
    assert shot.trajectory.state(np.array([1.0])).velocity_m_s.tolist() == [[1.0, 2.0, 0.0]]


def test_changes_reach_into_tables_and_lists() -> None:
    changes = ["camera.width=300", "sensor.bit_depth = 12", "lighting.lights.1.kind=area", "trajectory.peaks=[1.0]"]
    shot = preset.load("paper-bar", changes)
    assert shot.setup.camera.width == 300
    assert shot.setup.sensor.bit_depth == 12
    assert [light.kind for light in shot.setup.lighting.lights] == ["spot", "area", "spot"]
    assert isinstance(shot.trajectory, FrontalImpact)
    assert shot.trajectory.peaks == (1.0,)


def test_one_seed_takes_the_place_of_all() -> None:
    setup = preset.load("example", seed=77).setup
    assert {part.seed for part in (setup.pattern, setup.background, setup.sensor, setup.quality)} == {77}


def test_the_table_of_a_shot_makes_the_same_shot_again(tmp_path: Path) -> None:
    for name in preset.names():
        shot = preset.load(name)
        path = write(tmp_path, json.dumps({"shot": preset.table(shot)}), f"{name}.json")
        assert preset.load(path) == shot


def test_an_oblique_impact_takes_the_diameter_of_its_ball() -> None:
    shot = preset.load("oblique-impact", ["ball.diameter_mm=20"])
    assert isinstance(shot.trajectory, ObliqueImpact)
    assert shot.trajectory.diameter_mm == 20.0


def test_a_table_of_motion_is_found_beside_its_preset(tmp_path: Path) -> None:
    (tmp_path / "motion.csv").write_text(
        "time_s,x_m,y_m,z_m,rx_rad,ry_rad,rz_rad\n-0.1,0,0,0,0,0,0\n0.1,0.01,0,0,0,0,0.1\n"
    )
    text = 'frame_rate_hz = 100\nframes = 3\n[trajectory]\nkind = "table"\nfile = "motion.csv"\n'
    shot = preset.load(write(tmp_path, text))
    assert np.allclose(shot.trajectory(np.array([0.0])).position_m, [[0.005, 0, 0]])
    with pytest.raises(ValueError, match=r"mine\.toml', trajectory\.file = .*more rows"):
        preset.load(write(tmp_path, text), ["frames=12"])


BAD = [
    ("frames = 5", "frames = 0", "frames = 0: expected a number of at least 1"),
    ("frames = 5", "frames = 5.5", "frames = 5.5: expected a whole number"),
    ("frames = 5", "frames = true", "frames = True: expected a whole number"),
    ("frames = 5", "frame = 5", "frame is not known: did you mean frames"),
    ("frames = 5", "", "frames is missing: expected a whole number"),
    ("frame_rate_hz = 1000", "frame_rate_hz = -1", "frame_rate_hz = -1.0: expected"),
    ("[trajectory]", "[camera]\nfocal = 3\n[trajectory]", "camera.focal is not known: did you mean focal_px?"),
    ("[trajectory]", "[camera]\nfocal_px = -5\n[trajectory]", "camera.focal_px = -5.0: expected"),
    ("[trajectory]", "[camera]\nmodel = 5\n[trajectory]", "camera.model = 5: expected a text in quotes"),
    ("[trajectory]", "[camera]\nmodel = 'fish'\n[trajectory]", "camera.model = 'fish': expected one of"),
    ("[trajectory]", "[lens]\n[trajectory]", "lens is not known"),
    ("[trajectory]", "[shutter]\nexposure_s = 0.1\n[trajectory]", "shutter.exposure_s = 0.1: longer than the 0.001 s"),
    ("[trajectory]", "[[lighting.lights]]\nlevel = 'x'\n[trajectory]", "lighting.lights[0].level = 'x': expected a n"),
    ("[trajectory]", "[[lighting.lights]]\nlevel = -1\n[trajectory]", "lighting.lights[0].level = -1.0: expected"),
    ("[trajectory]", "[lighting]\nlights = 3\n[trajectory]", "lighting.lights = 3: expected a list of tables"),
    ("[1, 2, 0]", "[1, 2]", "trajectory.velocity_m_s = [1, 2]: expected a list of 3 numbers, got 2"),
    ("[1, 2, 0]", "[1, 'a', 0]", "trajectory.velocity_m_s[1] = 'a': expected a number"),
    ("[1, 2, 0]", "[1, nan, 0]", "trajectory.velocity_m_s = (1.0, nan, 0.0): expected"),
    ("velocity_m_s", "speed_m_s", "trajectory.speed_m_s is not known: did you mean "),
    ("velocity_m_s = [1, 2, 0]", "", "trajectory.velocity_m_s is missing: expected a list of 3 numbers"),
    ('"free-flight"', '"flight"', "trajectory.kind = 'flight' is not known: did you mean free-flight"),
    ('kind = "free-flight"', "", "trajectory.kind is missing: expected one of free-flight"),
    (
        "[trajectory]",
        "[camera]\nmodel='pinhole'\n[trajectory]",
        "trajectory: in frame 0 the ball's centre is at z = 0 m",
    ),
]


@pytest.mark.parametrize(("old", "new", "words"), BAD)
def test_a_bad_preset_is_refused_by_its_name_and_field(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in GOOD
    path = write(tmp_path, GOOD.replace(old, new))
    with pytest.raises(ValueError, match=r"^preset ") as error:
        preset.load(path)
    assert str(error.value).startswith(f"preset {path!r}, {words}")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("camera", "expected field.path=value"),
        ("camera.width=wide", "camera.width = 'wide': expected a whole number"),
        ("lighting.lights.3.level=1", "expected a number below 3"),
        ("camera.width.x=1", "camera.width: is a value, not a table"),
        ("trajectory.diameter_mm=3", "trajectory.diameter_mm is not known"),
    ],
)
def test_a_bad_change_is_refused_by_its_field(change: str, words: str) -> None:
    with pytest.raises(ValueError, match=r"^preset 'paper-bar', ") as error:
        preset.load("paper-bar", [change])
    assert words in str(error.value)


def test_a_ball_of_two_diameters_is_refused() -> None:
    with pytest.raises(ValueError, match=r"'paper-plate', trajectory\.diameter_mm = 20\.0: the ball's is 19\.0"):
        preset.load("paper-plate", ["trajectory.diameter_mm=20"])


def test_names_and_files_that_are_not_there_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="preset 'exmaple' is not known: did you mean example"):
        preset.load("exmaple")
    with pytest.raises(ValueError, match="there is no such file"):
        preset.load(str(tmp_path / "none.toml"))
    with pytest.raises(ValueError, match=r"bad\.toml': is no TOML file"):
        preset.load(write(tmp_path, "frames = = 3", "bad.toml"))
    with pytest.raises(ValueError, match=r"bad\.json': is no JSON file"):
        preset.load(write(tmp_path, "{", "bad.json"))
    with pytest.raises(ValueError, match=r"other\.json': holds no shot"):
        preset.load(write(tmp_path, "[]", "other.json"))


def test_preset_files_write_out_no_field_that_is_not_used() -> None:
    for name in preset.names():
        given = tomllib.loads((preset.FOLDER / f"{name}.toml").read_text())
        assert {"description", "frame_rate_hz", "frames", "ball", "pattern", "camera", "trajectory"} <= set(given)
