"""The footage, clocks, claims and estimates of the speed experiment."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import torchsphere as ts
from experiments.speed import clock, gpu, million, recordings, tracks
from experiments.speed.clock import in_turns
from experiments.speed.files import Run
from experiments.speed.footage import AXIS, CALM, FAST, SPIN, SWING, Footage, Motion
from experiments.speed.scope import Scope
from experiments.speed.timed_run import STAGES, put_clock

MOTIONS = (CALM, SPIN, FAST, SWING)


@pytest.mark.parametrize("motion", MOTIONS, ids=str)
def test_the_ball_turns_and_moves_as_stated_also_where_the_period_ends(motion: Motion) -> None:
    first, radius = motion.period - 2, 30.0
    footage = Footage(motion, radius)
    frames = range(first, first + 4)
    x, y = footage.position(frames)[0]
    track = ts.track(np.stack([footage.image(i) for i in frames]), (x, y, radius), sphere_map=False)
    assert (track.status == "ok").all()
    # At 3 deg per frame the pairs err by some hundredths of a pixel.
    assert np.abs(track.position - footage.position(frames)).max() < 0.1
    turn = np.radians(motion.deg_per_frame) * AXIS.numpy()
    assert np.degrees(np.abs(track.increment[:, 2:] - turn)).max() < 0.15


def test_a_period_holds_whole_turns_and_whole_rounds() -> None:
    assert [motion.deg_per_frame for motion in (CALM, SPIN, FAST)] == pytest.approx([0.02, 4 / 7, 3.0])
    for motion in MOTIONS:
        assert motion.angle(motion.period) == 0 == motion.angle(0)
        first, later = Footage(motion).position([0, motion.period])
        assert (first == later).all()


def test_a_later_period_shows_the_same_ball_under_new_noise() -> None:
    footage = Footage(FAST, 15.0)
    first, later = (footage.image(i).astype(float) for i in (7, 7 + FAST.period))
    # The difference of two images has the noise of both, 2 grey levels each, and rounding.
    assert (later - first).std() == pytest.approx(8**0.5, rel=0.05)


def test_ways_are_timed_in_turns_and_the_best_round_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    called: list[str] = []
    now = [0.0]
    # A clock of its own: on a busy machine the true one may show any time.
    watch = SimpleNamespace(perf_counter=lambda: now[0], process_time=lambda: now[0])
    monkeypatch.setattr(clock, "time", watch)

    def work(name: str) -> Callable[[], None]:
        def wait() -> None:
            called.append(name)
            now[0] += 0.02 if len(called) < 3 else 0.002

        return wait

    found = in_turns({"a": (work("a"), 1), "b": (work("b"), 2)}, seconds=0.0)
    assert called == ["a", "b"] * clock.FEWEST_ROUNDS
    assert found["a"].wall_ms == pytest.approx(2)
    assert found["b"].wall_ms == pytest.approx(1)


@pytest.mark.parametrize(("place", "name"), [stage[:2] for stage in STAGES])
def test_what_the_clock_is_put_around_is_where_it_is_looked_for(place: str, name: str) -> None:
    assert callable(getattr(importlib.import_module(place), name))


def test_a_clock_adds_up_all_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clock, "in_turns", lambda: time.sleep(0.01))
    spent: dict[str, float] = {}
    put_clock(spent, "experiments.speed.clock", "in_turns", "s")
    clock.in_turns()  # type: ignore[call-arg]
    clock.in_turns()  # type: ignore[call-arg]
    assert spent["s"] >= 0.02


def test_every_way_is_timed_on_the_same_frames() -> None:
    pytest.importorskip("cv2")
    cell = tracks.measured(SPIN, 15, 8, seconds=0.0)
    assert len(cell.ms) == 5
    assert all(ms > 0 for ms in cell.ms.values())
    assert cell.ok == cell.frames == 8
    assert cell.on_map > 0 or cell.reason


def _cell(ours: float, frames: int) -> tracks.Cell:
    return tracks.Cell({tracks.DEFAULT: ours, tracks.PAIRS: 1.5, tracks.ECC: 1.0}, frames, frames, frames, "")


@pytest.mark.parametrize(("ours", "holds"), [(5.9, True), (6.1, False)])
def test_a_track_of_300_frames_is_held_against_the_clock_and_against_ecc(ours: float, holds: bool) -> None:
    found = {("spins", 50, 300): _cell(ours, 300), ("spins", 50, 2000): _cell(1.9, 2000)}
    assert [row.holds for row in tracks.rows(found)] == [holds, True]


def test_the_tables_of_tracks_have_a_column_per_radius_and_per_length() -> None:
    found = {("spins", radius, 100): _cell(5.0, 100) for radius in (50, 15)} | {("spins", 50, 30): _cell(6.0, 30)}
    by_radius, by_length = tracks.tables(found)
    assert "| ms per frame | R = 15 px | R = 50 px |" in by_radius
    assert "| ms per frame | 30 frames | 100 frames |" in by_length
    assert "| torchsphere over ECC | 6.0 | 5.0 |" in by_length


def _run(frames: int, wall_s: float, peak_gb: float) -> Run:
    return Run(frames, wall_s, wall_s, 1.0, 0.1, 1.0, wall_s - 3, 0.9, peak_gb, frames, frames, 0.01)


@pytest.mark.parametrize(("wall_s", "peak_gb", "holds"), [(6.0, 1.4, [True, True]), (7.0, 1.6, [False, False])])
def test_recordings_are_held_against_rate_and_memory(wall_s: float, peak_gb: float, holds: list[bool]) -> None:
    found = {
        ("spins", "tif", 2000, "auto"): _run(2000, wall_s, 0.7),
        ("spins", "cih", 20000, "auto"): _run(20000, 60.0, peak_gb),
    }
    assert [row.holds for row in recordings.rows(found)] == holds


def test_the_time_to_follow_grows_with_a_stated_power() -> None:
    found = {("spins", "cih", n, "auto"): _run(n, 3 + 0.001 * n, 0.7) for n in (500, 1000, 2000)}
    assert "to the power 1.00" in recordings.growth(found)
    assert recordings.growth({}) == ""


def test_spans_that_overlap_count_once() -> None:
    assert gpu.busy_seconds([(5, 6), (0, 2), (1, 3), (1.5, 2.5)]) == 4
    assert gpu.busy_seconds([]) == 0


def test_without_a_gpu_the_table_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    found = gpu.compute(Scope())
    assert gpu.rows(found) == []
    assert "No GPU" in gpu.tables(found)[0]


@pytest.mark.parametrize(
    ("way", "difference_px", "difference_sd", "holds"),
    [
        ("default", 5e-4, 3.0, True),
        ("default", 2e-3, 0.1, False),
        ("by pairs", 0.05, 0.9, True),
        ("by pairs", 0.0, 1.1, False),
    ],
)
def test_a_gpu_is_held_against_the_cpu(
    way: str, difference_px: float, difference_sd: float, holds: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("torch.cuda.get_device_name", lambda: "some GPU")
    found = [gpu.OnGpu(50.0, 300, way, 0.5, 1.5, 0.2, 1.5, difference_px, difference_sd, same_status=True)]
    assert gpu.rows(found)[0].holds is holds
    assert f"| R = 50 px, 300 frames | {way} | 600 | 200 | 40 | 1.5 |" in gpu.tables(found)[0]


def test_statuses_that_differ_on_a_gpu_break_the_claim() -> None:
    found = gpu.OnGpu(50.0, 300, "default", 0.5, 1.5, 0.2, 1.5, 0.0, 0.0, same_status=False)
    assert not gpu.rows([found])[0].holds


def test_a_million_recordings_cost_a_million_times_one() -> None:
    shots = {"default": million.Shot(seconds=0.72, files=4, kilobytes=80.0)}
    costs = million.Costs(shots, million.Lists(0.36, 0.12, 6.0), short_gb=0.5, longer_gb=0.75)
    text = "\n".join(million.tables(costs))
    assert "| default | 0.72 s | 200 | 3.1 h | 5 million | 0.08 TB |" in text
    assert "32 to 48 GB" in text
    assert "6 minutes, 2 in a second run, and 6 GB" in text


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """The recordings that were asked for, none of which is made; each takes a second less than the one before."""
    calls: list[tuple[Any, ...]] = []

    def measured(*key: Any) -> Run:
        calls.append(key)
        return _run(key[2], 100.0 - len(calls), 0.7)

    monkeypatch.setattr(recordings, "measured", measured)
    return calls


def test_a_limit_of_frames_leaves_out_longer_recordings(asked: list[tuple[Any, ...]]) -> None:
    recordings.compute(Scope(most_frames=1000))
    assert sorted(count for _, _, count, _ in asked) == [500, 1000]


def test_the_fastest_run_of_the_recording_with_a_limit_counts(asked: list[tuple[Any, ...]]) -> None:
    found = recordings.compute(Scope(most_frames=2000))
    assert found[recordings.CLAIMED].wall_s == 100 - recordings.REPEATS
    assert len(asked) == len(found) + recordings.REPEATS - 1
