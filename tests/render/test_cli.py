"""The renderer's command line: its files, and one clear sentence for bad input."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import tifffile
from rendering import needs_mitsuba

import render.frames
from render import preset
from render.backend import Backend, packaged_llvm
from render.cli import main

ROOT = Path(__file__).resolve().parents[2]
TINY = ["--set", "camera.width=32", "--set", "camera.height=32", "--set", "trajectory.start_m=[0,0,0]"]


@pytest.fixture
def no_renderer(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Replace rendered frames by grey ones; gives the numbers of the frames that were asked for."""
    asked: list[int] = []

    def grey(setup, motion, times_s) -> Iterator[np.ndarray]:
        for number in range(len(times_s)):
            asked.append(number)
            yield np.full((setup.camera.height, setup.camera.width), 7, np.uint8)

    monkeypatch.setattr(render.frames, "render_frames", grey)
    monkeypatch.setattr(render.backend, "choose", lambda variant: Backend("none", "rendering by a test"))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: object())
    return asked


def refused(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> str:
    """Run the command line; it must refuse with one sentence, exit code 2 and no traceback."""
    try:
        code = main(arguments)
    except SystemExit as stop:
        code = stop.code
    said = capsys.readouterr()
    assert code == 2
    assert said.out == ""
    assert said.err.startswith("render: ")
    assert said.err.count("\n") == 1
    return said.err


@needs_mitsuba
def test_a_tiny_shot_renders_end_to_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["example", "--frames", "3", "--samples", "4", *TINY]
    assert main([*arguments, "--out", str(tmp_path / "one")]) == 0
    said = capsys.readouterr()
    assert "rendering" in said.err
    assert f"torchsphere track {tmp_path / 'one' / 'frames.tif'} --out {tmp_path / 'one'}-track --fps 36000" in said.out
    images = tifffile.imread(tmp_path / "one" / "frames.tif")
    assert images.shape == (3, 32, 32)
    # The ball covers the image: it shows dark and bright paint.
    assert images.min() < 60 < 180 < images.max()
    scene = json.loads((tmp_path / "one" / "scene.json").read_text())
    assert scene["variant"] in scene["variant_reason"]
    # If this or an earlier test imports Mitsuba too early, Mitsuba finds no LLVM, and later tests are slow or fail.
    assert (scene["variant"] == "scalar_rgb") == (packaged_llvm() is None)
    assert scene["shot"]["quality"]["samples"] == 4

    assert main([*arguments, "--out", str(tmp_path / "two"), "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    for name in ("frames.tif", "truth.csv", "scene.json"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes(), name

    assert main([str(tmp_path / "one" / "scene.json"), "--out", str(tmp_path / "three"), "--quiet"]) == 0
    assert np.array_equal(tifffile.imread(tmp_path / "three" / "frames.tif"), images)
    assert main([*arguments, "--out", str(tmp_path / "four"), "--seed", "9", "--quiet"]) == 0
    assert not np.array_equal(tifffile.imread(tmp_path / "four" / "frames.tif"), images)


def test_the_list_names_every_preset_in_one_line_each(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == preset.names()
    assert max(map(len, lines)) <= 120


def test_options_change_the_preset(tmp_path: Path, no_renderer: list[int]) -> None:
    arguments = ["example", "--out", str(tmp_path / "out"), "--frames", "4", "--seed", "5", "--samples", "8", "--quiet"]
    assert main([*arguments, "--format", "npy", *TINY]) == 0
    assert no_renderer == [0, 1, 2, 3]
    assert np.load(tmp_path / "out" / "frames.npy").shape == (4, 32, 32)
    shot = json.loads((tmp_path / "out" / "scene.json").read_text())["shot"]
    assert (shot["frames"], shot["quality"]["samples"]) == (4, 8)
    assert {shot[part]["seed"] for part in ("pattern", "background", "sensor", "quality")} == {5}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "expected a SHOT and --out DIR"),
        (["example"], "expected a SHOT and --out DIR"),
        (["exmaple", "--out", "{}"], "preset 'exmaple' is not known: did you mean example?"),
        (["example", "--out", "{}", "--frames", "0"], "preset 'example', frames = 0: expected"),
        (["example", "--out", "{}", "--frames", "x"], "invalid int value"),
        (["example", "--out", "{}", "--seed", "-1"], "seed = -1"),
        (["example", "--out", "{}", "--set", "camera.focal=1"], "preset 'example', camera.focal is not known"),
        (["example", "--out", "{}", "--set", "camera"], "--set camera: expected field.path=value"),
        (["example", "--out", "{}", "--format", "gif"], "invalid choice"),
        (["none.toml", "--out", "{}"], "there is no such file"),
    ],
)
def test_what_cannot_be_used_is_refused_with_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    assert words in refused(capsys, [argument.format(tmp_path / "out") for argument in arguments])
    assert list(tmp_path.iterdir()) == []


def test_a_folder_with_other_files_is_refused_before_anything_is_rendered(
    tmp_path: Path, no_renderer: list[int], capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "thesis.txt").write_text("all of it")
    assert "--overwrite" in refused(capsys, ["example", "--out", str(tmp_path)])
    assert no_renderer == []


def test_ctrl_c_leaves_nothing(
    tmp_path: Path, no_renderer: list[int], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(setup, motion, times_s) -> Iterator[np.ndarray]:
        yield np.zeros((setup.camera.height, setup.camera.width), np.uint8)
        raise KeyboardInterrupt

    monkeypatch.setattr(render.frames, "render_frames", interrupted)
    assert main(["example", "--out", str(tmp_path / "out"), "--quiet"]) == 130
    assert "nothing was written" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def run(script: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)


def test_without_mitsuba_it_says_which_extra_to_install_and_the_rest_works(tmp_path: Path) -> None:
    done = run(
        "import sys; sys.modules.update(mitsuba=None, drjit=None)\n"
        "from render.cli import main\n"
        "from render import preset, truth\n"
        "assert main(['--list']) == 0\n"
        "assert len(truth.truth(preset.load('example'))['x_px']) == 40\n"
        f"sys.exit(main(['example', '--out', {str(tmp_path / 'out')!r}]))"
    )
    assert done.returncode == 2, done.stderr
    assert done.stderr == "render: rendering needs mitsuba, which is not installed: pip install 'torchsphere[render]'\n"
    assert list(tmp_path.iterdir()) == []


def test_the_command_line_starts_without_torch_and_without_mitsuba() -> None:
    done = run("import sys, render.cli\nsys.exit(str({'torch', 'mitsuba', 'drjit', 'matplotlib'} & set(sys.modules)))")
    assert done.stderr.strip() == "set()"
