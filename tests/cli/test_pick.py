"""The command `torchsphere pick`."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from processes import started
from refusals import refused

from torchsphere.archive import processes
from torchsphere.archive.work import run_job
from torchsphere.cli.main import main
from torchsphere.measure import measure
from torchsphere.pick import form
from torchsphere.pick.form import Choice
from torchsphere.results.reader import read


@contextlib.contextmanager
def served(program: list[str], folder: Path) -> Iterator[tuple["subprocess.Popen[str]", str]]:
    """The running program and the address that it prints."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    piped: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with started(program, cwd=folder, env=environment, **piped) as running:
        assert running.stdout is not None
        name, address = running.stdout.readline().split()
        assert name == "page"
        yield running, address


#: Tests that a shell starts in the background ignore Ctrl-C, and processes inherit this.
HEARS_CTRL_C = (
    "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from torchsphere.cli.main import main; sys.exit(main())"
)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 0), (signal.SIGTERM, 143)])
def test_the_page_is_served_until_ctrl_c_or_a_request_to_terminate(
    number: signal.Signals, code: int, short: Path, tmp_path: Path
) -> None:
    program = [sys.executable, "-c", HEARS_CTRL_C, "pick", str(short), "--no-browser", "--fps", "36000"]
    with served(program, tmp_path) as (running, address):
        assert address.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(address, timeout=600) as page:
            html = page.read().decode()
        assert 'name="fps"\n      value="36000"' in html
        running.send_signal(number)
        _, errors = running.communicate(timeout=600)
    assert running.returncode == code
    *steps, last = filter(None, errors.splitlines())
    assert last == "ended"
    assert all(line.startswith("torchsphere: ") and line.endswith(" ...") for line in steps)
    # Nothing was asked for, and nothing was written.
    assert list(tmp_path.iterdir()) == []


def test_a_page_that_ignores_ctrl_c_ends_with_a_request_to_terminate(short: Path, tmp_path: Path) -> None:
    ignores = HEARS_CTRL_C.replace("signal.default_int_handler", "signal.SIG_IGN")
    with served([sys.executable, "-c", ignores, "pick", str(short), "--no-browser"], tmp_path) as (running, _):
        running.send_signal(signal.SIGINT)
        running.terminate()
        running.communicate(timeout=600)
    assert running.returncode == 143


def test_what_cannot_be_shown_is_refused_in_one_sentence(short: Path, tmp_path: Path, capsys) -> None:
    quiet = ["--no-browser", "--quiet"]
    assert "does not exist" in refused(["pick", str(tmp_path / "none.tif"), *quiet], capsys)
    cut = tmp_path / "cut.tif"
    cut.write_bytes(short.read_bytes()[:5000])
    refused(["pick", str(cut), *quiet], capsys)
    np.save(tmp_path / "one.npy", np.zeros((1, 20, 20), np.uint8))
    assert "motion needs two or more" in refused(["pick", str(tmp_path / "one.npy"), *quiet], capsys)
    assert "--frames 5:99 reaches beyond the end" in refused(["pick", str(short), "--frames", "5:99", *quiet], capsys)
    assert "without a scale" in refused(["pick", str(short), "--mass-g", "5", *quiet], capsys)
    assert "is no port" in refused(["pick", str(short), "--port", "123456", *quiet], capsys)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = str(other.getsockname()[1])
        sentence = refused(["pick", str(short), "--port", port, *quiet], capsys)
        assert f"--port {port}: is used by another program" in sentence


def test_track_and_batch_take_the_file_that_the_page_writes(
    short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # In this process, because a worker takes seconds to load its libraries.
    monkeypatch.setattr(processes, "run", lambda jobs, **_: (run_job(job, measure) for job in jobs))
    sent = {
        "fields": {"fps": "36000", "diameter_mm": "30", "mass_g": "110", "telecentric": True},
        "circle": {"x": 66.29, "y": 92.6, "radius": 40.0, "frame": 1},
        "frames": [1, 6],
        "ignore": ["300,20 340,20 340,60"],
    }
    base = {"map": "off", "report": False}
    settings = form.settings_of(Choice.of(sent, 8), base, (8, 192, 384))
    config = tmp_path / "shot.toml"
    config.write_text(form.toml_text(settings, short.name), encoding="utf-8")
    assert main(["track", str(short), "--out", str(tmp_path / "one"), "--config", str(config), "--quiet"]) == 0
    archive = tmp_path / "archive"
    archive.mkdir()
    (archive / "short.tif").write_bytes(short.read_bytes())
    line = [
        "batch",
        str(archive),
        "--out",
        str(tmp_path / "many"),
        "--config",
        str(config),
        "--workers",
        "1",
        "--quiet",
    ]
    assert main(line) == 0
    for folder in (tmp_path / "one", tmp_path / "many" / "short"):
        assert read(folder).frame.tolist() == [1, 2, 3, 4, 5, 6]
        used = json.loads((folder / "summary.json").read_text())["settings"]
        assert used["telecentric"] is True
        assert used["ignore"] == sent["ignore"]
        assert [used["fps"], used["diameter_mm"], used["mass_g"]] == [36000, 30, 110]
        assert used["circle"] == [66.29, 92.6, 40.0]


@pytest.mark.parametrize(("name", "stem"), [("shot.cihx", "shot"), ("a.b.tif", "a.b")])
def test_files_are_named_after_the_recording(name: str, stem: str, tmp_path: Path) -> None:
    from torchsphere.cli.pick import _name

    (tmp_path / name).write_bytes(b"")
    assert _name(tmp_path / name) == stem
    (tmp_path / "run.3").mkdir()
    assert _name(tmp_path / "run.3") == "run.3"
