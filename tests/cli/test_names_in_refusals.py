"""Refusals of the command line name options, not the arguments of Python; files of settings keep their keys."""

import re
from pathlib import Path

import pytest
from refusals import refused

CIRCLE = ["--circle", "64.3,92.6,40"]
PLAN = ["--speed", "72", "--fps", "36000", "--shutter-us", "12", "--px-per-mm", "1", "--diameter-mm", "30"]
PLAN += ["--mass-g", "110", "--noise", "2"]

#: Commands with a value that only the measurement itself can refuse, and the beginning of the sentence.
REFUSED = {
    "small circle": ("track", ["--circle", "64,92,2"], "--circle 64,92,2: expected a radius"),
    "circle outside": ("track", ["--circle", "900,92,40"], "--circle 900,92,40: its centre lies outside"),
    "large circle": ("track", ["--circle", "64,92,4000"], "--circle 64,92,4000: its radius is larger"),
    "polygon": ("track", [*CIRCLE, "--ignore", "1,2 3,4"], "--ignore '1,2 3,4': "),
    "mask of all": ("track", [*CIRCLE, "--ignore", "-9,-9 999,-9 999,999 -9,999"], "--ignore -9,-9 999"),
    "exposure": ("track", [*CIRCLE, "--fps", "36000", "--shutter-us", "100"], "--shutter-us 100: longer"),
    "exposure without a rate": ("track", [*CIRCLE, "--shutter-us", "10"], "--shutter-us was given, but no frame"),
    "near camera": ("track", [*CIRCLE, "--focal-px", "5"], "--focal-px 5: "),
    "frames": ("track", [*CIRCLE, "--frames", "5:2"], "--frames 5:2 holds no frame"),
    "grey": ("plan", [*PLAN, "--grey", "200,10"], "--grey 200,10: expected"),
    "spots": ("plan", [*PLAN, "--speckle-px", "99"], "--speckle-px 99 on a ball"),
    "exposure of a plan": ("plan", [*PLAN, "--shutter-us", "100"], "--shutter-us 100: longer"),
    "workers": ("benchmark make", ["--workers", "0"], "--workers 0: expected at least 1"),
    "seed": ("benchmark make", ["--seed", "-1"], "--seed -1: expected"),
    "suite": ("benchmark make", ["--suite", "plane"], "--suite plane is not known"),
}

#: Names of arguments that no option has.
OF_PYTHON = re.compile(r"\b(frame_rate|diameter_m|m_per_px|mass_kg|shell_m|sphere_map|times_s|relative_sd_\w+)\b|`")


@pytest.mark.parametrize("case", REFUSED)
def test_a_refusal_begins_with_the_option(case: str, short: Path, tmp_path: Path, capsys) -> None:
    command, options, said = REFUSED[case]
    source = [str(short)] if command == "track" else []
    quiet = [*command.split(), *source, "--out", str(tmp_path / "out"), *options, "--quiet"]
    sentence = refused(quiet, capsys)
    assert sentence.removeprefix("torchsphere: ").startswith(said)
    assert not OF_PYTHON.search(sentence)


def test_a_refusal_of_a_file_of_settings_keeps_the_names_of_its_keys(short: Path, tmp_path: Path, capsys) -> None:
    config = tmp_path / "shot.toml"
    config.write_text('fps = "fast"\n')
    said = refused(["track", str(short), "--out", str(tmp_path / "out"), "--config", str(config), "--quiet"], capsys)
    assert f"{config}: fps = 'fast': expected" in said
    (tmp_path / "list.csv").write_text(f"recording,mass_g\n{short},heavy\n")
    said = refused(["batch", str(tmp_path / "list.csv"), "--out", str(tmp_path / "out"), "--quiet"], capsys)
    assert "column 'mass_g': mass_g = 'heavy': expected" in said
