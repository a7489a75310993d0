"""`torchsphere instruments`: a light gate and an accelerometer beside the demo's impact."""

import json
from pathlib import Path

import numpy as np
import pytest
from result_folders import measured_impact
from scipy.interpolate import CubicSpline

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


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (["--gate", "GATE", *TIMES], "--gate needs --spacing-mm"),
        (["--gate", "GATE", "--spacing-mm", "40"], "a column 'time_s'"),
        (
            ["--gate", "GATE", *TIMES, "--spacing-mm", "40", "--columns", "near"],
            "expected two columns",
        ),
        (["--gate", "GATE", *TIMES, "--spacing-mm", "40", "--plot", "a.png"], "leave it out"),
        (["--accelerometer", "GATE", *TIMES, "--columns", "a"], "the file has 'near', 'far'"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_one_sentence(
    result: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], given: list[str], sentence: str
) -> None:
    file = gate(tmp_path / "gate.csv", 70.0)
    assert main(["instruments", str(result), *(str(file) if word == "GATE" else word for word in given)]) == 1
    error = capsys.readouterr().err
    assert sentence in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("option", ["--spacing-mm=-1", "--sd-spacing-mm=nan", "--direction-deg=left"])
def test_numbers_out_of_range_are_refused_by_the_command_line(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as refused:
        main(["instruments", "result", "--gate", "a.csv", option])
    assert refused.value.code == 2
    assert "expected" in capsys.readouterr().err
