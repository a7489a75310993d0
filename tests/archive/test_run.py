"""A run over an archive in one process: the choice of recordings to measure, and the table."""

import errno
import math
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from archive_shots import BAD, calls, pretended, rows, serial, write_array
from scipy.io import loadmat

from torchsphere.archive import manifest, records, summary
from torchsphere.archive.run import Counts, in_shard, run
from torchsphere.archive.work import Job, Outcome, run_job


@pytest.fixture
def shots(tmp_path: Path) -> Path:
    """Three recordings that the pretended measurement accepts, and one that it refuses."""
    source = tmp_path / "shots"
    for name, level in (("a.npy", 1), ("b.npy", 2), ("deep/c.npy", 3), ("d.npy", BAD)):
        write_array(source / name, level)
    return source


def again(source: Path, out: Path, common: dict[str, Any] | None = None, **options: Any) -> Counts:
    return run(manifest.read(source, common or {}, out), out, serial, **options)


def test_every_recording_has_a_folder_that_mirrors_its_path_and_a_row_of_the_table(shots: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert again(shots, out, {"fps": 50.0}) == Counts(done=3, failed=1, pending=0, measured=4)
    assert sorted(p.parent.relative_to(out).as_posix() for p in out.rglob("summary.json")) == ["a", "b", "deep/c"]
    table = rows(out)
    assert [row["state"] for row in table.values()] == ["done", "done", "failed", "done"]
    assert list(table) == ["a.npy", "b.npy", "d.npy", "deep/c.npy"]
    assert table["d.npy"]["reason"] == f"{shots / 'd.npy'}: is bad"
    assert (table["a.npy"]["frames"], table["a.npy"]["ok"], table["a.npy"]["frame_rate"]) == ("3", "3", "50")
    assert table["d.npy"]["frames"] == ""
    assert "<title>" in (out / "index.html").read_text()
    parquet = pq.read_table(out / "summary.parquet").to_pylist()
    assert [row["recording"] for row in parquet] == list(table)
    assert [row["state"] for row in parquet] == ["done", "done", "failed", "done"]
    assert [row["frames"] for row in parquet] == [3, 3, None, 3]


def test_the_table_is_exported_with_its_units_where_a_recording_asks_for_it(shots: Path, tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py", reason="h5py is not installed (extra 'export')")
    out = tmp_path / "out"
    again(shots, out, {"fps": 50.0, "export": ["hdf5", "mat"]})
    table = rows(out)
    struct = loadmat(out / "summary.mat", simplify_cells=True)["recordings"]
    with h5py.File(out / "summary.h5") as file:
        group = file["recordings"]
        assert list(group.attrs["columns"]) == list(summary.COLUMNS)
        for name, unit in (("frame_rate", "1/s"), ("mean_speed_m_s", "m/s"), ("radius_px", "px")):
            assert group[name].attrs["unit"] == struct["units"][name] == unit
        assert [text.decode() for text in group["recording"][()]] == list(struct["recording"]) == list(table)
        for frames in (group["frames"][()], struct["frames"]):
            assert [number for number in frames if not math.isnan(number)] == [3, 3, 3]
    # A run without exports leaves no trace of them.
    again(shots, tmp_path / "plain")
    assert not list((tmp_path / "plain").glob("summary.[hm]*"))


def test_a_recording_without_a_usable_result_is_counted_apart_and_not_measured_again(
    shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    monkeypatch.setattr("archive_shots.UNUSABLE", {"b": "nothing usable was measured"})
    counts = again(shots, out)
    assert counts == Counts(done=2, unusable=1, failed=1, pending=0, measured=4)
    assert counts.total == 4
    assert counts.without_motion == (("b.npy", "nothing usable was measured"),)
    assert (rows(out)["b.npy"]["state"], rows(out)["b.npy"]["reason"]) == ("unusable", "nothing usable was measured")
    assert "2 done, 1 unusable, 1 failed" in (out / "index.html").read_text()
    # The result is there: the same settings would give the same one.
    assert again(shots, out) == Counts(done=2, unusable=1, failed=1, pending=0, measured=0)
    assert again(shots, out, retry_failed=True) == Counts(done=2, unusable=1, failed=1, pending=0, measured=1)


def test_the_page_grows_while_the_run_goes_on(shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("torchsphere.archive.run.EVERY_S", 0.0)
    monkeypatch.setattr("torchsphere.archive.run.WRITING_TIMES", 0.0)
    out = tmp_path / "out"
    seen = []

    def engine(jobs: Iterator[Job]) -> Iterator[Outcome]:
        for job in jobs:
            seen.append((out / "index.html").read_text())
            yield run_job(job, pretended)

    run(manifest.read(shots, {}, out), out, engine)
    counts = ["4 pending", "1 done, 3 pending", "2 done, 2 pending", "2 done, 1 failed, 1 pending"]
    for text, page in zip(counts, seen, strict=True):
        assert f"4 recordings: {text}. The run goes on" in page
    assert "4 recordings: 3 done, 1 failed.<" in (out / "index.html").read_text()


def test_the_page_is_not_written_again_for_each_recording(
    shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = []
    monkeypatch.setattr("torchsphere.report.pages.write_index", lambda *_, **about: written.append(about))
    again(shots, tmp_path / "out")
    assert written == [{"is_growing": True}, {"is_growing": False}]


def test_a_second_run_measures_nothing(shots: Path, tmp_path: Path) -> None:
    again(shots, tmp_path / "out")
    assert again(shots, tmp_path / "out") == Counts(done=3, failed=1, pending=0, measured=0)
    assert calls(shots) == ["a", "b", "c"]


def test_only_new_or_changed_recordings_are_measured(shots: Path, tmp_path: Path) -> None:
    again(shots, tmp_path / "out")
    write_array(shots / "b.npy", 7)
    write_array(shots / "e.npy", 5)
    assert again(shots, tmp_path / "out") == Counts(done=4, failed=1, pending=0, measured=2)
    assert calls(shots) == ["a", "b", "b", "c", "e"]


def test_a_touched_file_of_the_same_contents_is_not_measured_again(shots: Path, tmp_path: Path) -> None:
    again(shots, tmp_path / "out")
    os.utime(shots / "a.npy", ns=(1, 1))
    assert again(shots, tmp_path / "out").done == 3
    # The record has the new time, so a third run does not read the contents.
    key = records.read(tmp_path / "out", "a")
    assert again(shots, tmp_path / "out").done == 3
    assert records.read(tmp_path / "out", "a") == key
    assert calls(shots).count("a") == 1


def test_recordings_with_a_changed_setting_are_measured_again(shots: Path, tmp_path: Path) -> None:
    sheet = shots / "list.csv"
    sheet.write_text("recording,fps\na.npy,100\nb.npy,100\n")
    again(sheet, tmp_path / "out")
    sheet.write_text("recording,fps\na.npy,100\nb.npy,200\n")
    assert again(sheet, tmp_path / "out") == Counts(done=2, failed=0, pending=0, measured=1)
    assert calls(shots) == ["a", "b", "b"]
    assert rows(tmp_path / "out")["b.npy"]["frame_rate"] == "200"


def test_a_setting_with_its_default_value_changes_nothing(shots: Path, tmp_path: Path) -> None:
    again(shots, tmp_path / "out")
    assert again(shots, tmp_path / "out", {"model": "rigid", "map": "auto"}).measured == 0


def test_recordings_with_a_changed_mask_image_are_measured_again(shots: Path, tmp_path: Path) -> None:
    mask = tmp_path / "mask.png"
    mask.write_bytes(b"one")
    again(shots, tmp_path / "out", {"ignore": [str(mask)]})
    assert again(shots, tmp_path / "out", {"ignore": [str(mask)]}).measured == 0
    mask.write_bytes(b"another")
    assert again(shots, tmp_path / "out", {"ignore": [str(mask)]}).measured == 4


def test_a_failure_is_repeated_only_on_request_or_when_its_input_changes(shots: Path, tmp_path: Path) -> None:
    again(shots, tmp_path / "out")
    assert again(shots, tmp_path / "out").measured == 0
    assert again(shots, tmp_path / "out", retry_failed=True) == Counts(done=3, failed=1, pending=0, measured=1)
    write_array(shots / "d.npy", 4)
    assert again(shots, tmp_path / "out") == Counts(done=4, failed=0, pending=0, measured=1)


def test_a_missing_recording_fails_and_is_measured_when_present(shots: Path, tmp_path: Path) -> None:
    sheet = shots / "list.csv"
    sheet.write_text("recording\na.npy\nlater.npy\n")
    assert again(sheet, tmp_path / "out").failed == 1
    assert "later.npy" in rows(tmp_path / "out")["later.npy"]["reason"]
    assert again(sheet, tmp_path / "out").measured == 0
    write_array(shots / "later.npy", 4)
    assert again(sheet, tmp_path / "out") == Counts(done=2, failed=0, pending=0, measured=1)


def test_the_reason_of_a_failure_mentions_an_earlier_result(shots: Path, tmp_path: Path) -> None:
    again(shots, tmp_path / "out")
    write_array(shots / "a.npy", BAD)
    again(shots, tmp_path / "out")
    row = rows(tmp_path / "out")["a.npy"]
    assert row["state"] == "failed"
    assert "still holds the result of an earlier input" in row["reason"]
    assert (row["frames"], row["result"]) == ("", "")


def test_a_result_without_record_is_accepted_and_a_record_without_result_is_not(shots: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    again(shots, out)
    records.file_of(out, "a").unlink()
    records.file_of(out, "b").write_text('{"state": "do')
    shutil.rmtree(out / "deep" / "c")
    assert again(shots, out) == Counts(done=3, failed=1, pending=0, measured=1)
    assert calls(shots) == ["a", "b", "c", "c"]


def test_an_output_folder_without_its_state_is_recognised_by_its_table(shots: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    again(shots, out)
    shutil.rmtree(out / ".batch")
    # Results are found again, failures are measured again.
    assert again(shots, out) == Counts(done=3, failed=1, pending=0, measured=1)
    shutil.rmtree(out / ".batch")
    (out / "summary.csv").write_text("name,price\n")
    with pytest.raises(FileExistsError, match="no results of 'torchsphere batch'"):
        again(shots, out)


def test_a_result_emptied_by_a_power_failure_is_measured_again(shots: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    again(shots, out)
    for name in ("summary.json", "batch.json"):
        (out / "b" / name).write_bytes(b"")
    assert again(shots, out) == Counts(done=3, failed=1, pending=0, measured=1)
    assert (out / "b" / "summary.json").stat().st_size > 0


def test_an_unforeseen_error_is_a_failure_with_its_trace(shots: Path, tmp_path: Path) -> None:
    def broken(*_: Any) -> None:
        raise RuntimeError("out of memory")

    def engine(jobs: Iterator[Job]) -> Iterator[Outcome]:
        return (run_job(job, broken) for job in jobs)

    out = tmp_path / "out"
    assert run(manifest.read(shots, {}, out), out, engine).failed == 4
    assert rows(out)["a.npy"]["reason"].startswith("unforeseen RuntimeError: out of memory (test_run.py, line ")
    record = records.read(out, "a")
    assert record is not None
    assert "Traceback" in record.trace


def test_a_full_disk_stops_the_run_and_fails_no_recording(shots: Path, tmp_path: Path) -> None:
    def full(request: Any, progress: None, extra: Any) -> None:
        if request.input.name == "b.npy":
            raise OSError(errno.ENOSPC, "No space left on device", "track.csv")
        pretended(request, progress, extra)

    out = tmp_path / "out"
    with pytest.raises(OSError, match="no space left on device; the run stops here"):
        run(manifest.read(shots, {}, out), out, lambda jobs: (run_job(job, full) for job in jobs))
    assert [row["state"] for row in rows(out).values()] == ["done", "pending", "pending", "pending"]
    assert again(shots, out) == Counts(done=3, failed=1, pending=0, measured=3)


def test_a_table_that_a_full_disk_does_not_take_hides_no_cause(
    shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(request: Any, progress: None, extra: Any) -> None:
        monkeypatch.setattr(summary, "write", refuse)
        raise OSError(errno.ENOSPC, "No space left on device", "track.csv")

    def refuse(*arguments: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", "summary.csv")

    out = tmp_path / "out"
    with pytest.raises(OSError, match=r"track.csv: no space left on device; the run stops here"):
        run(manifest.read(shots, {}, out), out, lambda jobs: (run_job(job, full) for job in jobs))


def test_a_recording_whose_process_died_twice_fails_and_a_new_run_measures_it_again(
    shots: Path, tmp_path: Path
) -> None:
    class Death(BaseException):
        """Stands for a process that dies during the measurement, so that its mark stays."""

    def die(request: Any, progress: None, extra: Any) -> None:
        raise Death

    out = tmp_path / "out"
    archive = manifest.read(shots, {}, out)

    def engine(jobs: Iterator[Job]) -> Iterator[Outcome]:
        for job in jobs:
            if job.item.result != "a":
                continue
            mark = records.file_of(out, "a", ".started")
            records.write_table(mark, {"run": "of another day", "count": 2})
            with pytest.raises(Death):
                run_job(job, die)
            # Marks of another run do not count: this run may start the recording twice.
            records.write_table(mark, {"run": job.run, "count": 2})
            yield run_job(job, pretended)

    assert run(archive, out, engine).failed == 1
    assert "died 2 times" in rows(out)["a.npy"]["reason"]
    assert again(shots, out, retry_failed=True).done == 3


def test_shards_divide_the_archive_and_the_last_table_has_all_recordings(shots: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    names = ["a", "b", "deep/c", "d"]
    parts = [[name for name in names if in_shard(name, (k, 3))] for k in (1, 2, 3)]
    assert sorted(name for part in parts for name in part) == sorted(names)
    totals = [again(shots, out, shard=(k, 3)).total for k in (1, 2, 3)]
    assert totals == [len(part) for part in parts]
    assert [row["state"] for row in rows(out).values()] == ["done", "done", "failed", "done"]
    assert calls(shots) == ["a", "b", "c"]


def test_the_counts_are_reported_at_the_start_and_after_each_recording(shots: Path, tmp_path: Path) -> None:
    seen: list[Counts] = []
    again(shots, tmp_path / "out", changed=seen.append)
    assert [(c.done, c.failed, c.pending) for c in seen] == [(0, 0, 4), (1, 0, 3), (2, 0, 2), (2, 1, 1), (3, 1, 0)]


def test_the_table_has_the_spin_of_an_impact_in_rad_per_s() -> None:
    # A quarter of a turn per second, which the result folder states in revolutions.
    impact = {"spin_rate_after": {"value": 0.25, "sd": 0.01, "unit": "rev/s"}}
    row = summary.measured({"impact": impact})
    assert row["spin_after_rad_s"] == pytest.approx(math.pi / 2)
    assert row["sd_spin_after_rad_s"] == pytest.approx(0.02 * math.pi)
    assert row["spin_before_rad_s"] is None


def test_the_table_has_a_standard_deviation_for_the_radius_and_the_lengths_of_the_means() -> None:
    mean = {"velocity_m_s": [3.0, 4.0], "sd_velocity_m_s": [0.3, 0.4], "spin_rad_s": [0.0, 2.0, 0.0]}
    row = summary.measured({"circle": {"radius": 40.1, "sd_radius": 0.09}, "mean_motion": mean})
    assert (row["radius_px"], row["sd_radius_px"]) == (40.1, 0.09)
    assert row["mean_speed_m_s"] == 5
    # Components along the vector change the length: 0.6 * 0.3 and 0.8 * 0.4.
    assert row["sd_mean_speed_m_s"] == pytest.approx(math.hypot(0.18, 0.32))
    # A result of an earlier version has no standard deviation of its mean.
    assert (row["mean_spin_rad_s"], row["sd_mean_spin_rad_s"]) == (2, None)
    assert set(row) < set(summary.COLUMNS)


def test_the_table_keeps_the_sign_of_a_restitution() -> None:
    # The restitution of a ball that goes through its target is negative.
    row = summary.measured({"impact": {"restitution_normal": {"value": -0.28, "sd": 0.002, "unit": "1"}}})
    assert row["restitution"] == -0.28
    assert row["sd_restitution"] == pytest.approx(0.002)


@pytest.mark.parametrize("row", [{"frames": "many"}, {"seconds": [1]}, {"result": 3}, {"frames": 10**30}, []], ids=str)
def test_a_damaged_record_is_measured_again_and_stops_nothing(shots: Path, tmp_path: Path, row: Any) -> None:
    out = tmp_path / "out"
    again(shots, out)
    record = records.read_table(records.file_of(out, "d"))
    assert record is not None
    records.write_table(records.file_of(out, "d"), record | {"row": row})
    assert again(shots, out) == Counts(done=3, failed=1, pending=0, measured=1)


@pytest.mark.parametrize("damage", ['{"frames_per_status": 3}', '{"circle": [1]}', '{"seconds": "x"}', "[" * 100_000])
def test_a_damaged_result_without_record_is_measured_again(shots: Path, tmp_path: Path, damage: str) -> None:
    out = tmp_path / "out"
    again(shots, out)
    records.file_of(out, "a").unlink()
    (out / "a" / "summary.json").write_text(damage)
    assert again(shots, out) == Counts(done=3, failed=1, pending=0, measured=1)
