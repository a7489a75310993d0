"""One exit code for one kind of ending."""

from pathlib import Path

import numpy as np
import pytest

from torchsphere.cli.main import main

#: Settings that no command line should have, whether the parser sees it or the program.
BAD_SETTINGS = (
    ["--fps", "fast"],
    ["--fps", "-5"],
    ["--mass-g", "110"],
    ["--diameter-mm", "30", "--mm-per-px", "0.5"],
    ["--model", "wobbly"],
    ["--model", "pinhole"],
    ["--cfc", "61"],
    ["--refine"],
    ["--colour", "red"],
)


@pytest.mark.parametrize("command", ["track", "batch"])
@pytest.mark.parametrize("given", BAD_SETTINGS, ids=" ".join)
def test_a_setting_that_cannot_be_used_ends_with_2_whoever_sees_it(
    command: str, given: list[str], short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main([command, str(short), "--out", str(tmp_path / "out"), *given])
    except SystemExit as stop:
        code = stop.code
    assert code == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("torchsphere: ")
    assert printed.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_an_input_that_cannot_be_used_ends_with_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command in (["track"], ["batch"], ["info"], ["report"]):
        out = [] if command[0] in ("info", "report") else ["--out", str(tmp_path / "out")]
        assert main([*command, str(tmp_path / "none.tif"), *out]) == 1
    assert capsys.readouterr().err.count("torchsphere: ") == 4


@pytest.mark.parametrize("command", [["instruments", "r", "--gate", "g.csv", "--spacing-mm", "x"], ["plan", "--out"]])
def test_other_commands_refuse_their_command_line_with_2_too(command: list[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(command)
    assert stop.value.code == 2


def test_a_plan_without_its_numbers_is_refused_with_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", "--out", str(tmp_path / "plan"), "--speed", "70"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_several_recordings_have_own_folders_and_one_that_fails_does_not_end_the_rest(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flat = tmp_path / "flat.npy"
    np.save(flat, np.full((6, 80, 90), 100, dtype=np.uint8))
    out = tmp_path / "out"
    options = ["--circle", "64.3,92.6,40", "--map", "off", "--no-report", "--out", str(out)]
    assert main(["track", str(flat), str(tmp_path / "none.tif"), str(short), *options]) == 3
    printed = capsys.readouterr()
    assert [path.name for path in sorted(out.iterdir())] == ["short"]
    assert f"{short} (3 of 3)" in printed.out
    assert "8 ok" in printed.out
    assert "none.tif" in printed.err


def test_recordings_of_one_name_are_refused_before_anything_is_measured(
    short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / short.name
    assert main(["track", str(short), str(other), "--out", str(tmp_path / "out")]) == 2
    assert "would both be written to" in capsys.readouterr().err


def test_verbose_names_the_steps_with_their_times(short: Path, tmp_path: Path, capsys) -> None:
    options = ["--circle", "64.3,92.6,40", "--map", "off", "--no-report", "--quiet", "--out", str(tmp_path / "out")]
    assert main(["track", str(short), *options, "--verbose"]) == 0
    printed = capsys.readouterr()
    assert printed.out == ""
    assert " s  opened " in printed.err
    assert " s  following the circle 64.30,92.60,40.00 px" in printed.err
    assert main(["track", str(short), *options, "--overwrite"]) == 0
    assert capsys.readouterr().err == ""


def test_the_search_for_the_ball_says_so(short: Path, tmp_path: Path, capsys) -> None:
    assert main(["info", str(short), "--preview", str(tmp_path / "ball.png")]) == 0
    assert "looking for the ball in 8 frames ..." in capsys.readouterr().err
