"""Preparation of the next batch in the background: the same numbers, and none after an unreliable batch."""

import dataclasses
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch
from shots import Shot, shot
from torch import Tensor

from torchsphere import track
from torchsphere.correlation.gauss_newton import CoarseSolution
from torchsphere.correlation.options import Options
from torchsphere.recording import open_recording
from torchsphere.recording.frame_source import Source
from torchsphere.runtime import threads
from torchsphere.runtime.threads import Call
from torchsphere.tracking import prefetch, successive_pairs
from torchsphere.tracking.prediction import BallState
from torchsphere.tracking.prefetch import Prefetcher
from torchsphere.tracking.successive_pairs import PairSetup, PreparedBatch

SETUP = PairSetup(Options(), None, False, shared=lambda part, rows: [part(0, rows)])

#: Pairs of the first batch and of the next.
FIRST, NEXT = 20, 6


@pytest.fixture(scope="module")
def made() -> Shot:
    return shot(4, n=FIRST + NEXT + 1, radius=40.0, jitter=0.05)


@pytest.fixture(params=[True, False], ids=["idle", "busy"])
def idle(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Whether another core is idle."""
    monkeypatch.setattr(threads, "has_idle_cores", lambda: request.param)
    return bool(request.param)


def counted(made: Shot, fails_at: int = 99) -> tuple[Source, list[int]]:
    """The images, and the numbers of the images read; images from ``fails_at`` on raise an error."""
    reads: list[int] = []

    def read(start: int, stop: int) -> Tensor:
        if stop > fails_at:
            raise OSError("the file is cut")
        reads.extend(range(start, stop))
        return made.images[start:stop]

    return Source(read, len(made.images), torch.device("cpu"), torch.float32), reads


def state_in(made: Shot, frame: int) -> BallState:
    """The true state of the ball in a frame."""
    step = made.increments[min(frame, len(made.increments) - 1)]
    image, centre = made.images[frame : frame + 1], made.centres[frame]
    return BallState(frame, image, centre, made.radius, step, torch.zeros_like(step), 0.0)


@pytest.fixture(scope="module")
def first(made: Shot) -> PreparedBatch:
    """The first batch, prepared."""
    return Prefetcher(counted(made)[0], SETUP).get(state_in(made, 0), FIRST)


def test_the_next_batch_is_prepared_at_the_next_positions_of_the_ball(
    made: Shot, first: PreparedBatch, idle: bool
) -> None:
    source, _ = counted(made)
    batches = Prefetcher(source, SETUP)
    batches.prefetch(state_in(made, 0), first, NEXT)
    found = batches.get(state_in(made, FIRST), NEXT)
    assert torch.equal(found.images, made.images[FIRST:])
    np.testing.assert_allclose(found.circles[:, :2], made.centres[FIRST:], atol=1.0)
    np.testing.assert_allclose(found.coarse.q, made.increments[FIRST:], atol=0.02)
    motion, circles = successive_pairs.correlate_successive(found, state_in(made, FIRST).circle, SETUP)
    assert set(motion.status) == {"ok"}
    np.testing.assert_allclose(circles[:, :2], made.centres[FIRST:], atol=0.1)


def test_with_an_idle_core_the_next_images_are_read_in_advance(made: Shot, first: PreparedBatch, idle: bool) -> None:
    source, reads = counted(made)
    batches = Prefetcher(source, SETUP)
    batches.prefetch(state_in(made, 0), first, NEXT)
    assert batches._begun is not None
    if idle:
        batches._begun[2].result()
    assert reads == (list(range(FIRST, FIRST + NEXT + 1)) if idle else [])


@pytest.mark.usefixtures("idle")
@pytest.mark.parametrize(("frame", "pairs"), [(FIRST - 3, NEXT), (FIRST, NEXT - 2)])
def test_a_batch_prepared_for_other_frames_is_dropped(made: Shot, first: PreparedBatch, frame: int, pairs: int) -> None:
    source, _ = counted(made)
    batches, anew = Prefetcher(source, SETUP), Prefetcher(source, SETUP)
    batches.prefetch(state_in(made, 0), first, NEXT)
    for _ in range(2):
        found, expected = (prefetcher.get(state_in(made, frame), pairs) for prefetcher in (batches, anew))
        assert torch.equal(found.images, expected.images)
        assert torch.equal(found.circles, expected.circles)
        assert torch.equal(found.coarse.q, expected.coarse.q)


def test_images_of_a_file_take_turns_in_two_buffers_so_that_images_in_use_stay(
    made: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(threads, "has_idle_cores", lambda: True)
    tifffile.imwrite(tmp_path / "shot.tif", made.images.numpy().astype(np.uint8), metadata=None)
    with open_recording(tmp_path / "shot.tif") as recording:
        batches = Prefetcher(Source.open(recording), SETUP)
        places = []
        for frame in (0, 5, 10):
            found = batches.get(state_in(made, frame), 5)
            batches.prefetch(state_in(made, frame), found, 5)
            assert batches._begun is not None
            batches._begun[2].result()
            assert torch.equal(found.images, made.images[frame : frame + 6])
            places.append(found.images.data_ptr())
        batches.close()
    assert places[0] == places[2] != places[1]


def with_coarse(batch: PreparedBatch, **changed: Tensor) -> PreparedBatch:
    return dataclasses.replace(batch, coarse=batch.coarse._replace(**changed))


#: Batches from which the next position of the ball is uncertain.
UNRELIABLE: dict[str, Callable[[PreparedBatch], PreparedBatch]] = {
    "not converged": lambda batch: with_coarse(batch, converged=torch.arange(FIRST) != 7),
    "too small for a coarse solution": lambda batch: dataclasses.replace(
        batch, coarse=CoarseSolution.none(batch.start)
    ),
    "off the expected path": lambda batch: with_coarse(batch, q=batch.coarse.q + 0.3),
}


@pytest.mark.parametrize("kind", UNRELIABLE)
def test_no_batch_is_begun_after_an_unreliable_batch(made: Shot, first: PreparedBatch, kind: str) -> None:
    batches = Prefetcher(counted(made)[0], SETUP)
    batches.prefetch(state_in(made, 0), UNRELIABLE[kind](first), NEXT)
    assert batches._begun is None
    batches.prefetch(state_in(made, 0), first, NEXT)
    assert batches._begun is not None


def test_no_batch_is_begun_for_a_ball_in_place_that_comes_nearer(made: Shot, first: PreparedBatch) -> None:
    nearer = with_coarse(first, q=torch.nn.functional.pad(first.coarse.q, (0, 1), value=1e-3))
    for in_place in (True, False):
        batches = Prefetcher(counted(made)[0], dataclasses.replace(SETUP, in_place=in_place))
        batches.prefetch(state_in(made, 0), nearer, NEXT)
        assert (batches._begun is None) == in_place


def test_an_interrupt_waits_for_the_call_under_way(made: Shot) -> None:
    settled: list[bool] = []

    def interrupted() -> PreparedBatch:
        raise KeyboardInterrupt

    batches = Prefetcher(counted(made)[0], SETUP)
    batches._begun = (FIRST, NEXT, Call(interrupted, lambda: settled.append(True)))
    with pytest.raises(KeyboardInterrupt):
        batches.get(state_in(made, FIRST), NEXT)
    assert settled == [True]


def test_no_batch_is_begun_if_two_batches_are_too_large_or_no_pair_is_left(
    made: Shot, first: PreparedBatch, monkeypatch: pytest.MonkeyPatch
) -> None:
    batches = Prefetcher(counted(made)[0], SETUP)
    batches.prefetch(state_in(made, 0), first, 0)
    monkeypatch.setattr(prefetch, "CACHE_BYTES", first.images.nbytes - 1)
    batches.prefetch(state_in(made, 0), first, NEXT)
    assert batches._begun is None


@pytest.mark.usefixtures("idle")
def test_an_unreadable_image_raises_only_when_its_batch_is_requested(made: Shot, first: PreparedBatch) -> None:
    source, _ = counted(made, fails_at=FIRST + 4)
    batches = Prefetcher(source, SETUP)
    batches.prefetch(state_in(made, 0), first, NEXT)
    assert len(batches.get(state_in(made, FIRST), 2).start) == 2
    batches.prefetch(state_in(made, 0), first, NEXT)
    with pytest.raises(OSError, match="cut"):
        batches.get(state_in(made, FIRST), NEXT)


def test_a_ball_in_place_is_expected_at_the_same_position(made: Shot) -> None:
    batches = Prefetcher(counted(made)[0], dataclasses.replace(SETUP, in_place=True))
    state = state_in(made, 0)
    batches.prefetch(state, batches.get(state, 3), 2)
    found = batches.get(state_in(made, 3), 2)
    assert torch.equal(found.circles[:, :2], state.centre.expand(3, 2))


def test_a_recording_of_several_batches_is_the_same_on_one_core_and_on_two(monkeypatch: pytest.MonkeyPatch) -> None:
    long = shot(5, n=150, radius=40.0, jitter=0.05)
    taken: list[bool] = []
    prepare = Prefetcher._prepare

    def noted(batches: Prefetcher, state: BallState, count: int) -> PreparedBatch:
        taken.append(threading.current_thread() is threading.main_thread())
        return prepare(batches, state, count)

    monkeypatch.setattr(Prefetcher, "_prepare", noted)
    tracks = []
    for cores in (True, False):
        monkeypatch.setattr(threads, "has_idle_cores", lambda cores=cores: cores)
        tracks.append(track(long.images, (*long.centres[0].tolist(), long.radius), sphere_map=False))
        assert all(taken) is not cores
        taken.clear()
    assert (tracks[0].status == "ok").all()
    for name in ("position", "increment", "covariance", "zncc", "iterations"):
        np.testing.assert_array_equal(getattr(tracks[0], name), getattr(tracks[1], name))
