"""Imports without garbage collection."""

import gc

import pytest

from torchsphere.runtime.imports import without_collections


@pytest.mark.parametrize("is_enabled", [True, False])
def test_the_collector_pauses_and_goes_on_as_before(is_enabled: bool) -> None:
    was_enabled, frozen = gc.isenabled(), gc.get_freeze_count()
    try:
        (gc.enable if is_enabled else gc.disable)()
        with without_collections():
            assert not gc.isenabled()
        assert gc.isenabled() == is_enabled
        assert gc.get_freeze_count() > frozen
    finally:
        gc.unfreeze()
        (gc.enable if was_enabled else gc.disable)()
