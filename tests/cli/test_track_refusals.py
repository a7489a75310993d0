"""The command ``torchsphere track``: refusals in one sentence, without an unfinished result."""

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import tifffile
from refusals import refused

from torchsphere.cli.main import main

CIRCLE = "64.3,92.6,40"


def _files(folder: Path) -> dict[str, str]:
    """Files that cannot be opened or tracked, by name."""
    rng = np.random.default_rng(0)
    files = {name: str(folder / name) for name in ("empty.tif", "text.mp4", "foreign.xyz", "cut.tif", "png.tif")}
    Path(files["empty.tif"]).touch()
    Path(files["text.mp4"]).write_text("this is no video, only words")
    Path(files["foreign.xyz"]).write_bytes(b"\x00" * 100)
    whole = folder / "whole.tif"
    tifffile.imwrite(whole, rng.integers(0, 255, (6, 80, 90), dtype=np.uint8), photometric="minisblack")
    Path(files["cut.tif"]).write_bytes(whole.read_bytes()[:20_000])
    Path(files["png.tif"]).write_bytes(b"\x89PNG\r\n\x1a\n" + b"\x00" * 50)
    arrays = {
        "one.npy": rng.integers(0, 255, (1, 80, 90), dtype=np.uint8),
        "flat.npy": np.full((6, 80, 90), 100, dtype=np.uint8),
        "noise.npy": rng.normal(100, 5, (6, 80, 90)).astype(np.float32),
    }
    for name, array in arrays.items():
        np.save(folder / name, array)
        files[name] = str(folder / name)
    header = folder / "lonely.cih"
    header.write_text("#Camera Information Header\nRecord Rate(fps) : 1000\nTotal Frame : 3\n")
    (folder / "void").mkdir()
    return files | {"lonely.cih": str(header), "void": str(folder / "void"), "missing": str(folder / "missing.tif")}


BAD_FILES = (
    *("empty.tif", "text.mp4", "foreign.xyz", "cut.tif", "png.tif", "one.npy", "flat.npy", "noise.npy"),
    *("lonely.cih", "void", "missing"),
)


BAD_OPTIONS = {
    "circle outside": ["--circle", "900,92,40"],
    "circle not finite": ["--circle", "nan,92,40"],
    "circle of two numbers": ["--circle", "64,92"],
    "circle without a radius": ["--circle", "64,92,0"],
    "unknown model": ["--circle", CIRCLE, "--model", "wobbly"],
    "frame rate not finite": ["--circle", CIRCLE, "--fps", "inf"],
    "frame rate negative": ["--circle", CIRCLE, "--fps", "-5"],
    "two scales": ["--circle", CIRCLE, "--diameter-mm", "30", "--mm-per-px", "0.5"],
    "mass without a scale": ["--circle", CIRCLE, "--mass-g", "110"],
    "diameter of zero": ["--circle", CIRCLE, "--diameter-mm", "0"],
    "region too large": ["--circle", CIRCLE, "--roi", "1.5"],
    "frames backwards": ["--circle", CIRCLE, "--frames", "5:2"],
    "frames beyond the end": ["--circle", CIRCLE, "--frames", "0:99"],
    "one frame": ["--circle", CIRCLE, "--frames", "3:4"],
    "frames in words": ["--circle", CIRCLE, "--frames", "all"],
    "refine nothing": ["--refine"],
    "polygon of two corners": ["--circle", CIRCLE, "--ignore", "1,2 3,4"],
    "pinhole without a camera": ["--circle", CIRCLE, "--model", "pinhole"],
    "camera with a model that knows none": ["--circle", CIRCLE, "--model", "finite", "--focal-px", "500"],
    "telecentric lens at a distance": ["--circle", CIRCLE, "--telecentric", "--focal-px", "500"],
    "camera within the ball": ["--circle", CIRCLE, "--focal-px", "5"],
    "distance without a diameter": ["--circle", CIRCLE, "--model", "pinhole", "--distance-mm", "500"],
    "distortion without a camera": ["--circle", CIRCLE, "--distortion", "0.1,0,0"],
    "principal point without a camera": ["--circle", CIRCLE, "--principal-px", "60,60"],
    "two distances": ["--model", "pinhole", "--focal-px", "500", "--distance-mm", "500", "--diameter-mm", "30"],
    "distance within the ball": ["--model", "pinhole", "--distance-mm", "10", "--diameter-mm", "30"],
    "distortion of two numbers": ["--model", "pinhole", "--focal-px", "500", "--distortion", "0.1,0"],
    "unknown method": ["--method", "guessing"],
    "shell without a mass": ["--circle", CIRCLE, "--diameter-mm", "30", "--shell-mm", "2"],
    "shell thicker than the ball": [
        *("--circle", CIRCLE, "--diameter-mm", "30", "--mass-g", "110", "--fps", "1000", "--shell-mm", "20")
    ],
    "even window": [
        "--circle",
        CIRCLE,
        "--diameter-mm",
        "30",
        "--fps",
        "1000",
        "--method",
        "savitzky-golay",
        "--window",
        "4",
    ],
    "unknown option": ["--colour", "red"],
    "config missing": ["--config", "nowhere.toml"],
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_a_file_that_cannot_be_tracked_is_refused_in_one_sentence(name: str, tmp_path: Path, capsys) -> None:
    if name == "text.mp4":
        pytest.importorskip("av", reason="the extra 'video' is not installed")
    folder = tmp_path / "in"
    folder.mkdir()
    path = _files(folder)[name]
    refused(["track", path, "--out", str(tmp_path / "out"), "--quiet"], capsys)
    assert [entry.name for entry in tmp_path.iterdir()] == ["in"]


@pytest.mark.parametrize("case", BAD_OPTIONS)
def test_an_invalid_option_is_refused_in_one_sentence(case: str, tmp_path: Path, short: Path, capsys) -> None:
    refused(["track", str(short), "--out", str(tmp_path / "out"), "--quiet", *BAD_OPTIONS[case]], capsys)
    assert list(tmp_path.iterdir()) == []


def test_pixels_that_are_not_finite_are_refused_even_under_a_mask(tmp_path: Path, short: Path, capsys) -> None:
    images = tifffile.imread(short).astype(np.float32)
    images[3, 5, 5] = np.nan
    np.save(tmp_path / "nan.npy", images)
    arguments = ["track", str(tmp_path / "nan.npy"), "--out", str(tmp_path / "out"), "--circle", CIRCLE, "--quiet"]
    sentence = refused([*arguments, "--ignore", "3,3 8,3 8,8 3,8"], capsys)
    assert "image 3 holds values that are not finite" in sentence
    assert "replace them in the file (a mask comes after reading" in sentence


def test_cuda_without_a_device_is_refused(tmp_path: Path, short: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    arguments = ["track", str(short), "--out", str(tmp_path / "out"), "--device", "cuda", "--quiet"]
    assert "CUDA" in refused(arguments, capsys)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("text", ["speed = 3", "fps = 'fast'", "fps = ", "frames = [1, 2]", "circle = [1, 2]"])
def test_an_invalid_config_is_refused(text: str, tmp_path: Path, short: Path, capsys) -> None:
    config = tmp_path / "shot.toml"
    config.write_text(text)
    arguments = ["track", str(short), "--out", str(tmp_path / "out"), "--config", str(config), "--quiet"]
    assert "shot.toml" in refused(arguments, capsys)


@pytest.mark.parametrize(
    ("text", "advice"),
    [
        ("circle = '64.3,92.6,40'", "circle = [X, Y, R]"),
        ("mass_g = '110'", "mass_g = a number, without quotation marks"),
        ("overlay = 'yes'", "overlay = true or false"),
        ("frames = [10, 40]", 'frames = "A:B"'),
        ("no_report = true", "report = false"),
    ],
)
def test_the_refusal_of_a_config_states_a_valid_form(
    text: str, advice: str, tmp_path: Path, short: Path, capsys
) -> None:
    config = tmp_path / "shot.toml"
    config.write_text(text)
    arguments = ["track", str(short), "--out", str(tmp_path / "out"), "--config", str(config), "--quiet"]
    assert advice in refused(arguments, capsys)


def test_the_refusal_of_a_recording_without_a_ball_names_a_helpful_option(tmp_path: Path, capsys) -> None:
    np.save(tmp_path / "flat.npy", np.full((6, 80, 90), 100, dtype=np.uint8))
    sentence = refused(["track", str(tmp_path / "flat.npy"), "--out", str(tmp_path / "out"), "--quiet"], capsys)
    assert "give its outline with --circle" in sentence


def test_a_mask_over_the_ball_is_named_with_a_found_and_with_a_given_circle(
    tmp_path: Path, short: Path, capsys
) -> None:
    mask = np.full(tifffile.imread(short).shape[1:], 255, dtype=np.uint8)
    mask[-8:] = 0
    tifffile.imwrite(tmp_path / "inverted.tif", mask)
    arguments = ["track", str(short), "--out", str(tmp_path / "out"), "--ignore", str(tmp_path / "inverted.tif")]
    sentence = refused([*arguments, "--quiet"], capsys)
    assert "no ball was found" in sentence
    assert "or correct --ignore, which leaves out 9" in sentence
    assert main([*arguments, "--circle", CIRCLE, "--no-report"]) == 4
    assert "--ignore covers 100 % of the ball in frame 0" in capsys.readouterr().out


def test_a_result_folder_below_a_file_is_refused(tmp_path: Path, short: Path, capsys) -> None:
    (tmp_path / "file").touch()
    refused(["track", str(short), "--out", str(tmp_path / "file" / "out"), "--circle", CIRCLE, "--quiet"], capsys)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_folder_without_permission_is_refused_before_tracking(
    tmp_path: Path, short: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Tests may run as root, who may write anywhere.
    monkeypatch.setattr("torchsphere.results.atomic_output.os.access", lambda *_: False)
    monkeypatch.setattr("torchsphere.measure.track", None)
    assert main(["track", str(short), "--out", str(tmp_path / "new" / "result"), "--circle", CIRCLE, "--quiet"]) == 1
    assert f"result: {tmp_path} may not be written to" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_a_failed_result_leaves_no_files(tmp_path: Path, short: Path, capsys, monkeypatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", "track.csv")

    monkeypatch.setattr("torchsphere.results.writer.write_summary", full)
    arguments = ["track", str(short), "--out", str(tmp_path / "out"), "--circle", CIRCLE, "--quiet"]
    assert "no space left" in refused(arguments, capsys)
    assert list(tmp_path.iterdir()) == []


def test_a_termination_signal_leaves_no_files(tmp_path: Path, short: Path, monkeypatch) -> None:
    def terminate(folder: Path, *_: object) -> None:
        assert folder.is_dir()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(60)

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr("torchsphere.report.draw.draw", terminate)
    with pytest.raises(SystemExit) as stop:
        main(["track", str(short), "--out", str(tmp_path / "out"), "--circle", CIRCLE, "--quiet"])
    assert stop.value.code == 143
    assert not list(tmp_path.iterdir())
    assert signal.getsignal(signal.SIGTERM) is before
