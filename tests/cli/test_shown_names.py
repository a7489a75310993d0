"""Names of files on the screen: no name may control the terminal."""

import json
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from torchsphere.cli import track
from torchsphere.cli.console import print_lines
from torchsphere.cli.main import main

#: A colour, the title of the window, an eight-bit escape, a sign that reverses the text, and a byte that is not UTF-8.
NAMES = ["\x1b[31mred", "\x1b]0;title\x07", "\x9b31m", "\u202egpj", os.fsdecode(b"caf\xe9")]


def check(printed: str) -> None:
    assert printed
    assert all(line.isprintable() for line in printed.splitlines())
    printed.encode()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not allow such names")
@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_shown_with_its_escapes(tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / f"{name}.npy"
    np.save(path, np.zeros((3, 8, 9), np.uint8))
    assert main(["info", str(path)]) == 0
    check(capsys.readouterr().out)
    assert main(["info", str(path.with_suffix(".tif"))]) == 1
    assert main(["track", str(path), "--out", str(tmp_path / "out"), "--ignore", f"{name}.png"]) == 1
    check(capsys.readouterr().err)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not allow such names")
@pytest.mark.parametrize("status", ["ok", "lost"])
def test_the_outcome_shows_the_folder_with_its_escapes(
    tmp_path: Path, status: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "\x1b[31mred"
    out.mkdir()
    steps = {"increment_px_rad": [None] * 5, "sd_increment_px_rad": [None] * 5}
    summary = {"frames_per_status": {status: 3}, "circle": {"x": 1.0, "y": 2.0, "radius": 3.0, "frame": 0}}
    summary |= {"impact": None, "mean_motion": steps, "warnings": [f"--ignore {out}.png covers nothing."]}
    (out / "summary.json").write_text(json.dumps(summary))
    done = SimpleNamespace(track=SimpleNamespace(status=np.array([status] * 3)))
    monkeypatch.setattr(track, "measure_with_progress", lambda *arguments, **options: done)
    assert main(["track", "a.npy", "--out", str(out)]) == (0 if status == "ok" else track.UNUSABLE)
    captured = capsys.readouterr()
    check(captured.out + captured.err)


def test_a_table_is_shown_with_escapes_and_its_lines(capsys: pytest.CaptureFixture[str]) -> None:
    print_lines("| a |\n| \x1b[31m |\n")
    assert capsys.readouterr().out == "| a |\n| \\x1b[31m |\n"
