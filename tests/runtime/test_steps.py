"""Steps that are told before they begin."""

import logging
from pathlib import Path

import pytest

from torchsphere.runtime import steps


def test_a_step_is_a_record_that_is_marked_as_long(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        steps.tell("drawing %s", "overlay.mp4")
    (record,) = caplog.records
    assert record.getMessage() == "drawing overlay.mp4"
    assert record.takes_long is True


def test_only_large_files_are_announced(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    small, half = tmp_path / "small", tmp_path / "half"
    small.write_bytes(b"x")
    # A file with a hole takes no room.
    with half.open("wb") as stream:
        stream.truncate(steps.LARGE_BYTES // 2 + 1)
    with caplog.at_level(logging.INFO):
        steps.tell_if_large([small, half, tmp_path / "missing"], "reading")
        assert caplog.messages == []
        steps.tell_if_large([small, half, half], "reading")
    assert caplog.messages == ["reading"]
