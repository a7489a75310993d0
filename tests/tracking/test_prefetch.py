"""The next batch looked at while the last one is measured: the same numbers, and nothing from where it went astray."""

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
from torchsphere.correlation.gauss_newton import Approach
from torchsphere.correlation.options import Options
from torchsphere.recording import open_recording
from torchsphere.recording.frame_source import Source
from torchsphere.runtime import threads
from torchsphere.runtime.threads import Begun
from torchsphere.tracking import prefetch, successive_pairs
from torchsphere.tracking.prediction import Seen
from torchsphere.tracking.prefetch import Ahead
from torchsphere.tracking.successive_pairs import Look, Setup

SETUP = Setup(Options(), None, False, shared=lambda part, rows: [part(0, rows)])

#: Pairs of the first batch, and of the one behind it.
FIRST, NEXT = 20, 6


@pytest.fixture(scope="module")
def made() -> Shot:
    return shot(4, n=FIRST + NEXT + 1, radius=40.0, jitter=0.05)


@pytest.fixture(params=[True, False], ids=["idle", "busy"])
def idle(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Whether another core lies idle."""
    monkeypatch.setattr(threads, "has_idle_cores", lambda: request.param)
    return bool(request.param)


def counted(made: Shot, fails_at: int = 99) -> tuple[Source, list[int]]:
    """The images, the numbers of those that were read, and an error for those from ``fails_at`` on."""
    reads: list[int] = []

    def read(start: int, stop: int) -> Tensor:
        if stop > fails_at:
            raise OSError("the file is cut")
        reads.extend(range(start, stop))
        return made.images[start:stop]

    return Source(read, len(made.images), torch.device("cpu"), torch.float32), reads


def seen_in(made: Shot, frame: int) -> Seen:
    """The ball where it is, moving on as it does."""
    step = made.increments[min(frame, len(made.increments) - 1)]
    image, centre = made.images[frame : frame + 1], made.centres[frame]
    return Seen(frame, image, centre, made.radius, step, torch.zeros_like(step), 0.0)


@pytest.fixture(scope="module")
def first(made: Shot) -> Look:
    """A look at the first batch."""
    return Ahead(counted(made)[0], SETUP).look(seen_in(made, 0), FIRST)


def test_the_next_batch_is_looked_at_where_the_ball_will_be(made: Shot, first: Look, idle: bool) -> None:
    source, _ = counted(made)
    looks = Ahead(source, SETUP)
    looks.begin(seen_in(made, 0), first, NEXT)
    found = looks.look(seen_in(made, FIRST), NEXT)
    assert torch.equal(found.images, made.images[FIRST:])
    np.testing.assert_allclose(found.balls[:, :2], made.centres[FIRST:], atol=1.0)
    np.testing.assert_allclose(found.approach.near, made.increments[FIRST:], atol=0.02)
    motion, circles = successive_pairs.correlate_successive(found, seen_in(made, FIRST).ball, SETUP)
    assert set(motion.status) == {"ok"}
    np.testing.assert_allclose(circles[:, :2], made.centres[FIRST:], atol=0.1)


def test_with_an_idle_core_the_images_are_read_before_they_are_asked_for(made: Shot, first: Look, idle: bool) -> None:
    source, reads = counted(made)
    looks = Ahead(source, SETUP)
    looks.begin(seen_in(made, 0), first, NEXT)
    assert looks._begun is not None
    if idle:
        looks._begun[2].result()
    assert reads == (list(range(FIRST, FIRST + NEXT + 1)) if idle else [])


@pytest.mark.usefixtures("idle")
@pytest.mark.parametrize(("frame", "pairs"), [(FIRST - 3, NEXT), (FIRST, NEXT - 2)])
def test_what_was_begun_with_other_frames_is_dropped(made: Shot, first: Look, frame: int, pairs: int) -> None:
    source, _ = counted(made)
    looks, anew = Ahead(source, SETUP), Ahead(source, SETUP)
    looks.begin(seen_in(made, 0), first, NEXT)
    for _ in range(2):
        found, expected = (which.look(seen_in(made, frame), pairs) for which in (looks, anew))
        assert torch.equal(found.images, expected.images)
        assert torch.equal(found.balls, expected.balls)
        assert torch.equal(found.approach.near, expected.approach.near)


def test_images_of_a_file_take_turns_in_two_rooms_so_that_those_in_use_stay(
    made: Shot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(threads, "has_idle_cores", lambda: True)
    tifffile.imwrite(tmp_path / "shot.tif", made.images.numpy().astype(np.uint8), metadata=None)
    with open_recording(tmp_path / "shot.tif") as recording:
        looks = Ahead(Source.open(recording), SETUP)
        places = []
        for frame in (0, 5, 10):
            found = looks.look(seen_in(made, frame), 5)
            looks.begin(seen_in(made, frame), found, 5)
            assert looks._begun is not None
            looks._begun[2].result()
            assert torch.equal(found.images, made.images[frame : frame + 6])
            places.append(found.images.data_ptr())
        looks.close()
    assert places[0] == places[2] != places[1]


def with_approach(look: Look, **changed: Tensor) -> Look:
    return dataclasses.replace(look, approach=look.approach._replace(**changed))


#: Looks that tell too little of where the ball goes on.
UNSURE: dict[str, Callable[[Look], Look]] = {
    "not at rest": lambda look: with_approach(look, at_rest=torch.arange(FIRST) != 7),
    "too small for a rough look": lambda look: dataclasses.replace(look, approach=Approach.none(look.start)),
    "off its path": lambda look: with_approach(look, near=look.approach.near + 0.3),
}


@pytest.mark.parametrize("kind", UNSURE)
def test_nothing_is_begun_behind_a_look_that_tells_too_little(made: Shot, first: Look, kind: str) -> None:
    looks = Ahead(counted(made)[0], SETUP)
    looks.begin(seen_in(made, 0), UNSURE[kind](first), NEXT)
    assert looks._begun is None
    looks.begin(seen_in(made, 0), first, NEXT)
    assert looks._begun is not None


def test_nothing_is_begun_for_a_ball_that_comes_nearer_in_its_place(made: Shot, first: Look) -> None:
    nearer = with_approach(first, near=torch.nn.functional.pad(first.approach.near, (0, 1), value=1e-3))
    for in_place in (True, False):
        looks = Ahead(counted(made)[0], dataclasses.replace(SETUP, in_place=in_place))
        looks.begin(seen_in(made, 0), nearer, NEXT)
        assert (looks._begun is None) == in_place


def test_an_interrupt_waits_for_what_is_under_way(made: Shot) -> None:
    settled: list[bool] = []

    def interrupted() -> Look:
        raise KeyboardInterrupt

    looks = Ahead(counted(made)[0], SETUP)
    looks._begun = (FIRST, NEXT, Begun(interrupted, lambda: settled.append(True)))
    with pytest.raises(KeyboardInterrupt):
        looks.look(seen_in(made, FIRST), NEXT)
    assert settled == [True]


def test_nothing_is_begun_where_two_batches_are_too_large_to_keep_or_no_pair_is_left(
    made: Shot, first: Look, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks = Ahead(counted(made)[0], SETUP)
    looks.begin(seen_in(made, 0), first, 0)
    monkeypatch.setattr(prefetch, "KEPT_BYTES", first.images.nbytes - 1)
    looks.begin(seen_in(made, 0), first, NEXT)
    assert looks._begun is None


@pytest.mark.usefixtures("idle")
def test_an_image_that_cannot_be_read_is_told_where_it_is_asked_for_and_not_before(made: Shot, first: Look) -> None:
    source, _ = counted(made, fails_at=FIRST + 4)
    looks = Ahead(source, SETUP)
    looks.begin(seen_in(made, 0), first, NEXT)
    assert len(looks.look(seen_in(made, FIRST), 2).start) == 2
    looks.begin(seen_in(made, 0), first, NEXT)
    with pytest.raises(OSError, match="cut"):
        looks.look(seen_in(made, FIRST), NEXT)


def test_a_ball_that_stays_in_its_place_is_looked_for_there(made: Shot) -> None:
    looks = Ahead(counted(made)[0], dataclasses.replace(SETUP, in_place=True))
    seen = seen_in(made, 0)
    looks.begin(seen, looks.look(seen, 3), 2)
    found = looks.look(seen_in(made, 3), 2)
    assert torch.equal(found.balls[:, :2], seen.centre.expand(3, 2))


def test_a_recording_of_several_batches_is_the_same_on_one_core_and_on_two(monkeypatch: pytest.MonkeyPatch) -> None:
    long = shot(5, n=150, radius=40.0, jitter=0.05)
    taken: list[bool] = []
    take = Ahead._take

    def noted(looks: Ahead, seen: Seen, count: int) -> Look:
        taken.append(threading.current_thread() is threading.main_thread())
        return take(looks, seen, count)

    monkeypatch.setattr(Ahead, "_take", noted)
    tracks = []
    for cores in (True, False):
        monkeypatch.setattr(threads, "has_idle_cores", lambda cores=cores: cores)
        tracks.append(track(long.images, (*long.centres[0].tolist(), long.radius), sphere_map=False))
        assert all(taken) is not cores
        taken.clear()
    assert (tracks[0].status == "ok").all()
    for name in ("position", "increment", "covariance", "zncc", "iterations"):
        np.testing.assert_array_equal(getattr(tracks[0], name), getattr(tracks[1], name))
