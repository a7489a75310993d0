"""The clocks of the speed experiment."""

from __future__ import annotations

import importlib

import pytest

from experiments.speed.files import STAGES


@pytest.mark.parametrize(("place", "name"), [stage[:2] for stage in STAGES])
def test_what_the_clock_is_put_around_is_where_it_is_looked_for(place: str, name: str) -> None:
    assert callable(getattr(importlib.import_module(place), name))
