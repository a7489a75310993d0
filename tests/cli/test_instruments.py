"""`torchsphere instruments`: a light gate, an accelerometer and a bar's strain gauge beside the demo's impact."""

import json
from pathlib import Path

import numpy as np
import pytest
from result_folders import measured_impact
from scipy.interpolate import CubicSpline

from torchsphere.cli.exit_codes import BAD_COMMAND, BAD_INPUT
from torchsphere.cli.main import main
from torchsphere.results import reader

SPACING_M = 0.04

#: Time of the sensor's clock at time 0 of the track, s.
CLOCK_S = 0.0123

#: Column of the gate's times.
TIMES = ("--time-column", "t_ms")


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, _ = measured_impact(tmp_path_factory.mktemp("impact"))
    return folder


def write(path: Path, header: str, *columns: np.ndarray) -> Path:
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="")
    return path


def gate(path: Path, speed_m_s: float) -> Path:
    """Signals of two barriers that a ball of that speed darkens for 270 us each; times in ms."""
    time_s, noise = 1e-6 * np.arange(2500), np.random.default_rng(0)

    def barrier(at_s: float) -> np.ndarray:
        passage = 1 / (1 + np.exp(-(time_s - at_s) / 15e-6)) - 1 / (1 + np.exp(-(time_s - at_s - 270e-6) / 15e-6))
        return passage + 0.01 * noise.normal(size=len(time_s))

    return write(path, "t_ms,near,far", 1e3 * time_s, barrier(4e-4), barrier(4e-4 + SPACING_M / speed_m_s))


def test_a_gate_stands_beside_the_speed_of_the_track_before_the_contact(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    summary = json.loads((result / "summary.json").read_text())
    true = summary["impact"]["speed_before"]["value"]
    file = gate(tmp_path / "gate.csv", true)
    command = ["instruments", str(result), "--gate", str(file), "--time-column", "t_ms", "--time-unit", "ms"]
    assert main([*command, "--spacing-mm", "40", "--sd-spacing-mm", "0.4", "--json"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["velocity_m_s"] == pytest.approx(true, rel=1e-3)
    assert numbers["sd_velocity_m_s"] == pytest.approx(0.01 * true, rel=0.05)
    assert abs(numbers["difference_m_s"]) < 2 * numbers["sd_difference_m_s"]
    assert main([*command, "--columns", "near, far", "--spacing-mm", "40"]) == 0
    text = capsys.readouterr().out
    assert "light gate" in text
    assert "track before contact" in text
    # Passed the other way round.
    assert main([*command, "--columns", "far,near", "--spacing-mm", "40"]) == 1
    assert "swap the signals" in capsys.readouterr().err


def test_an_accelerometer_is_put_over_the_track_and_drawn(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motion = reader.read(result).motion
    assert motion is not None
    time_s = np.arange(-1e-4, motion.time_s[-1] + 1e-4, 2e-6)
    # Measured against x: a push to the left is positive.
    pushed = CubicSpline(motion.time_s, -1.02 * motion.acceleration_m_s2[:, 0])(
        np.clip(time_s, motion.time_s[0], motion.time_s[-1])
    )
    file = write(tmp_path / "sensor.csv", "time_s,a_m_s2", time_s + CLOCK_S, pushed)
    command = ["instruments", str(result), "--accelerometer", str(file), "--direction-deg=180"]
    picture = tmp_path / "sensor.png"
    assert main([*command, "--json", "--plot", str(picture)]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["delay_s"] == pytest.approx(CLOCK_S, abs=2e-6)
    assert numbers["gain"] == pytest.approx(1.02, abs=0.02)
    assert numbers["peak_track_m_s2"] > 0
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert main(command) == 0
    assert any(line.startswith("sensor over track") for line in capsys.readouterr().out.splitlines())


#: A round aluminium bar of 60 mm; the gauge 0.4 m from its end.
BAR = (
    *("--bar-diameter-mm", "60", "--bar-modulus-gpa", "70", "--bar-density-kg-m3", "2700"),
    *("--gauge-distance-mm", "400"),
)


def strain_gauge(path: Path, result: Path, share: float) -> Path:
    """Microstrains of two gauges on that bar, by a share of the track's force, with opposite bending."""
    motion = reader.read(result).motion
    assert motion is not None
    assert motion.force_N is not None
    time_s = np.arange(-2e-4, motion.time_s[-1] + 1e-4, 2e-6)
    # The ball of the demo flies to the right: the force on the ball is to the left.
    force = CubicSpline(motion.time_s, -share * motion.force_N[:, 0])(
        np.clip(time_s, motion.time_s[0], motion.time_s[-1])
    )
    strain = -1e6 * force / (70e9 * np.pi / 4 * 0.06**2) + 5.0
    bending = 20 * np.sin(3e4 * time_s)
    travel = 0.4 / np.sqrt(70e9 / 2700)
    return write(path, "time_s,upper,lower", time_s + CLOCK_S + travel, strain + bending, strain - bending)


def test_a_bar_with_strain_gauges_is_put_over_the_force_of_the_track_and_drawn(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, picture = strain_gauge(tmp_path / "bar.csv", result, 1.03), tmp_path / "bar.png"
    command = ["instruments", str(result), "--strain-gauge", str(file), "--strain-unit", "microstrain", *BAR]
    command += ["--columns", "upper, lower", "--direction-deg=180"]
    assert main([*command, "--sd-bar-percent", "3", "--json", "--plot", str(picture)]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["delay_s"] == pytest.approx(CLOCK_S, abs=2e-6)
    assert numbers["travel_s"] == pytest.approx(0.4 / 5091.75, rel=1e-5)
    assert numbers["gain"] == pytest.approx(1.03, abs=0.01)
    assert numbers["sd_gain"] == pytest.approx(0.03, rel=0.2)
    assert numbers["peak_bar_N"] == pytest.approx(1.03 * numbers["peak_track_N"], rel=0.01)
    assert numbers["impulse_bar_N_s"] == pytest.approx(1.03 * numbers["impulse_track_N_s"], rel=0.02)
    assert numbers["valid_until_s"] is None
    assert len(numbers["bar_N"]) == len(numbers["time_s"]) == len(numbers["sd_track_N"])
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert main([*command, "--bar-length-mm", "1500"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("impulse") and "bar" in line for line in lines)
    assert any(line.startswith("reflection arrives") for line in lines)


def test_the_normal_of_the_impact_is_the_direction_from_the_bar_to_the_ball(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = strain_gauge(tmp_path / "bar.csv", result, 1.0)
    command = ["instruments", str(result), "--strain-gauge", str(file), "--strain-unit", "microstrain", *BAR]
    command += ["--columns", "upper,lower", "--json"]
    assert main(command) == 0
    by_normal = json.loads(capsys.readouterr().out)
    assert main([*command, "--direction-deg=180"]) == 0
    given = json.loads(capsys.readouterr().out)
    assert by_normal["peak_track_N"] == pytest.approx(given["peak_track_N"], rel=0.01)
    assert main([*command, "--compression-positive"]) == 1
    assert "--compression-positive" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "sentence", "code"),
    [
        (["--gate", "GATE", *TIMES], "--gate needs --spacing-mm", BAD_COMMAND),
        (["--gate", "GATE", "--spacing-mm", "40"], "a column 'time_s'", BAD_INPUT),
        (["--gate", "GATE", *TIMES, "--spacing-mm", "40", "--columns", "near"], "expected two columns", BAD_INPUT),
        (["--gate", "GATE", *TIMES, "--spacing-mm", "40", "--plot", "a.png"], "leave it out", BAD_COMMAND),
        (["--accelerometer", "GATE", *TIMES, "--columns", "a"], "the file has 'near', 'far'", BAD_INPUT),
        (["--accelerometer", "GATE", *TIMES, "--bar-modulus-gpa", "70"], "--bar-modulus-gpa: of a bar", BAD_COMMAND),
        (["--strain-gauge", "GATE", *TIMES], "--strain-gauge needs its diameter or its cross-section", BAD_COMMAND),
        (["--strain-gauge", "GATE", *TIMES, *BAR[:4]], "give --bar-density-kg-m3 or --bar-wave-speed-m-s", BAD_COMMAND),
        (["--strain-gauge", "GATE", *TIMES, *BAR[:6]], "give --gauge-distance-mm", BAD_COMMAND),
        (["--strain-gauge", "GATE", *TIMES, "--time-unit", "ms", *BAR], "a strain of", BAD_INPUT),
        (["--strain-gauge", "GATE", *TIMES, *BAR, "--columns", "a"], "the file has 'near', 'far'", BAD_INPUT),
        (
            ["--strain-gauge", "GATE", *TIMES, *BAR, "--bar-length-mm", "300"],
            "more than the gauge's distance",
            BAD_INPUT,
        ),
    ],
)
def test_what_cannot_be_compared_is_refused_in_one_sentence(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], given: list[str], sentence: str, code: int
) -> None:
    file = gate(tmp_path / "gate.csv", 70.0)
    assert main(["instruments", str(result), *(str(file) if word == "GATE" else word for word in given)]) == code
    error = capsys.readouterr().err
    assert sentence in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("option", ["--spacing-mm=-1", "--sd-spacing-mm=nan", "--direction-deg=left"])
def test_numbers_out_of_range_are_refused_by_the_command_line(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as refused:
        main(["instruments", "result", "--gate", "a.csv", option])
    assert refused.value.code == 2
    assert "expected" in capsys.readouterr().err
