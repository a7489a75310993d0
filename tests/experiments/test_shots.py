"""Tracks of rendered shots come back from the cache as they were measured."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shots as made_shots

import torchsphere as ts
from experiments import shots


def test_a_track_from_the_cache_is_that_which_was_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = made_shots.shot(0, n=4, radius=20.0, start=(40.0, 40.0))
    images = made.images.numpy().astype(np.uint8)[:, :90, :110]
    footage: Any = SimpleNamespace(shot=SimpleNamespace(name="small"), images=images, key="small")
    monkeypatch.setattr(shots, "CACHE", tmp_path / "cache")
    measured = shots.tracked(footage, made.circle, in_place=True)
    monkeypatch.setattr(ts, "track", None)
    kept = shots.tracked(footage, made.circle, in_place=True)
    assert kept.warnings == measured.warnings
    assert kept.circle == measured.circle
    assert kept.settings == measured.settings
    assert measured.settings["model"] == "rigid"
    for name in ("position", "increment", "covariance", "status"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(measured, name))
