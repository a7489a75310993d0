"""The measurement in the background."""

import json
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import torchsphere as ts
from torchsphere.correlation.frame_status import STATUSES
from torchsphere.geometry.circle import Circle
from torchsphere.geometry.orientation import quaternions
from torchsphere.measure import measure
from torchsphere.pick import tracking_job
from torchsphere.pick.tracking_job import LivePoses, TrackingJob
from torchsphere.request import Request
from torchsphere.synthetic import demo_shot as demo
from torchsphere.tracking.record import Record


def request(places: Any, **settings: Any) -> Request:
    return Request(input=places.input, out=places.out, map="off", **settings)


def test_the_rows_while_the_ball_is_followed_are_those_of_the_track(demo_shot: demo.Shot) -> None:
    live, calls = LivePoses(), []

    def watch(record: Record, done: int) -> None:
        assert not live.take(record, done)
        calls.append((done, len(live.rows)))

    x, y = demo_shot.position[0]
    images = demo_shot.images[:8]
    track = ts.track(images, (x, y, demo.RADIUS_PX), sphere_map=False, watch=watch, log=False)
    assert [done for done, _ in calls] == [rows for _, rows in calls]
    assert len(live.rows) == 8
    rows = np.array(live.rows, dtype=float)
    # Seven digits are sent.
    np.testing.assert_allclose(rows[:, :2], track.position, rtol=1e-6)
    np.testing.assert_allclose(rows[:, 3:7], quaternions(track.orientation), atol=1e-6)
    np.testing.assert_allclose(rows[1:, 7:10], np.degrees(track.increment[:, 2:].cumsum(0)), atol=1e-5)
    assert [STATUSES[int(code)] for code in rows[:, 11]] == track.status.tolist()
    finished = np.array(tracking_job.poses_of(track).rows(), dtype=float)
    np.testing.assert_allclose(finished[:, [0, 1, 2, 7, 8, 9]], rows[:, [0, 1, 2, 7, 8, 9]], rtol=1e-5, atol=1e-5)


def test_rows_start_again_where_the_ball_is_followed_again() -> None:
    record = Record.empty(6, Circle(10.0, 20.0, 5.0))
    live = LivePoses()
    assert [live.take(record, done) for done in (2, 5, 2, 3)] == [False, False, True, False]
    assert len(live.rows) == 3
    assert live.rows[0][:3] == [10.0, 20.0, 5.0]
    # Frames that are not known have no numbers, and JSON can hold them.
    assert live.rows[1] == [None] * 11 + [STATUSES.index("lost")]
    json.dumps(live.rows, allow_nan=False)


def test_a_measurement_ends_with_its_outcome_and_all_rows(places: Any, demo_shot: demo.Shot) -> None:
    x, y = demo_shot.position[0]
    job = TrackingJob(request(places, circle=(x, y, demo.RADIUS_PX), report=False), 0)
    assert job.folder is None
    job.start()
    job.wait()
    found = job.snapshot()
    assert (found["state"], found["verdict"], found["grade"]) == ("done", "All 8 frames were measured.", "good")
    assert len(found["rows"]) == 8
    assert not found["hasReport"]
    assert job.folder == places.out
    assert (places.out / "track.csv").is_file()
    # A page that has these rows gets none again.
    assert job.snapshot(found["version"], 8)["rows"] == []
    assert len(job.snapshot(found["version"] - 1, 8)["rows"]) == 8


def test_a_stopped_measurement_writes_nothing(places: Any) -> None:
    begun, job = threading.Event(), None

    def slow(*arguments: Any, watch: Any) -> Any:
        def watched(record: Record, done: int) -> None:
            begun.set()
            job._stop.wait(60)
            watch(record, done)

        return measure(*arguments, watch=watched)

    job = TrackingJob(request(places, circle=(64.3, 92.6, 40.0)), 0, slow)
    job.start()
    assert begun.wait(60)
    assert job.snapshot()["state"] == "running"
    job.stop()
    assert job.snapshot()["phase"] == "Stopping"
    job.wait(60)
    assert job.snapshot()["state"] == "stopped"
    assert "nothing was written" in job.snapshot()["sentence"]
    assert list(places.out.parent.iterdir()) == []


def test_a_measurement_that_is_refused_says_why_in_the_words_of_the_page(places: Any, tmp_path: Path) -> None:
    np.save(tmp_path / "blank.npy", np.zeros((5, 60, 60), np.uint8))
    job = TrackingJob(Request(input=tmp_path / "blank.npy", out=places.out), 0)
    job.start()
    job.wait()
    found = job.snapshot()
    assert found["state"] == "failed"
    assert found["sentence"].startswith("No ball was found in 5 frames")
    assert "draw its outline as a circle" in found["sentence"]
    assert not places.out.exists()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_error_of_the_program_does_not_leave_the_page_waiting(places: Any) -> None:
    def broken(*_: Any, **__: Any) -> Any:
        raise RuntimeError("no such thing")

    job = TrackingJob(request(places), 0, broken)
    job.start()
    job.wait()
    assert job.snapshot()["state"] == "failed"
    assert job.snapshot()["sentence"] == "the measurement failed (RuntimeError: no such thing)"
