"""The search for the contact where it is a small part of a long recording."""

import numpy as np
import pulses
import pytest
from pulses import LENGTH, NOISES_M, Pulse, pulse

from torchsphere.estimation import contact_search
from torchsphere.estimation.likelihood import Series
from torchsphere.estimation.measurements import poses


def long_series(frames: int, monkeypatch: pytest.MonkeyPatch) -> tuple[Series, Pulse]:
    monkeypatch.setattr(pulses, "FRAMES", frames)
    shot = pulse(3, NOISES_M[0])
    return poses([shot.track], [np.arange(float(frames))]).series(), shot


@pytest.mark.parametrize("frames", [300, 1400])
def test_a_contact_of_fourteen_frames_is_found_among_many(frames: int, monkeypatch: pytest.MonkeyPatch) -> None:
    series, shot = long_series(frames, monkeypatch)
    found = contact_search.find(series)
    assert bool(found.found[0])
    windows = found.windows[0].numpy()
    off = windows.mean(0) - shot.edges_s * pulses.RATE
    assert windows.std(0).max() < 0.05 * LENGTH
    assert np.abs(off / windows.std(0)).max() < 3


def test_a_long_flight_without_contact_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    series, _ = long_series(700, monkeypatch)
    assert not contact_search.find(series.between(60, 700)).found[0]


def test_long_recordings_in_a_batch_give_the_results_that_each_gives_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    series, _ = long_series(200, monkeypatch)
    both, alone = contact_search.find(series.repeated(2)), contact_search.find(series)
    for row in range(2):
        np.testing.assert_allclose(both.windows[row], alone.windows[0], atol=1e-6)


def test_a_short_recording_in_a_batch_with_a_long_recording_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pulses, "FRAMES", 80)
    short = pulse(3, NOISES_M[0])
    monkeypatch.setattr(pulses, "FRAMES", 1400)
    long = pulse(4, NOISES_M[0])
    both = poses([short.track, long.track], [np.arange(80.0), np.arange(1400.0)]).series()
    found = contact_search.find(both)
    for row, shot in enumerate((short, long)):
        windows = found.windows[row].numpy()
        off = windows.mean(0) - shot.edges_s * pulses.RATE
        assert found.found[row]
        assert windows.std(0).max() < 0.05 * LENGTH
        assert np.abs(off / windows.std(0)).max() < 3
