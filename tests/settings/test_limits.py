"""Checks of settings, used or unused, and their names in refusals."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from refusals import refused

import torchsphere as ts
from torchsphere.cli.main import main
from torchsphere.correlation.options import Options
from torchsphere.request import Request
from torchsphere.runtime.setting_names import as_options, option_name
from torchsphere.settings.limits import SettingError

CIRCLE = "64.3,92.6,40"


def test_a_second_sentence_of_a_refusal_has_the_names_of_both_worlds() -> None:
    error = SettingError("`fps` = 3: expected more").joined_by("give `axes` = hwn")
    assert str(error) == "fps = 3: expected more; give axes = hwn"
    assert error.as_options() == "--fps 3: expected more; give --axes hwn"
    assert as_options("give `mass_g`") == "give --mass-g"


#: Each refusal of a setting, by the words of the command line and by those of Python.
REFUSALS = {
    "mass": ({"mass_g": -3.0}, "--mass-g -3: expected a finite, positive number"),
    "roi": ({"roi": 1.5}, "--roi 1.5: expected a number from 0.1 to 1"),
    "rate": ({"fps": 1e20}, "--fps 1e+20: expected a number from 1e-06 to 1e+13"),
    "no scale": (
        {"mass_g": 110.0},
        "--mass-g was given without a scale, so no force can follow; add --diameter-mm or --mm-per-px",
    ),
    "within the ball": (
        {"model": "pinhole", "distance_mm": 10.0, "diameter_mm": 30.0},
        "--distance-mm 10: lies within the ball, whose radius is 15 mm; "
        "give the distance of its centre from the camera",
    ),
    # Without a frame rate, or with the smoother, these settings are not used.
    "even window": (
        {"window": 4},
        "--window 4 with --order 3: expected an order of 2 or more and an odd window longer than that",
    ),
    "scale's share": ({"scale_sd_percent": 500.0}, "--scale-sd-percent 500: expected 0 to below 100"),
    "mass's share": ({"mass_sd_percent": -1.0}, "--mass-sd-percent -1: expected 0 to below 100"),
    "rate's share": ({"fps_sd_percent": 100.0}, "--fps-sd-percent 100: expected 0 to below 100"),
    "shell": (
        {"diameter_mm": 30.0, "mass_g": 110.0, "shell_mm": 16.0},
        "--shell-mm 16: thicker than the ball's radius of 15 mm",
    ),
    "shell and inertia": (
        {"mm_per_px": 1.0, "mass_g": 110.0, "shell_mm": 2.0, "inertia_kg_m2": 1e-5},
        "--shell-mm and --inertia-kg-m2 were both given; the inertia needs one of them, leave one out",
    ),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_a_refusal_names_the_option_on_the_command_line_and_the_parameter_in_python(
    case: str, tmp_path: Path, short: Path, capsys
) -> None:
    values, told = REFUSALS[case]
    typed = [word for name, value in values.items() for word in (option_name(name), str(value))]
    assert refused(["track", str(short), "--out", str(tmp_path / "out"), *typed], capsys) == f"torchsphere: {told}"
    in_python = re.sub(r"--([a-z0-9-]+)( (?=[-\d]))?", lambda m: m[1].replace("-", "_") + (" = " if m[2] else ""), told)
    with pytest.raises(ValueError, match=re.escape(in_python)):
        Request(input=short, out=tmp_path / "out", **values)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ("-5:", "--frames -5: counts from the end"),
        ("5:5", "--frames 5:5 holds no frame"),
        ("5:2", "--frames 5:2 holds no frame"),
        ("3:4", "--frames 3:4 holds one frame"),
        ("8:", "--frames 8: starts behind the last frame"),
        ("8:", "give a first number below 8,"),
        ("20:30", "give a first number below 8,"),
        ("0:99", "--frames 0:99 reaches beyond the end"),
        ("7:99", "give 8 at most behind the colon"),
    ],
)
def test_the_refusal_of_frames_states_the_number_of_frames_and_a_valid_range(
    asked: str, said: str, tmp_path: Path, short: Path, capsys
) -> None:
    sentence = refused(["track", str(short), "--out", str(tmp_path / "out"), f"--frames={asked}", "--quiet"], capsys)
    assert said in sentence
    assert "8 frames, 0 to 7, so give " in sentence


def test_the_refusal_of_a_value_like_an_option_says_how_to_give_the_value(tmp_path: Path, short: Path, capsys) -> None:
    sentence = refused(["track", str(short), "--out", str(tmp_path / "out"), "--frames", "-5:"], capsys)
    assert "--frames: expected one argument, joined by '='" in sentence


@pytest.mark.parametrize(
    ("given", "noted"),
    [
        (
            ["--diameter-mm", "30", "--mass-g", "110", "--window", "9"],
            "--diameter-mm, --mass-g, --window, as without a",
        ),
        (["--fps", "1000", "--lab-frame"], "--lab-frame, as without a scale"),
        (["--lab-frame"], "--lab-frame, as without a frame rate (--fps) and a scale"),
        (["--fps", "1000", "--mm-per-px", "1", "--window", "9"], "--window, as the method smoother has neither"),
        (["--fps", "1000", "--mm-per-px", "1", "--normal-deg", "9"], "--normal-deg, as no impact is reported"),
        (["--fps", "1000", "--mm-per-px", "1", "--method", "savitzky-golay", "--window", "5"], ""),
        (["--fps", "1000", "--mm-per-px", "1", "--lab-frame"], ""),
        (["--fps", "1000", "--mm-per-px", "1", "--fps-sd-percent", "1"], ""),
        (
            ["--fps", "1000", "--mm-per-px", "1", "--mass-sd-percent", "1"],
            "--mass-sd-percent, as no mass was given",
        ),
        (
            ["--fps", "1000", "--mm-per-px", "1", "--shutter-us", "100"],
            "--shutter-us, as pairs do not model the exposure",
        ),
    ],
)
def test_an_unused_option_is_noted(given: list[str], noted: str, tmp_path: Path, short: Path, capsys) -> None:
    out = tmp_path / "result"
    fast = ["--circle", CIRCLE, "--frames", "0:6", "--no-report", "--map", "off"]
    assert main(["track", str(short), "--out", str(out), *fast, *given]) == 0
    printed = capsys.readouterr().out
    warnings = json.loads((out / "summary.json").read_text())["warnings"]
    found = [sentence for sentence in warnings if sentence.startswith("Given and not used: ")]
    assert len(found) == (1 if noted else 0)
    assert all(noted in sentence and f"note{16 * ' '}{sentence}\n" in printed for sentence in found)


@pytest.mark.parametrize("roi", [np.float32(0.9), np.float64(0.9), np.int64(1)])
def test_numpy_numbers_are_accepted(roi: float, short: Path, tmp_path: Path) -> None:
    assert Options(roi=roi).roi == roi
    assert Request(input=short, out=tmp_path, roi=roi).roi == roi


def test_without_a_scale_no_result_is_in_the_lab_frame(tmp_path: Path, short: Path) -> None:
    out = tmp_path / "result"
    assert main(["track", str(short), "--out", str(out), "--circle", CIRCLE, "--frames", "0:6", "--lab-frame"]) == 0
    assert json.loads((out / "summary.json").read_text())["axes"].startswith("camera frame")
    assert '"lab":false' in (out / "report.html").read_text().replace(": ", ":")


ARGUMENTS = {
    "an option": ({"roii": 0.9}, "track has no argument 'roii': did you mean roi?"),
    "an argument": ({"circl": (25, 25, 10)}, "track has no argument 'circl': did you mean circle?"),
    "no similar name": ({"qqq": 3}, "track has no argument 'qqq': the settings are model, roi, pre_blur"),
}


@pytest.mark.parametrize("case", ARGUMENTS)
def test_the_refusal_of_an_unknown_argument_of_track_names_a_similar_one(case: str) -> None:
    given, words = ARGUMENTS[case]
    with pytest.raises(TypeError, match=re.escape(words)):
        ts.track(np.zeros((2, 50, 50), np.float32), **given)


def test_the_refusal_of_an_unknown_argument_of_correlate_names_a_similar_one() -> None:
    with pytest.raises(TypeError, match=r"correlate has no argument 'starts': did you mean start\?"):
        ts.correlate(np.zeros((50, 50)), np.zeros((50, 50)), (25, 25, 10), starts=None)
