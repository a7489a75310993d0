"""The command line: what it writes, and one clear sentence for whatever it cannot use."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import tifffile

from torchsphere import demo, forward
from torchsphere.cli import main
from torchsphere.request import Request
from torchsphere.results import TRACK_COLUMNS
from torchsphere.setting import option


@pytest.fixture(scope="module")
def shot() -> demo.Shot:
    return demo.make_shot()


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory, shot: demo.Shot) -> Path:
    """The first frames of the demo's shot as a TIFF."""
    path = tmp_path_factory.mktemp("short") / "short.tif"
    tifffile.imwrite(path, shot.images[:8], photometric="minisblack")
    return path


CIRCLE = "64.3,92.6,40"


def rows(path: Path) -> tuple[list[str], list[dict[str, str]]]:
    with path.open(newline="") as stream:
        reader = csv.DictReader(stream)
        return list(reader.fieldnames or ()), list(reader)


def test_the_demo_recovers_its_motion_within_the_stated_uncertainty(tmp_path: Path, capsys) -> None:
    assert main(["demo", "--out", str(tmp_path / "demo"), "--quiet"]) == 0
    printed = capsys.readouterr().out
    # Two standard deviations hold 95 % of good values: of 13 quantities at most two may be outside, and none far.
    table = [line for line in printed.splitlines() if line.startswith(("velocity", "spin", "force", "position"))]
    ratios = [abs(float(line.split()[-1])) for line in table]
    assert len(ratios) == 13
    assert sum(ratio > 2 for ratio in ratios) <= 2
    assert max(ratios) < 3
    names = {path.name for path in (tmp_path / "demo").iterdir()}
    assert {"track.csv", "track.parquet", "kinematics.csv", "summary.json", "figures", "shot.tif", "truth.csv"} <= names
    # Its images lie in a temporary folder while they are measured.
    summary = json.loads((tmp_path / "demo" / "summary.json").read_text())
    assert summary["input"]["path"] == "synthetic example shot"
    assert "<title>synthetic example shot: " in (tmp_path / "demo" / "report.html").read_text()


def test_track_writes_the_promised_columns_with_the_first_row_empty(tmp_path: Path, short: Path) -> None:
    out = tmp_path / "result"
    arguments = ["track", str(short), "--out", str(out), "--fps", "36000", "--diameter-mm", "30", "--mass-g", "110"]
    assert main([*arguments, "--quiet"]) == 0
    head, table = rows(out / "track.csv")
    assert head == list(TRACK_COLUMNS)
    assert [row["status"] for row in table] == ["ok"] * 8
    assert table[0]["dx_px"] == "nan"
    assert float(table[0]["qw"]) == 1.0
    assert all(float(row["dx_px"]) == pytest.approx(5.3, abs=0.05) for row in table[1:])
    head, _ = rows(out / "kinematics.csv")
    assert head[:3] == ["time_s", "x_m", "y_m"]
    assert "sd_fx_N" in head
    assert head[-1] == "frame"
    parquet = pq.read_table(out / "track.parquet")
    assert parquet.num_rows == 8
    covariance = np.array(parquet["covariance"].to_pylist()[3]).reshape(5, 5)
    np.testing.assert_allclose(np.sqrt(covariance[0, 0]), float(table[3]["sd_dx_px"]), rtol=1e-8)


def test_the_summary_holds_input_settings_and_versions(tmp_path: Path, short: Path) -> None:
    out = tmp_path / "result"
    assert main(["track", str(short), "--out", str(out), "--circle", CIRCLE, "--frames", "2:6", "--quiet"]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["input"]["path"] == str(short)
    assert len(summary["input"]["sha256"]) == 64
    assert (summary["input"]["first_frame"], summary["input"]["last_frame"]) == (2, 5)
    assert summary["settings"]["model"] == "rigid"
    assert summary["frames_per_status"] == {"ok": 4}
    assert "torch" in summary["versions"]
    assert any("frame rate is not known" in sentence for sentence in summary["warnings"])
    assert not (out / "kinematics.csv").exists()
    _, table = rows(out / "track.csv")
    assert [row["frame"] for row in table] == ["2", "3", "4", "5"]
    assert [row["time_s"] for row in table] == [""] * 4


def test_options_come_from_a_file_and_the_command_line_wins(tmp_path: Path, short: Path) -> None:
    config = tmp_path / "shot.toml"
    config.write_text('fps = 1000\nmm-per-px = 0.5\nmodel = "finite"\ncircle = [64.3, 92.6, 40]\nframes = "0:4"\n')
    out = tmp_path / "result"
    arguments = ["track", str(short), "--out", str(out), "--config", str(config), "--diameter-mm", "30", "--quiet"]
    assert main(arguments) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["settings"]["model"] == "finite"
    assert summary["frame_rate"] == 1000
    assert summary["scale"]["m_per_px"] == pytest.approx(0.03 / 80)
    assert summary["input"]["last_frame"] == 3


def test_a_camera_comes_from_the_command_line_or_a_file_and_its_focal_length_from_the_distance(
    tmp_path: Path, short: Path
) -> None:
    config = tmp_path / "shot.toml"
    config.write_text('model = "pinhole"\nprincipal-px = [70, 80]\ndistortion = [-0.1, 0.01, 0]\n')
    out = tmp_path / "result"
    arguments = ["track", str(short), "--out", str(out), "--circle", CIRCLE, "--config", str(config), "--frames", "1:4"]
    assert main([*arguments, "--distance-mm", "1500", "--diameter-mm", "30", "--fps", "1000", "--quiet"]) == 0
    summary = json.loads((out / "summary.json").read_text())
    camera = summary["settings"]["camera"]
    # 1.5 m are 100 radii of 15 mm: the focal length is 100 times the outline of 40 px, but for a part in 20 000.
    assert camera["focal_px"] == pytest.approx(4000.0, rel=1e-4)
    assert (camera["principal_px"], camera["distortion"]) == ([70, 80], [-0.1, 0.01, 0])
    _, table = rows(out / "kinematics.csv")
    assert [(row["frame"], row["time_s"]) for row in table] == [("1", "0.001"), ("2", "0.002"), ("3", "0.003")]
    # 5.3 px per frame of 1 ms at 15 mm / 40 px, seen from so far that neither perspective nor distortion counts.
    assert all(float(row["vx_m_s"]) == pytest.approx(5.3 * 0.015 / 40 * 1000, rel=0.02) for row in table[1:-1])


def test_without_a_mass_there_are_no_newtons_and_without_an_impact_the_summary_says_so(
    tmp_path: Path, short: Path
) -> None:
    out = tmp_path / "result"
    arguments = ["track", str(short), "--out", str(out), "--circle", CIRCLE, "--fps", "36000", "--diameter-mm", "30"]
    assert main([*arguments, "--quiet"]) == 0
    head, _ = rows(out / "kinematics.csv")
    assert not [name for name in head if name.endswith("_N")]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["impact"] is None
    assert any(sentence.startswith("No impact is reported: ") for sentence in summary["warnings"])
    assert summary["differentiation"]["method"] == "smoother"


def test_the_demo_s_impact_stands_in_the_summary_with_its_uncertainty(tmp_path: Path, shot: demo.Shot) -> None:
    path = tmp_path / "shot.tif"
    tifffile.imwrite(path, shot.images, photometric="minisblack")
    out = tmp_path / "result"
    arguments = ["track", str(path), "--out", str(out), "--fps", "36000", "--diameter-mm", "30", "--mass-g", "110"]
    assert (
        main([*arguments, "--method", "smoother", "--normal-deg", "180", "--scale-sd-percent", "0.1", "--quiet"]) == 0
    )
    summary = json.loads((out / "summary.json").read_text())
    found = summary["impact"]
    # The demo's ball comes at 71.55 m/s and leaves at -32.4 m/s, and its force peaks at 53.7 kN.
    for name, true, part in (("velocity_before", 71.55, 0), ("velocity_after", -32.4, 0)):
        assert abs(found[name]["value"][part] - true) < 3 * found[name]["sd"][part]
    assert found["restitution_normal"]["value"] == pytest.approx(32.4 / 71.55, abs=0.005)
    peak = found["peak_force"]
    assert abs(np.max(np.abs(peak["value"])) - 53730) < 3.5 * np.max(np.abs(peak["sd"]))
    assert peak["unit"] == "N"


@pytest.mark.parametrize("method", ["savitzky-golay", "differences"])
def test_other_ways_to_differentiate_are_named_in_the_summary(method: str, tmp_path: Path, short: Path) -> None:
    out = tmp_path / "result"
    arguments = ["track", str(short), "--out", str(out), "--circle", CIRCLE, "--fps", "36000", "--mm-per-px", "0.375"]
    assert main([*arguments, "--method", method, "--window", "5", "--order", "2", "--quiet"]) == 0
    assert json.loads((out / "summary.json").read_text())["differentiation"]["method"] == method


def test_an_existing_result_is_replaced_only_on_request_and_other_files_never(
    tmp_path: Path, short: Path, capsys
) -> None:
    out = tmp_path / "result"
    arguments = ["track", str(short), "--out", str(out), "--circle", CIRCLE, "--frames", "0:3", "--quiet"]
    assert main(arguments) == 0
    before = (out / "summary.json").stat().st_mtime_ns
    assert main(arguments) == 1
    assert "--overwrite" in capsys.readouterr().err
    assert (out / "summary.json").stat().st_mtime_ns == before
    assert main([*arguments, "--overwrite"]) == 0
    assert (out / "summary.json").stat().st_mtime_ns > before
    strangers = tmp_path / "thesis"
    strangers.mkdir()
    (strangers / "chapter1.txt").write_text("years of work")
    assert main(["track", str(short), "--out", str(strangers), "--circle", CIRCLE, "--overwrite", "--quiet"]) == 1
    assert [path.name for path in strangers.iterdir()] == ["chapter1.txt"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result", "thesis"]


def test_a_folder_that_may_not_be_made_is_named_before_anything_is_tracked(
    tmp_path: Path, short: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The tests may run as a user who may write anywhere.
    monkeypatch.setattr("torchsphere.results.os.access", lambda *_: False)
    monkeypatch.setattr("torchsphere.measure.track", None)
    assert main(["track", str(short), "--out", str(tmp_path / "new" / "result"), "--circle", CIRCLE, "--quiet"]) == 1
    assert f"result: {tmp_path} may not be written to" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_a_frame_rate_that_was_given_is_not_missed(tmp_path: Path, short: Path) -> None:
    arguments = ["track", str(short), "--circle", CIRCLE, "--frames", "0:2", "--quiet", "--out"]
    for name, given, noted in (("without", (), True), ("with", ("--fps", "100"), False)):
        assert main([*arguments, str(tmp_path / name), *given]) == 0
        warnings = " ".join(json.loads((tmp_path / name / "summary.json").read_text())["warnings"])
        assert ("no frame rate" in warnings) == noted


def test_pixels_that_are_no_number_are_refused_even_where_they_are_masked_and_the_advice_says_so(
    tmp_path: Path, short: Path, capsys
) -> None:
    images = tifffile.imread(short).astype(np.float32)
    images[3, 5, 5] = np.nan
    np.save(tmp_path / "nan.npy", images)
    arguments = ["track", str(tmp_path / "nan.npy"), "--out", str(tmp_path / "out"), "--circle", CIRCLE, "--quiet"]
    sentence = refused([*arguments, "--ignore", "3,3 8,3 8,8 3,8"], capsys)
    assert "image 3 holds values that are not finite" in sentence
    assert "replace them in the file (even where a mask is to leave them out" in sentence


def test_info_finds_the_ball_only_for_its_preview_and_its_help_says_so(short: Path, capsys) -> None:
    assert main(["info", str(short)]) == 0
    assert "circle" not in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["info", "--help"])
    assert "with --preview, also where the ball is" in " ".join(capsys.readouterr().out.split())


def test_info_says_what_the_file_knows_and_draws_the_circle(tmp_path: Path, short: Path, capsys) -> None:
    preview = tmp_path / "preview.png"
    assert main(["info", str(short), "--preview", str(preview)]) == 0
    printed = capsys.readouterr().out
    assert "384 x 192 px" in printed
    assert "frame rate  unknown" in printed
    circle = next(line.split()[2] for line in printed.splitlines() if line.startswith("circle"))
    np.testing.assert_allclose([float(v) for v in circle.split(",")], [64.3, 92.6, 40.0], atol=0.5)
    assert preview.stat().st_size > 10_000


def _files(folder: Path) -> dict[str, str]:
    """Files that are no recording, or none that can be tracked, by what is wrong with them."""
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
    "camera without pinhole": ["--circle", CIRCLE, "--focal-px", "500"],
    "distance without a diameter": ["--circle", CIRCLE, "--model", "pinhole", "--distance-mm", "500"],
    "distortion without pinhole": ["--circle", CIRCLE, "--distortion", "0.1,0,0"],
    "principal point without pinhole": ["--circle", CIRCLE, "--principal-px", "60,60"],
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


def refused(arguments: list[str], capsys) -> str:
    """The sentence with which the command line refuses ``arguments``."""
    try:
        code = main(arguments)
    except SystemExit as stop:
        code = int(stop.code or 0)
    printed = capsys.readouterr()
    assert code != 0
    assert printed.out == ""
    sentence = printed.err.strip()
    assert sentence.startswith("torchsphere: ")
    assert "\n" not in sentence
    assert "Traceback" not in sentence
    assert len(sentence) > 30
    return sentence


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
def test_an_option_without_sense_is_refused_in_one_sentence(case: str, tmp_path: Path, short: Path, capsys) -> None:
    refused(["track", str(short), "--out", str(tmp_path / "out"), "--quiet", *BAD_OPTIONS[case]], capsys)
    assert list(tmp_path.iterdir()) == []


def test_cuda_without_a_device_is_refused(tmp_path: Path, short: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    arguments = ["track", str(short), "--out", str(tmp_path / "out"), "--device", "cuda", "--quiet"]
    assert "CUDA" in refused(arguments, capsys)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("text", ["speed = 3", "fps = 'fast'", "fps = ", "frames = [1, 2]", "circle = [1, 2]"])
def test_a_config_that_says_nothing_known_is_refused(text: str, tmp_path: Path, short: Path, capsys) -> None:
    config = tmp_path / "shot.toml"
    config.write_text(text)
    arguments = ["track", str(short), "--out", str(tmp_path / "out"), "--config", str(config), "--quiet"]
    assert "shot.toml" in refused(arguments, capsys)


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path, short: Path, capsys) -> None:
    (tmp_path / "file").touch()
    refused(["track", str(short), "--out", str(tmp_path / "file" / "out"), "--circle", CIRCLE, "--quiet"], capsys)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_result_that_fails_half_way_leaves_nothing(tmp_path: Path, short: Path, capsys, monkeypatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", "track.csv")

    monkeypatch.setattr("torchsphere.results.write_summary", full)
    arguments = ["track", str(short), "--out", str(tmp_path / "out"), "--circle", CIRCLE, "--quiet"]
    assert "no space left" in refused(arguments, capsys)
    assert list(tmp_path.iterdir()) == []


def test_a_request_to_end_leaves_nothing_half_written(tmp_path: Path, short: Path, monkeypatch) -> None:
    def ended(folder: Path) -> None:
        assert folder.is_dir()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(60)

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr("torchsphere.report.draw.draw", ended)
    with pytest.raises(SystemExit) as stop:
        main(["track", str(short), "--out", str(tmp_path / "out"), "--circle", CIRCLE, "--quiet"])
    assert stop.value.code == 143
    assert not list(tmp_path.iterdir())
    assert signal.getsignal(signal.SIGTERM) is before


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


def test_a_rotation_without_texture_stays_empty_in_the_table(tmp_path: Path) -> None:
    import torch

    plain = forward.Pattern(torch.full((8, 8, 8), 200.0))
    centres = torch.tensor([[40.0, 50.0], [43.0, 50.5], [46.0, 51.0], [49.0, 51.5]])
    images = forward.render(plain, centres, 25.0, torch.eye(3).expand(4, 3, 3), 20.0, shape=(100, 120))
    noise = torch.randn(images.shape, generator=torch.Generator().manual_seed(0))
    np.save(tmp_path / "plain.npy", (images + noise).numpy())
    assert main(["track", str(tmp_path / "plain.npy"), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    _, table = rows(tmp_path / "out" / "track.csv")
    assert {row["status"] for row in table} == {"weak_texture"}
    assert all(row["wx_rad"] == "nan" and row["sd_wy_rad"] == "nan" for row in table)
    # Edges of a plain ball of this size and contrast are good to a hundredth of a px.
    assert all(float(row["dx_px"]) == pytest.approx(3.0, abs=0.03) for row in table[1:])


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
    # None of these comes to use without a frame rate, or by the smoother.
    "even window": (
        {"window": 4},
        "--window 4 with --order 3: expected an order of 2 or more and an odd window longer than that",
    ),
    "scale's share": ({"scale_sd_percent": 500.0}, "--scale-sd-percent 500: expected 0 to below 100"),
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
    typed = [word for name, value in values.items() for word in (option(name), str(value))]
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
        ("8:", "--frames 8: reaches beyond the end"),
        ("0:99", "--frames 0:99 reaches beyond the end"),
    ],
)
def test_frames_that_are_not_there_are_told_with_how_many_there_are_and_what_to_give(
    asked: str, said: str, tmp_path: Path, short: Path, capsys
) -> None:
    sentence = refused(["track", str(short), "--out", str(tmp_path / "out"), f"--frames={asked}", "--quiet"], capsys)
    assert said in sentence
    assert "8 frames, 0 to 7, so give " in sentence


def test_a_value_that_looks_like_an_option_is_told_how_to_be_given(tmp_path: Path, short: Path, capsys) -> None:
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
        (["--fps", "1000", "--mm-per-px", "1", "--window", "9"], "--window, as the method smoother has neither"),
        (["--fps", "1000", "--mm-per-px", "1", "--normal-deg", "9"], "--normal-deg, as no impact is reported"),
        (["--fps", "1000", "--mm-per-px", "1", "--method", "savitzky-golay", "--window", "5"], ""),
        (["--fps", "1000", "--mm-per-px", "1", "--lab-frame"], ""),
    ],
)
def test_an_option_that_does_not_come_to_use_is_noted(
    given: list[str], noted: str, tmp_path: Path, short: Path, capsys
) -> None:
    out = tmp_path / "result"
    arguments = ["track", str(short), "--out", str(out), "--circle", CIRCLE, "--frames", "0:6", "--no-report", *given]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    warnings = json.loads((out / "summary.json").read_text())["warnings"]
    found = [sentence for sentence in warnings if sentence.startswith("Given and not used: ")]
    assert len(found) == (1 if noted else 0)
    assert all(noted in sentence and f"note    {sentence}" in printed for sentence in found)
