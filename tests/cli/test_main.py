"""The command line as a program."""

import subprocess
import sys
from pathlib import Path

import pytest

from torchsphere.cli.main import main


def test_the_module_runs_as_a_program(tmp_path: Path) -> None:
    program = [sys.executable, "-m", "torchsphere", "track", str(tmp_path / "none.tif"), "--out", str(tmp_path / "out")]
    done = subprocess.run(program, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.startswith("torchsphere: ")
    assert "Traceback" not in done.stderr


def test_every_command_shows_an_example(capsys) -> None:
    for command in ("demo", "info", "pick", "track"):
        with pytest.raises(SystemExit) as stop:
            main([command, "--help"])
        assert stop.value.code == 0
        assert "example:" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "command"),
    [
        (["track", "shot.tif", "--out", "result", "--diameter", "30"], "torchsphere track"),
        (["benchmark", "run", "bench", "--out", "mine", "--overwrite"], "torchsphere benchmark run"),
    ],
)
def test_the_refusal_of_an_unknown_option_names_the_help_of_the_command(
    arguments: list[str], command: str, capsys
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert capsys.readouterr().err.endswith(f"; see '{command} --help'\n")


def test_the_loops_are_compiled_on_request(capsys, monkeypatch) -> None:
    # Another test of this process may have had no place for them.
    monkeypatch.setattr("torchsphere.kernels.jit._NOT_KEPT", [])
    assert main(["warm-up"]) == 0
    assert "the loops are compiled and kept on disk" in capsys.readouterr().out
