"""Several recordings at once: nothing of one touches another, and what gathers is measured together."""

import threading
from collections.abc import Sequence

import numpy as np
import pytest
import torch
from shots import shot

from torchsphere import track, track_many
from torchsphere.correlation import batching
from torchsphere.correlation.batching import Meeting

#: One ball each, of other sizes and patterns: the first two have crops of one size.
SHOTS = [shot(seed, n=12, radius=radius) for seed, radius in ((1, 22.0), (2, 22.0), (3, 30.0))]


def test_recordings_measured_together_are_measured_as_alone() -> None:
    alone = [track(each.images, each.circle) for each in SHOTS]
    both = track_many([each.images for each in SHOTS], [each.circle for each in SHOTS])
    for one, many, each in zip(alone, both, SHOTS, strict=True):
        assert not isinstance(many, Exception)
        assert (many.status == "ok").all()
        # Either iteration stops within 2e-4 px of the minimum, wherever it came from.
        np.testing.assert_allclose(many.increment[:, :2], one.increment[:, :2], atol=4e-4)
        np.testing.assert_allclose(many.increment[:, 2:], one.increment[:, 2:], atol=4e-4 / each.radius)
        np.testing.assert_allclose(many.covariance, one.covariance, rtol=0.02, atol=1e-12)


def test_circles_are_found_and_settings_hold_for_all() -> None:
    together = track_many([each.images for each in SHOTS[:2]], sphere_map=False, model="finite")
    for many, each in zip(together, SHOTS, strict=False):
        alone = track(each.images, sphere_map=False, model="finite")
        assert not isinstance(many, Exception)
        assert many.settings == alone.settings
        # What the iterations leave open of the increments, 4e-4 px of 22, moves the radius that they tell.
        assert (many.circle.x, many.circle.y, many.circle.radius) == pytest.approx(
            (alone.circle.x, alone.circle.y, alone.circle.radius), abs=0.01
        )


def test_a_recording_that_cannot_be_tracked_does_not_cost_the_others() -> None:
    blank = torch.full((5, 60, 60), 90.0)
    found, failed = track_many([SHOTS[0].images, blank], [SHOTS[0].circle, None])
    assert not isinstance(found, Exception)
    assert (found.status == "ok").all()
    assert isinstance(failed, ValueError)


def test_a_circle_is_expected_for_each_recording() -> None:
    with pytest.raises(ValueError, match="one for each of 2 recordings, got 1"):
        track_many([SHOTS[0].images] * 2, [SHOTS[0].circle])


def test_nothing_to_track_is_no_track() -> None:
    assert track_many([]) == []


def calls_at_once(meeting: Meeting, kinds: Sequence[str], batches: list[list[int]]) -> list[object]:
    """Results of calls that all gather while a first one, 0, keeps the device busy."""
    busy, go = threading.Event(), threading.Event()

    def squares(numbers: Sequence[int]) -> list[int]:
        batches.append(sorted(numbers))
        if 0 in numbers:
            busy.set()
            go.wait(30)
        if 13 in numbers:
            raise ArithmeticError("thirteen")
        return [number**2 for number in numbers]

    results: list[object] = [None] * (len(kinds) + 1)

    def call(kind: str, number: int) -> None:
        try:
            results[number] = meeting.call(kind, squares, number)
        except ArithmeticError as error:
            results[number] = error

    threads = [threading.Thread(target=call, args=("first", 0))]
    threads += [threading.Thread(target=call, args=(kind, 1 + i)) for i, kind in enumerate(kinds)]
    threads[0].start()
    assert busy.wait(30)
    for thread in threads[1:]:
        thread.start()
    while sum(len(waiting) for waiting in meeting._gathered.values()) < len(kinds):
        assert any(thread.is_alive() for thread in threads)
    go.set()
    for thread in threads:
        thread.join(30)
    return results


def test_what_gathers_while_the_device_is_busy_is_one_batch_of_each_kind() -> None:
    batches: list[list[int]] = []
    results = calls_at_once(Meeting(), ["a", "b", "a", "b", "a"], batches)
    assert results == [0, 1, 4, 9, 16, 25]
    assert batches[0] == [0]
    assert sorted(batches[1:]) == [[1, 3, 5], [2, 4]]


def test_an_error_reaches_all_whose_pairs_were_in_the_batch_and_no_others() -> None:
    results = calls_at_once(Meeting(), ["a"] * 13 + ["b"], [])
    assert all(isinstance(result, ArithmeticError) for result in results[1:14])
    assert results[14] == 14**2


def test_a_batch_has_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batching, "MOST", 4)
    batches: list[list[int]] = []
    results = calls_at_once(Meeting(), ["a"] * 10, batches)
    assert results == [number**2 for number in range(11)]
    assert max(map(len, batches)) <= 4
    assert len(batches) < 11
