"""The cache of compiled loops."""

import errno
import logging
from pathlib import Path
from typing import Any

import numba
import pytest

from torchsphere.kernels import forward_model, jit, registration


def test_a_loop_in_the_cache_belongs_to_the_files_of_all_loops() -> None:
    """A loop that calls a function of another file is compiled anew when that file changes."""
    names = [name for name, _, _ in jit.sources_stamp()]
    assert {"forward_model.py", "registration.py", "cube_map.py"} <= set(names)
    for loop in (registration._equations, forward_model._linearise):
        assert loop._cache._cache_file._source_stamp == jit.sources_stamp()


def double(value: float) -> float:
    return 2 * value


@pytest.fixture
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of its own for compiled loops, and nothing said so far."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(jit, "_NOT_KEPT", [])
    return tmp_path


def test_a_full_disk_of_the_cache_is_said_once_and_harms_no_loop(
    own_cache: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*arguments: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    loops = [jit.compiled(double) for _ in range(2)]
    monkeypatch.setattr("numba.core.caching.IndexDataCacheFile.save", full)
    with caplog.at_level(logging.WARNING):
        assert [loop(2.0) for loop in loops] == [4.0, 4.0]
    assert len(caplog.messages) == 1
    assert "cannot be kept" in caplog.messages[0]
    assert "no space left on device" in caplog.messages[0]
    assert not jit.are_kept()


def test_a_folder_that_cannot_be_written_is_said_once(
    own_cache: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    njit = numba.njit

    def refuse(cache: bool = False, **options: Any) -> Any:
        if cache:
            raise RuntimeError("cannot cache function: no locator available")
        return njit(**options)

    monkeypatch.setattr(numba, "njit", refuse)
    with caplog.at_level(logging.WARNING):
        assert [jit.compiled(double)(2.0) for _ in range(2)] == [4.0, 4.0]
    assert len(caplog.messages) == 1
    assert "name a folder that can be written in NUMBA_CACHE_DIR" in caplog.messages[0]


def test_a_cache_that_a_crash_left_empty_is_compiled_and_kept_again(own_cache: Path) -> None:
    assert jit.compiled(double)(2.0) == 4.0
    files = [path for path in own_cache.rglob("*.nb?") if path.is_file()]
    assert len(files) == 2
    for path in files:
        path.write_bytes(b"")
    assert jit.compiled(double)(2.0) == 4.0
    assert all(path.stat().st_size for path in own_cache.rglob("*.nb?"))
    assert jit.are_kept()
