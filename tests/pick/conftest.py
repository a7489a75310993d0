"""Fixtures of the tests of the page: the first frames of the demo's shot, as a file and as a session."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from torchsphere.pick.session import Places, Session
from torchsphere.recording import open_recording
from torchsphere.recording.recording import Recording


@pytest.fixture
def recording(short: Path) -> Iterator[Recording]:
    """Give the open recording of eight frames."""
    with open_recording(short) as opened:
        yield opened


@pytest.fixture
def places(short: Path, tmp_path: Path) -> Places:
    """Give the files of a session."""
    return Places(short, tmp_path / "result", tmp_path / "shot.toml")


@pytest.fixture
def session(recording: Recording, places: Places) -> Iterator[Session]:
    """Give a session that measures by pairs, which is quick."""
    opened = Session(recording, places, {"map": "off"})
    yield opened
    opened.close()
