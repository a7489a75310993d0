"""The command ``torchsphere batch``: output, exit code, and refusals in one sentence."""

import csv
import errno
import json
import os
import sys
from pathlib import Path
from typing import Any

import pytest
from archive_shots import BAD, pretended, serial, write_array, write_recording

from torchsphere.archive import processes
from torchsphere.archive.run import Counts, Interrupted
from torchsphere.archive.work import run_job
from torchsphere.cli import batch
from torchsphere.cli.main import main

TRACKED = ["--circle", "22,32.3,12", "--map", "off", "--fps", "1000", "--diameter-mm", "30"]


@pytest.fixture
def shots(tmp_path: Path) -> Path:
    """Two recordings of which the second is bad."""
    write_array(tmp_path / "shots" / "a.npy", 1)
    write_array(tmp_path / "shots" / "b.npy", BAD)
    return tmp_path / "shots"


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the worker processes by a pretended measurement in this process."""
    monkeypatch.setattr(processes, "run", lambda jobs, **_: serial(jobs))


def rows(out: Path) -> list[dict[str, str]]:
    with (out / "summary.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_a_folder_is_measured_with_the_settings_of_track(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_recording(tmp_path / "in" / "day" / "shot.tif", 0)
    out = tmp_path / "out"
    assert main(["batch", str(tmp_path / "in"), "--out", str(out), "--workers", "1", *TRACKED]) == 0
    printed = capsys.readouterr()
    assert printed.out == f"1 of 1 recordings done, 0 failed (1 measured in this run); see {out / 'summary.csv'}\n"
    assert "0 failed" in printed.err
    summary = json.loads((out / "day" / "shot" / "summary.json").read_text())
    (row,) = rows(out)
    assert (row["recording"], row["state"], row["result"]) == ("day/shot.tif", "done", "day/shot")
    assert (row["frames"], row["ok"]) == ("5", "5")
    # One pixel of 15 mm / 12 px per frame of 1 ms.
    assert float(row["mean_speed_m_s"]) == pytest.approx(1.25, abs=0.05)
    assert summary["settings"]["circle"] == [22, 32.3, 12]
    assert int(row["warnings"]) == len(summary["warnings"])


def test_quantities_outside_the_model_are_empty_in_the_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # By this process: the test above has a worker.
    monkeypatch.setattr(processes, "run", lambda jobs, workers, measure: (run_job(job, measure) for job in jobs))
    write_recording(tmp_path / "in" / "shot.tif", 0)
    out = tmp_path / "out"
    options = ["--out", str(out), "--workers", "1", *TRACKED, "--model", "translation"]
    assert main(["batch", str(tmp_path / "in"), *options]) == 0
    (row,) = rows(out)
    assert (row["state"], row["frames"], row["ok"], row["mean_spin_rad_s"]) == ("done", "5", "0", "")
    # The model takes the turn of the ball for a part of the step of 1.25 m/s.
    assert float(row["mean_speed_m_s"]) == pytest.approx(1.25, abs=0.15)


@pytest.mark.usefixtures("here")
def test_the_exit_code_distinguishes_failures_and_the_table_has_the_reasons(
    shots: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["batch", str(shots), "--out", str(out)]) == batch.SOME_FAILED
    assert capsys.readouterr().out.startswith("1 of 2 recordings done, 1 failed (2 measured in this run)")
    assert rows(out)[1]["reason"].endswith("is bad")
    # A run without new recordings is no success while a failure stays.
    assert main(["batch", str(shots), "--out", str(out)]) == batch.SOME_FAILED
    assert capsys.readouterr().out.startswith("1 of 2 recordings done, 1 failed (0 measured in this run)")
    assert main(["batch", str(shots), "--out", str(out), "--retry-failed", "--quiet"]) == batch.SOME_FAILED
    write_array(shots / "b.npy", 2)
    assert main(["batch", str(shots), "--out", str(out), "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.usefixtures("here")
def test_the_closing_sentences_name_some_failures_and_the_file_with_all(
    shots: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["batch", str(shots), "--out", str(out)]) == batch.SOME_FAILED
    _, *told, incomplete = capsys.readouterr().out.splitlines()
    assert len(told) == 1
    assert told[0].startswith("failed  b.npy: ")
    assert told[0].endswith("is bad")
    assert incomplete.startswith("1 of those that are done: without a frame rate and a scale there are no speeds")
    for k in range(6):
        write_array(shots / f"c{k}.npy", BAD)
    assert main(["batch", str(shots), "--out", str(out)]) == batch.SOME_FAILED
    first, *told, last, _ = capsys.readouterr().out.splitlines()
    assert first.startswith("1 of 8 recordings done, 7 failed")
    # The failure of the earlier run is counted and named, too.
    assert [line.split(":")[0].split()[1] for line in told] == ["b.npy", "c0.npy", "c1.npy", "c2.npy", "c3.npy"]
    assert last == f"and 2 more; their reasons stand in {out / 'summary.csv'}"


@pytest.mark.usefixtures("here")
def test_severe_warnings_and_a_missing_scale_of_what_is_done_are_told(
    shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for k in range(6):
        write_array(shots / f"c{k}.npy", 3)
    monkeypatch.setattr("archive_shots.SEVERE", {"a": 3, **{f"c{k}": 1 for k in range(5)}})
    out = tmp_path / "out"
    assert main(["batch", str(shots), "--out", str(out), "--fps", "50"]) == batch.SOME_FAILED
    first, _, *told, more, incomplete = capsys.readouterr().out.splitlines()
    assert first.startswith("7 of 8 recordings done (6 of them with severe warnings), 1 failed (8 measured")
    assert told[0] == f"done, 3 severe  a.npy: numbers of it may be wrong; see the report in {out / 'a'}"
    assert [line.partition("  ")[0] for line in told] == ["done, 3 severe", *["done, 1 severe"] * 4]
    assert more == f"and 1 more; see the column severe_warnings of {out / 'summary.csv'}"
    sentence = "without a scale there are no speeds and no forces; give --diameter-mm or --mm-per-px"
    assert incomplete == f"7 of those that are done: {sentence}"
    table = {row["recording"]: row for row in rows(out)}
    assert {row["state"] for row in table.values()} == {"done", "failed"}
    assert (table["a.npy"]["severe_warnings"], table["c5.npy"]["severe_warnings"]) == ("3", "0")
    assert table["a.npy"]["reason"] == sentence
    assert "8 recordings: 7 done (6 of them with severe warnings), 1 failed." in (out / "index.html").read_text()


@pytest.mark.usefixtures("here")
def test_a_result_with_rate_and_scale_lacks_nothing(shots: Path, tmp_path: Path, capsys) -> None:
    (shots / "b.npy").unlink()
    scale = ["--fps", "50", "--diameter-mm", "30"]
    assert main(["batch", str(shots), "--out", str(tmp_path / "out"), *scale]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 1
    assert rows(tmp_path / "out")[0]["reason"] == ""


@pytest.mark.usefixtures("here")
def test_the_command_line_wins_over_the_config_and_a_recording_over_both(shots: Path, tmp_path: Path) -> None:
    (shots / "list.csv").write_text("recording,fps\na.npy,\nc.npy,300\n")
    write_array(shots / "c.npy", 3)
    config = tmp_path / "common.toml"
    config.write_text("fps = 100\nmm-per-px = 0.5\n")
    out = tmp_path / "out"
    arguments = ["batch", str(shots / "list.csv"), "--out", str(out), "--config", str(config), "--quiet"]
    assert main(arguments) == 0
    assert [row["frame_rate"] for row in rows(out)] == ["100", "300"]
    assert main([*arguments, "--fps", "200", "--diameter-mm", "30"]) == 0
    assert [row["frame_rate"] for row in rows(out)] == ["200", "300"]


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Give the settings of each recording that the pretended measurement gets."""
    settings: list[dict[str, Any]] = []

    def engine(jobs: Any, **_: Any) -> Any:
        for job in jobs:
            settings.append(dict(job.item.settings))
            yield run_job(job, pretended)

    monkeypatch.setattr(processes, "run", engine)
    return settings


def test_switches_change_the_defaults_of_settings(shots: Path, tmp_path: Path, seen: list[dict[str, Any]]) -> None:
    main(["batch", str(shots / ".."), "--out", str(tmp_path / "out"), "--quiet", "--lab-frame", "--no-report"])
    assert seen == [{"lab_frame": True, "report": False}] * 2


def test_the_option_ignore_may_be_repeated(shots: Path, tmp_path: Path, seen: list[dict[str, Any]]) -> None:
    regions = ["0,0 9,0 9,9", "20,20 30,20 30,30"]
    ignored = [word for region in regions for word in ("--ignore", region)]
    main(["batch", str(shots), "--out", str(tmp_path / "out"), "--quiet", *ignored])
    assert seen == [{"ignore": regions}] * 2


@pytest.mark.usefixtures("here")
def test_a_shard_measures_its_part_and_leaves_the_rest_pending(shots: Path, tmp_path: Path) -> None:
    for k in range(6):
        write_array(shots / f"c{k}.npy", 3)
    out = tmp_path / "out"
    main(["batch", str(shots), "--out", str(out), "--shard", "1/2", "--quiet"])
    states = [row["state"] for row in rows(out)]
    assert 0 < states.count("pending") < 8
    main(["batch", str(shots), "--out", str(out), "--shard", "2/2", "--quiet"])
    assert [row["state"] for row in rows(out)] == ["done", "failed", *["done"] * 6]


def test_ctrl_c_prints_the_finished_recordings(
    shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: Any, **__: Any) -> None:
        raise Interrupted(Counts(done=1, failed=0, pending=1, measured=1))

    monkeypatch.setattr("torchsphere.archive.run.run", interrupted)
    assert main(["batch", str(shots), "--out", str(tmp_path / "out")]) == 130
    assert capsys.readouterr().out == (
        "interrupted; 1 of 2 recordings done, 0 failed, 1 pending (1 measured in this run); the same command goes on\n"
    )


@pytest.mark.usefixtures("here")
def test_ignored_images_of_a_folder_are_noted(shots: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (shots / "photo.png").touch()
    main(["batch", str(shots), "--out", str(tmp_path / "out")])
    assert "1 single image(s) were left out" in capsys.readouterr().err


@pytest.mark.usefixtures("here")
def test_a_file_system_without_locks_is_noted_and_the_run_goes_on(
    shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: int) -> None:
        raise OSError(errno.ENOSYS, "Function not implemented")

    monkeypatch.setattr("torchsphere.archive.claims._set", refuse)
    out = tmp_path / "out"
    assert main(["batch", str(shots), "--out", str(out)]) == batch.SOME_FAILED
    printed = capsys.readouterr()
    assert f"torchsphere: {out}: its file system has no locks, so two runs at once would" in printed.err
    assert printed.out.startswith("1 of 2 recordings done, 1 failed (2 measured in this run)")


REFUSED = {
    "nowhere": ["nowhere"],
    "no archive": ["thesis/chapter.txt"],
    "empty folder": ["void"],
    "unknown column": ["sheet.csv"],
    "no such config": ["shots", "--config", "no.toml"],
    "config of unknown": ["shots", "--config", "bad.toml"],
    "mass without scale": ["shots", "--mass-g", "110"],
    "unknown model": ["shots", "--model", "wobbly"],
    "no number": ["shots", "--fps", "fast"],
    "no workers": ["shots", "--workers", "0"],
    "workers in words": ["shots", "--workers", "two"],
    "shard beyond": ["shots", "--shard", "3/2"],
    "shard of zero": ["shots", "--shard", "0/2"],
    "shard in words": ["shots", "--shard", "half"],
    "two engines": ["shots", "--scheduler", "tcp://h:1", "--workers", "2"],
    "other files": ["shots", "--out", "thesis"],
    "a file": ["shots", "--out", "thesis/chapter.txt"],
    "the recordings' folder": ["shots", "--out", "shots"],
    "unknown option": ["shots", "--colour", "red"],
}


@pytest.mark.parametrize("case", REFUSED)
def test_invalid_input_is_refused_in_one_sentence(
    case: str, shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in (("sheet.csv", "recording,speed\na,5\n"), ("bad.toml", "speed = 3"), ("thesis/chapter.txt", "x")):
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(text)
    Path("void").mkdir()
    before = sorted(tmp_path.rglob("*"))
    try:
        code = main(["batch", *REFUSED[case], *([] if "--out" in REFUSED[case] else ["--out", "out"])])
    except SystemExit as stop:
        code = int(stop.code or 0)
    printed = capsys.readouterr()
    assert code in (1, 2)
    assert printed.out == ""
    assert printed.err.startswith("torchsphere: ")
    assert printed.err.count("\n") == 1
    assert "Traceback" not in printed.err
    assert sorted(tmp_path.rglob("*")) == before


def test_a_missing_dask_is_named_with_its_extra(
    shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["batch", str(shots), "--out", str(tmp_path / "out"), "--scheduler", "tcp://h:1", "--quiet"]) == 1
    assert "pip install 'torchsphere[dask]'" in capsys.readouterr().err


def test_a_missing_gpu_fails_the_run_and_no_recording(
    shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("torch.cuda.device_count", lambda: 0)
    assert main(["batch", str(shots), "--out", str(tmp_path / "out"), "--device", "cuda"]) == 1
    assert "--device cuda was asked for, but torch finds no CUDA device" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_there_is_a_worker_for_each_available_core_or_gpu(
    shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[int] = []

    def engine(jobs: Any, workers: int, measure: Any) -> Any:
        seen.append(workers)
        return serial(jobs)

    monkeypatch.setattr(processes, "run", engine)
    main(["batch", str(shots), "--out", str(tmp_path / "out"), "--quiet"])
    monkeypatch.setattr("torch.cuda.device_count", lambda: 3)
    main(["batch", str(shots), "--out", str(tmp_path / "gpu"), "--quiet", "--device", "cuda"])
    main(["batch", str(shots), "--out", str(tmp_path / "five"), "--quiet", "--workers", "5"])
    assert seen == [len(os.sched_getaffinity(0)), 3, 5]
