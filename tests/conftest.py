"""Fixtures for all tests."""

from pathlib import Path

import pytest


@pytest.fixture
def shared_data() -> Path:
    """Give the folder of public sample recordings, which lies beside the project."""
    folder = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the sample recordings (../shared/data) are not here")
    return folder
