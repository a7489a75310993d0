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
    command = ["instruments", str(result), "--gate", str(file)]
    assert main([*command, "--spacing-mm", "40", "--sd-spacing-mm", "0.4", "--json"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["columns"] == ["near", "far"]
    assert numbers["read"]["times"] == "every 1e-06 s, of 't_ms' in ms, as the file states"
    assert numbers["velocity_m_s"] == pytest.approx(true, rel=1e-3)
    assert numbers["sd_velocity_m_s"] == pytest.approx(0.01 * true, rel=0.05)
    assert abs(numbers["difference_m_s"]) < 2 * numbers["sd_difference_m_s"]
    assert main([*command, "--columns", "near, far", "--spacing-mm", "40"]) == 0
    text = capsys.readouterr().out
    assert "light gate" in text
    assert "track before contact" in text
    assert "WARNING" not in text
    # A tenth of the distance.
    assert main([*command, "--spacing-mm", "4"]) == 0
    assert "WARNING" in (text := capsys.readouterr().out)
    assert "check --spacing-mm" in text
    # Passed the other way round.
    assert main([*command, "--columns", "far,near", "--spacing-mm", "40"]) == 1
    assert "swap the signals" in capsys.readouterr().err


def accelerometer(path: Path, result: Path, header: str, unit_m_s2: float = 1.0, end: float = np.inf) -> Path:
    """Signal of a sensor that measures against x: a push to the left is positive. It ends at a share of its peak."""
    motion = reader.read(result).motion
    assert motion is not None
    time_s = np.arange(-1e-4, motion.time_s[-1] + 1e-4, 2e-6)
    pushed = CubicSpline(motion.time_s, -1.02 * motion.acceleration_m_s2[:, 0])(
        np.clip(time_s, motion.time_s[0], motion.time_s[-1])
    )
    return write(path, header, time_s + CLOCK_S, np.minimum(pushed, end * pushed.max()) / unit_m_s2)


def test_an_accelerometer_is_put_over_the_track_and_drawn(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = accelerometer(tmp_path / "sensor.csv", result, "time_s,a_m_s2")
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


#: Size of g, m/s^2.
G = 9.80665


@pytest.mark.parametrize(
    ("header", "size", "options", "gain", "said", "warned"),
    [
        ("time_s,acc [g]", G, [], 1.02, "g, as the file states", ""),
        ("time_s,acc_g", G, [], 1.02, "g, as the file states", ""),
        ("time_s,acc (mm/s²)", 1e-3, [], 1.02, "mm/s^2, as the file states", ""),
        ("time_s,acc", G, ["--unit", "g"], 1.02, "g, as given", ""),
        # A sensor of 10 mV/g on an oscilloscope.
        ("time_s,acc [V]", 100 * G, ["--unit", "980.665"], 1.02, "980.665 m/s^2, as given", ""),
        ("time_s,acc", G, [], 1.02 / G, "m/s^2, as nothing states another", "in g, and taken as in m/s^2"),
        ("time_s,acc", 1.0, ["--unit", "g"], 1.02 * G, "g, as given", "in m/s^2, and taken as in g"),
        ("time_s,acc", 1e-3, [], 1020, "m/s^2, as nothing states another", "a thousand times as small"),
        ("time_s,acc", 5.0, [], 0.204, "m/s^2, as nothing states another", "check its unit"),
        ("time_s,acc [g]", 1.0, ["--unit", "m/s^2"], 1.02, "m/s^2, as given", "by the file, and was taken as in m/s^2"),
        ("time_s,acc [V]", 1.0, [], 1.02, "m/s^2, as nothing states another", "'V', no unit of acceleration"),
    ],
)
def test_the_unit_of_an_accelerometer_is_given_or_read_and_a_wrong_one_is_a_warning(
    result: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    header: str,
    size: float,
    options: list[str],
    gain: float,
    said: str,
    warned: str,
) -> None:
    file = accelerometer(tmp_path / "sensor.csv", result, header, size)
    command = ["instruments", str(result), "--accelerometer", str(file), "--direction-deg=180", *options]
    assert main([*command, "--json"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["gain"] == pytest.approx(gain, rel=0.02)
    assert numbers["read"]["unit"] == said
    assert len(numbers["warnings"]) == bool(warned)
    assert warned in " ".join(numbers["warnings"])
    assert main(command) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("WARNING") for line in lines) == bool(warned)
    assert any(line.startswith("unit") and line.endswith(said) for line in lines)
    assert "`" not in "".join(lines)


def test_a_clipped_accelerometer_is_a_warning(result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = accelerometer(tmp_path / "sensor.csv", result, "time_s,a_m_s2", end=0.7)
    assert main(["instruments", str(result), "--accelerometer", str(file), "--direction-deg=180", "--json"]) == 0
    (sentence,) = json.loads(capsys.readouterr().out)["warnings"]
    assert "probably clipped" in sentence


#: A round aluminium bar of 60 mm; the gauge 0.4 m from its end.
BAR = (
    *("--bar-diameter-mm", "60", "--bar-modulus-gpa", "70", "--bar-density-kg-m3", "2700"),
    *("--gauge-distance-mm", "400"),
)


def strain_gauge(path: Path, result: Path, share: float, names: str = "upper,lower") -> Path:
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
    return write(path, f"time_s,{names}", time_s + CLOCK_S + travel, strain + bending, strain - bending)


def test_a_bar_with_strain_gauges_is_put_over_the_force_of_the_track_and_drawn(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, picture = strain_gauge(tmp_path / "bar.csv", result, 1.03), tmp_path / "bar.png"
    command = ["instruments", str(result), "--strain-gauge", str(file), "--unit", "microstrain", *BAR]
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
    file = strain_gauge(tmp_path / "bar.csv", result, 1.0, "upper [µm/m],lower [µm/m]")
    command = ["instruments", str(result), "--strain-gauge", str(file), *BAR]
    command += ["--columns", "upper [µm/m],lower [µm/m]", "--json"]
    assert main(command) == 0
    by_normal = json.loads(capsys.readouterr().out)
    assert by_normal["read"]["unit"] == "microstrain, as the file states"
    assert by_normal["warnings"] == []
    assert main([*command, "--direction-deg=180"]) == 0
    given = json.loads(capsys.readouterr().out)
    assert by_normal["peak_track_N"] == pytest.approx(given["peak_track_N"], rel=0.01)
    assert main([*command, "--compression-positive"]) == 1
    assert "--compression-positive" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "sentence", "code"),
    [
        (["--gate", "GATE", *TIMES], "--gate needs --spacing-mm", BAD_COMMAND),
        ([], "give one of --gate, --accelerometer and --strain-gauge", BAD_COMMAND),
        (["--gate", "GATE", "--accelerometer", "GATE"], "give one of --gate", BAD_COMMAND),
        (["--gate", "GATE", "--spacing-mm", "-1"], "--spacing-mm -1: expected", BAD_COMMAND),
        (
            ["--gate", "GATE", "--spacing-mm", "40", "--sd-spacing-mm", "-1"],
            "--sd-spacing-mm -1: expected",
            BAD_COMMAND,
        ),
        (["--gate", "GATE", "--spacing-mm", "40", "--unit", "g"], "--unit is for an accelerometer", BAD_COMMAND),
        (["--accelerometer", "GATE", "--unit", "percent"], "--unit 'percent': expected a unit of accel", BAD_COMMAND),
        (
            ["--gate", "GATE", "--spacing-mm", "40", "--time-column", "time_s"],
            "no column 'time_s' of numbers for --time-column; it has 't_ms', 'near', 'far'",
            BAD_INPUT,
        ),
        (["--gate", "GATE", "--spacing-mm", "40", *TIMES, "--columns", "near"], "expected two columns", BAD_INPUT),
        (["--gate", "GATE", *TIMES, "--spacing-mm", "40", "--plot", "a.png"], "leave it out", BAD_COMMAND),
        (["--accelerometer", "GATE", *TIMES, "--columns", "a"], "the file has 'near', 'far'", BAD_INPUT),
        (["--accelerometer", "GATE", *TIMES, "--bar-modulus-gpa", "70"], "--bar-modulus-gpa: of a bar", BAD_COMMAND),
        (["--strain-gauge", "GATE", *TIMES], "--strain-gauge needs its diameter or its cross-section", BAD_COMMAND),
        (["--strain-gauge", "GATE", *TIMES, *BAR[:4]], "give --bar-density-kg-m3 or --bar-wave-speed-m-s", BAD_COMMAND),
        (["--strain-gauge", "GATE", *TIMES, *BAR[:6]], "give --gauge-distance-mm", BAD_COMMAND),
        (
            ["--strain-gauge", "GATE", *TIMES, *BAR, "--bar-area-mm2", "9"],
            "--bar-area-mm2 were both given",
            BAD_COMMAND,
        ),
        (["--strain-gauge", "GATE", *TIMES, *BAR], "check the --unit of the strains", BAD_INPUT),
        (["--strain-gauge", "GATE", *TIMES, *BAR, "--sd-bar-percent", "100"], "--sd-bar-percent 100:", BAD_COMMAND),
        (["--strain-gauge", "GATE", *TIMES, *BAR, "--columns", "a"], "the file has 'near', 'far'", BAD_INPUT),
        (
            ["--strain-gauge", "GATE", *TIMES, *BAR, "--bar-length-mm", "300"],
            "--bar-length-mm 300: expected more than --gauge-distance-mm 400",
            BAD_COMMAND,
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


@pytest.mark.parametrize("option", ["--sd-spacing-mm=nan", "--direction-deg=left", "--time-unit=min"])
def test_values_of_another_kind_are_refused_by_the_command_line(
    option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as refused:
        main(["instruments", "result", "--gate", "a.csv", option])
    assert refused.value.code == 2
    assert "expected" in capsys.readouterr().err
