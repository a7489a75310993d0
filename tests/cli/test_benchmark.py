"""The commands ``torchsphere benchmark run``, ``score`` and ``table``: their files and refusals."""

import csv
import shutil
import subprocess
from pathlib import Path

import pytest
from benchmark_folder import FRAMES, SUITES, write_benchmark
from rendering import needs_mitsuba

from torchsphere.benchmark import folder, make, predictions, trackers
from torchsphere.benchmark.leaderboard import OWN
from torchsphere.benchmark.run import run
from torchsphere.cli.benchmark import SOME_FAILED
from torchsphere.cli.main import main

TOY = Path(__file__).parents[1] / "toy_tracker.sh"


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a benchmark of two small suites."""
    return write_benchmark(tmp_path_factory.mktemp("bench"))


def scores(path: Path) -> dict[tuple[str, str], dict[str, str]]:
    with path.open(newline="") as stream:
        return {(row["tracker"], row["suite"]): row for row in csv.DictReader(stream)}


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The sentence that a refused command prints."""
    assert main(["benchmark", *map(str, arguments)]) == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    sentence = printed.err.splitlines()[-1].rsplit("\r", 1)[-1]
    assert sentence.startswith("torchsphere: ")
    return sentence


def toy(bench: Path, out: Path) -> Path:
    """Write predictions of the tracker in shell and awk."""
    out.mkdir()
    for suite in SUITES:
        done = subprocess.run(["sh", TOY, bench, suite], capture_output=True, text=True, check=True)
        (out / f"{suite}.csv").write_text(done.stdout)
    return out


def test_torchsphere_and_a_baseline_are_run_scored_and_printed(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert (
        main(["benchmark", "run", str(bench), "--tracker", "torchsphere", "--tracker", "edge_fit", "--out", str(out)])
        == 0
    )
    printed = capsys.readouterr()
    assert "| torchsphere | " in printed.out
    assert "4 run, 0 kept from before, 0 failed" in printed.out
    found = scores(out / "scores.csv")
    assert set(found) == {(tracker, suite) for tracker in ("torchsphere", "edge_fit") for suite in SUITES}
    for suite in SUITES:
        own, rival = found["torchsphere", suite], found["edge_fit", suite]
        # R = 16 px, noise of one grey level: 0.02 px and 0.1 deg.
        assert float(own["step_px"]) < 0.05
        assert float(own["step_deg"]) < 0.3
        assert (own["rotation"], rival["rotation"]) == ("measured", "not measured")
        assert float(own["lost_percent"]) == float(own["silent_percent"]) == 0
        assert 0.5 < float(own["sd_ratio_px"]) < 2
        assert rival["sd_ratio_px"] == ""
        assert float(own["ms_per_pair"]) > 0
        assert float(rival["step_deg"]) == 10


@needs_mitsuba
def test_a_smoke_benchmark_is_made_run_and_scored(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # The cheapest suites with a pattern, without a pattern, and with frames without a ball.
    suites = [word for name in ("small-ball-20", "no-speckle", "leaving-the-frame") for word in ("--suite", name)]
    bench, out = tmp_path / "bench", tmp_path / "out"
    assert main(["benchmark", "make", "--out", str(bench), "--size", "smoke", "--workers", "1", *suites]) == 0
    assert capsys.readouterr().out.startswith("3 suites of size smoke, sha256:")
    assert "--overwrite to replace it" in refused(capsys, "make", "--out", bench, "--size", "smoke")
    assert main(["benchmark", "run", str(bench), "--out", str(out), "--quiet"]) == 0
    found = {suite: row for (_, suite), row in scores(out / "scores.csv").items()}
    # R = 20 px and the noise of a camera: measured 0.024 px and 0.09 deg.
    assert float(found["small-ball-20"]["step_px"]) < 0.1
    assert float(found["small-ball-20"]["step_deg"]) < 0.4
    assert float(found["leaving-the-frame"]["gone_noticed_percent"]) == 100
    assert found["no-speckle"]["rotation"] == "not to be seen"
    assert all(float(row["silent_percent"]) == 0 for row in found.values())


def test_without_the_renderer_make_names_the_package_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(make.importlib.util, "find_spec", lambda name: None)
    assert "pip install 'torchsphere[render]'" in refused(capsys, "make", "--out", tmp_path / "bench")
    assert not (tmp_path / "bench").exists()


def test_every_named_tracker_can_be_resolved() -> None:
    assert [trackers.resolve(name).name for name in trackers.names()] == list(trackers.names())
    assert all(trackers.resolve(name).settings for name in trackers.names())


def test_torchsphere_uses_the_camera_of_a_suite(bench: Path) -> None:
    suite = folder.read_benchmark(bench).suite("plain")
    images = folder.read_footage(suite).images[:3]
    # For a ball at 40 radii, the rotation is smaller than the apparent rotation by about dx / distance.
    camera = folder.Camera(focal_px=640.0)
    told, _ = trackers.resolve("torchsphere").run(trackers.Task(images, suite.circle, camera))
    untold, _ = trackers.resolve("torchsphere-no-camera").run(trackers.Task(images, suite.circle, camera))
    assert told["wy_rad"][1] - untold["wy_rad"][1] == pytest.approx(3.2 / 640, abs=2e-3)


def test_a_tracker_in_shell_and_awk_is_scored(bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = toy(bench, tmp_path / "toy")
    out = tmp_path / "scores" / "toy.csv"
    assert main(["benchmark", "score", str(bench), str(made), "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert "| toy | " in printed.out
    assert printed.err == ""
    for suite in SUITES:
        row = scores(out)["toy", suite]
        # The middle of a bounding box of whole pixels, whose edge is speckle.
        assert 0.05 < float(row["place_px"]) < 0.8
        assert (row["rotation"], float(row["lost_percent"]), float(row["orientation_deg"])) == ("not measured", 0, 10)


def test_scores_of_two_commands_join_into_one_leaderboard(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    a, b, board = tmp_path / "a.csv", tmp_path / "b.csv", tmp_path / "docs" / "LEADERBOARD.md"
    made = toy(bench, tmp_path / "toy")
    for out, name in ((a, "first"), (b, "second")):
        assert main(["benchmark", "score", str(bench), str(made), "--name", name, "--out", str(out), "--quiet"]) == 0
    assert main(["benchmark", "table", str(a), str(b), "--out", str(board)]) == 0
    assert capsys.readouterr() == ("", "")
    assert "| suite | first | second |" in board.read_text()
    assert main(["benchmark", "table", str(a)]) == 0
    assert capsys.readouterr().out.startswith("# Leaderboard\n")
    assert "'first' is there twice" in refused(capsys, "table", a, a)


def test_a_users_function_is_run_from_its_module(bench: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["benchmark", "run", str(bench), "--tracker", "user_tracker:still", "--out", str(out), "--quiet"]) == 0
    row = scores(out / "scores.csv")["user_tracker:still", "plain"]
    assert (out / "user_tracker-still" / "plain.csv").is_file()
    assert float(row["lost_percent"]) == pytest.approx(100 * (FRAMES - 3) / (FRAMES - 1), rel=1e-4)
    # Frames 1 and 2 are not doubted and wrong by more than a px.
    assert float(row["silent_percent"]) == pytest.approx(100 * 2 / (FRAMES - 1), rel=1e-4)


def test_scores_of_an_earlier_run_on_the_same_images_are_kept(bench: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = ["benchmark", "run", str(bench), "--out", str(out), "--quiet"]
    assert main([*arguments, "--tracker", "edge_fit"]) == 0
    before = scores(out / "scores.csv")
    assert main([*arguments, "--tracker", "user_tracker:still", "--suite", "plain"]) == 0
    after = scores(out / "scores.csv")
    assert {key: after[key] for key in before} == before
    assert set(after) - set(before) == {("user_tracker:still", "plain")}
    # Scores on other images or of another version are not kept.
    text = (out / "scores.csv").read_text()
    (out / "scores.csv").write_text(text.replace("edge_fit,plain,sha256:", "edge_fit,plain,sha256:0"))
    assert main([*arguments, "--tracker", "user_tracker:still", "--suite", "plain"]) == 0
    assert set(scores(out / "scores.csv")) == set(after) - {("edge_fit", "plain")}
    (out / "scores.csv").write_text("tracker,suite\na,b\n")
    assert main([*arguments, "--tracker", "user_tracker:still", "--suite", "plain"]) == 0
    assert set(scores(out / "scores.csv")) == {("user_tracker:still", "plain")}


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("user_tracker:short", f"returned 'x_px' of shape ({FRAMES - 1},); expected ({FRAMES},), one per frame"),
        ("user_tracker:long_quaternions", "qw, qx, qy, qz have the length 4 in frame 0"),
    ],
)
def test_a_tracker_with_an_invalid_result_has_failed(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, sentence: str
) -> None:
    arguments = ["benchmark", "run", str(bench), "--tracker", name, "--suite", "plain", "--out", str(tmp_path)]
    assert main([*arguments, "--quiet"]) == SOME_FAILED
    assert sentence in capsys.readouterr().err
    assert float(scores(tmp_path / "scores.csv")[name, "plain"]["points_percent"]) == 100


def test_a_tracker_that_fails_on_one_suite_is_lost_there_and_scored_on_the_others(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = "user_tracker:raises"
    assert main(["benchmark", "run", str(bench), "--tracker", name, "--out", str(tmp_path), "--quiet"]) == SOME_FAILED
    assert f"{name} failed on fast-flight: RuntimeError: no ball in (8, 64, 112)" in capsys.readouterr().err
    found = scores(tmp_path / "scores.csv")
    assert float(found[name, "fast-flight"]["lost_percent"]) == 100
    assert "the tracker failed: RuntimeError" in found[name, "fast-flight"]["notes"]
    assert float(found[name, "plain"]["lost_percent"]) < 100


def test_a_tracker_that_ends_the_program_has_failed_and_the_others_are_run(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["--tracker", "user_tracker:exits", "--tracker", "user_tracker:still"]
    assert main(["benchmark", "run", str(bench), *asked, "--out", str(tmp_path), "--quiet"]) == SOME_FAILED
    said = capsys.readouterr().err
    assert "user_tracker:exits failed on fast-flight: RuntimeError: user_tracker:exits ended the program" in said
    assert "(SystemExit: 0)" in said
    assert "(SystemExit: no licence)" in said
    found = scores(tmp_path / "scores.csv")
    assert float(found["user_tracker:exits", "plain"]["lost_percent"]) == 100
    assert float(found["user_tracker:still", "plain"]["lost_percent"]) < 100


def test_a_request_to_end_is_no_failure_of_the_tracker(bench: Path, tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["benchmark", "run", str(bench), "--tracker", "user_tracker:ended", "--out", str(tmp_path), "--quiet"])
    assert stop.value.code == 143
    assert not (tmp_path / "scores.csv").exists()


@pytest.mark.parametrize("text", ["import sys\nsys.exit('no arguments')\n", "def tracker(:\n", "1 / 0\n"])
def test_a_module_that_cannot_be_imported_is_refused_with_its_reason(
    text: str, bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "unfinished_tracker.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    sentence = refused(capsys, "run", bench, "--tracker", "unfinished_tracker:tracker", "--out", tmp_path / "out")
    assert "importing unfinished_tracker failed (" in sentence


def test_scores_are_written_whole_or_not_at_all(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ["benchmark", "run", str(bench), "--tracker", "user_tracker:still", "--out", str(tmp_path), "--quiet"]
    assert main(arguments) == 0
    before = (tmp_path / "scores.csv").read_text()

    class Full:
        """A disk that is full after the first row of the table."""

        def __init__(self, *_: object, **__: object) -> None:
            pass

        def writerow(self, row: object) -> None:
            if not isinstance(row, tuple) or row[0] != "tracker":
                raise OSError(28, "No space left on device", "scores.csv")

    monkeypatch.setattr("torchsphere.benchmark.score_rows.csv.writer", Full)
    monkeypatch.setattr("torchsphere.benchmark.run.run", lambda *_, **__: [])
    assert main(arguments) == 1
    assert "no space left" in capsys.readouterr().err
    assert (tmp_path / "scores.csv").read_text() == before


def test_a_leaderboard_is_written_whole_or_not_at_all(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    made, out, board = toy(bench, tmp_path / "toy"), tmp_path / "a.csv", tmp_path / "LEADERBOARD.md"
    assert main(["benchmark", "score", str(bench), str(made), "--out", str(out), "--quiet"]) == 0
    board.write_text("an earlier one")

    def stop(self: Path, target: Path) -> Path:
        """Fail before the file has its final name, as after a kill or on a full disk."""
        raise OSError(28, "No space left on device", str(target))

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", stop)
        assert "no space left" in refused(capsys, "table", out, "--out", board)
    assert board.read_text() == "an earlier one"
    assert not list(tmp_path.glob(".*"))
    # The message names the folder as given, and no temporary file is left.
    assert f"{made}: is a directory" in refused(capsys, "table", out, "--out", made)
    assert f"{made}: is a directory" in refused(capsys, "score", bench, made, "--out", made)
    assert not list(tmp_path.glob(".*"))
    assert main(["benchmark", "table", str(out), "--out", str(board)]) == 0
    assert board.read_text().startswith("# Leaderboard\n")


def test_keep_runs_only_trackers_without_valid_predictions_of_these_images(bench: Path, tmp_path: Path) -> None:
    made, entry = folder.read_benchmark(bench), trackers.resolve("user_tracker:raises")
    assert [outcome.kept for outcome in run(made, [entry], tmp_path)] == [False, False]
    assert [outcome.kept for outcome in run(made, [entry], tmp_path, keep=True)] == [True, False]
    path = tmp_path / "user_tracker-raises" / "plain.csv"
    path.write_text(path.read_text().replace("# checksum: sha256:", "# checksum: sha256:0"))
    assert [outcome.kept for outcome in run(made, [entry], tmp_path, keep=True)] == [False, False]
    assert [outcome.kept for outcome in run(made, [entry], tmp_path)] == [False, False]


def test_ctrl_c_keeps_the_predictions_and_says_so(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["benchmark", "run", str(bench), "--tracker", "user_tracker:still", "--tracker", "user_tracker:stopped"]
    assert main([*arguments, "--out", str(tmp_path), "--quiet"]) == 130
    assert "the same command with --keep goes on" in capsys.readouterr().err
    assert (tmp_path / "user_tracker-still" / "plain.csv").is_file()
    assert not (tmp_path / "scores.csv").exists()


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("torchspere", "no tracker is called 'torchspere'; expected one of torchsphere, "),
        ("no_such_module:f", "No module named 'no_such_module'"),
        ("user_tracker:nothing", "user_tracker has no function 'nothing'"),
        ("user_tracker:not_a_function", "user_tracker has no function 'not_a_function'"),
    ],
)
def test_an_unknown_tracker_is_refused_before_any_run(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, sentence: str
) -> None:
    assert sentence in refused(capsys, "run", bench, "--tracker", name, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_predictions_of_another_suite_are_refused(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = toy(bench, tmp_path / "toy")
    shutil.copy(made / "plain.csv", made / "fast-flight.csv")
    assert "of suite 'plain', not 'fast-flight'" in refused(capsys, "score", bench, made)
    # Without the line "# suite", the position in frame 0 shows the other suite.
    (made / "fast-flight.csv").write_text("frame,x_px,y_px\n0,28.0,30.5\n")
    assert "another suite's file" in refused(capsys, "score", bench, made)


def test_predictions_for_an_earlier_benchmark_are_refused(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = toy(bench, tmp_path / "toy")
    text = (made / "plain.csv").read_text()
    (made / "plain.csv").write_text(text.replace("sha256:", "sha256:f00"))
    assert "was made from other images of suite 'plain'" in refused(capsys, "score", bench, made)


def test_a_suite_without_a_file_is_lost_and_one_file_can_be_scored_alone(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made, out = toy(bench, tmp_path / "toy"), tmp_path / "s.csv"
    (made / "fast-flight.csv").unlink()
    assert main(["benchmark", "score", str(bench), str(made), "--out", str(out)]) == 0
    assert "There is no fast-flight.csv: every frame counts as lost." in capsys.readouterr().err
    assert float(scores(out)["toy", "fast-flight"]["points_percent"]) == 100
    renamed = (made / "plain.csv").rename(tmp_path / "mine.csv")
    assert main(["benchmark", "score", str(bench), str(renamed), "--suite", "plain", "--out", str(out)]) == 0
    assert set(scores(out)) == {("mine", "plain")}
    capsys.readouterr()
    assert "has no suite 'mine'" in refused(capsys, "score", bench, renamed)
    assert "holds no predictions" in refused(capsys, "score", bench, made)
    assert "elsewhere.csv: does not exist" in refused(capsys, "score", bench, tmp_path / "elsewhere.csv")


def test_changed_images_are_refused_by_run_and_score(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changed = shutil.copytree(bench, tmp_path / "changed")
    path = changed / "plain" / "frames.tif"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    assert "make the benchmark again" in refused(capsys, "run", changed, "--out", tmp_path / "out")
    assert "make the benchmark again" in refused(capsys, "score", changed, toy(bench, tmp_path / "toy"))


def test_a_folder_without_a_benchmark_and_an_unknown_suite_are_refused(
    bench: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "is no benchmark" in refused(capsys, "run", tmp_path, "--out", tmp_path / "out")
    assert "has no suite 'plan'" in refused(capsys, "run", bench, "--suite", "plan", "--out", tmp_path / "out")


def test_score_reads_the_files_that_run_writes(bench: Path, tmp_path: Path) -> None:
    suite = folder.read_benchmark(bench).suite("plain")
    main(["benchmark", "run", str(bench), "--suite", "plain", "--out", str(tmp_path), "--quiet"])
    prediction = predictions.read(tmp_path / OWN / "plain.csv", suite)
    assert prediction.notes == ()
    again = tmp_path / "again.csv"
    assert (
        main(
            ["benchmark", "score", str(bench), str(tmp_path / OWN), "--suite", "plain", "--out", str(again), "--quiet"]
        )
        == 0
    )
    assert again.read_text() == (tmp_path / "scores.csv").read_text()
