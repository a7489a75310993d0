"""The command line as a program, whatever the command."""

import subprocess
import sys
from pathlib import Path

import pytest

from torchsphere.cli import main


def test_the_module_runs_as_a_program(tmp_path: Path) -> None:
    program = [sys.executable, "-m", "torchsphere", "track", str(tmp_path / "none.tif"), "--out", str(tmp_path / "out")]
    done = subprocess.run(program, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.startswith("torchsphere: ")
    assert "Traceback" not in done.stderr


def test_every_command_shows_an_example(capsys) -> None:
    for command in ("demo", "info", "track"):
        with pytest.raises(SystemExit) as stop:
            main([command, "--help"])
        assert stop.value.code == 0
        assert "example:" in capsys.readouterr().out
