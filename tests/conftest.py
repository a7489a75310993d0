"""Fixtures for all tests."""

import contextlib
import ctypes
import functools
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import tifffile
import torch
from result_folders import measured_impact
from shots import ExampleTrack, example_track

from torchsphere.measure import Measurement
from torchsphere.planning import plan, rehearsal
from torchsphere.results.reader import ResultFolder, read
from torchsphere.synthetic import demo_shot as demo

#: The test files that take longest, longest first: begun last, one of them would keep one process busy alone.
LONGEST = (
    *("tracking/test_lens.py", "archive/test_processes.py", "laws/test_real_video.py"),
    *("docs/test_pages.py", "estimation/test_rts.py", "tracking/test_track_inputs.py"),
    *("render/test_geometry.py", "laws/test_disturbances.py", "cli/test_track.py"),
    *("dynamics/test_odd_recordings.py", "detection/test_ball_search.py", "laws/test_objects_in_front.py"),
    *("laws/test_pinhole.py", "cli/test_benchmark.py", "estimation/test_contact_search.py"),
    *("dynamics/test_force_path.py", "report/test_draw.py", "planning/test_rehearsal.py"),
)

# Torch threads of two processes on two cores wait for each other and take forty times as long.
torch.set_num_threads(1)

# Arrays that are freed stay with the process (mallopt's M_MMAP_THRESHOLD and M_TRIM_THRESHOLD): each array of the
# references in double precision would be fetched anew from the system, page by page, which takes as long as computing
# with it.
with contextlib.suppress(OSError, TypeError, AttributeError):  # of the library of GNU alone
    for parameter in (-3, -1):
        ctypes.CDLL(None).mallopt(parameter, 2**30)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the files of `LONGEST` first."""
    here = Path(__file__).parent
    place = {here / name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path, len(place)))


@pytest.fixture
def shared_data() -> Path:
    """Give the folder of public sample recordings next to the project."""
    folder = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the sample recordings (../shared/data) are not here")
    return folder


@pytest.fixture
def few_recordings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Simulate four recordings of an impact for a plan: enough where the test is not about their errors."""
    monkeypatch.setattr(plan, "rehearse", functools.partial(rehearsal.rehearse, recordings=4))


@pytest.fixture(scope="session")
def example() -> ExampleTrack:
    """Give the example shot of 60 frames, tracked once without a circle."""
    return example_track()


@pytest.fixture(scope="session")
def demo_shot() -> demo.Shot:
    """Give the demo's shot with its truth."""
    return demo.make_shot()


@pytest.fixture(scope="session")
def short(tmp_path_factory: pytest.TempPathFactory, demo_shot: demo.Shot) -> Path:
    """Give the first frames of the demo's shot as a TIFF, for the command line."""
    path = tmp_path_factory.mktemp("short") / "short.tif"
    tifffile.imwrite(path, demo_shot.images[:8], photometric="minisblack")
    return path


@pytest.fixture(scope="session")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Measurement]:
    """Give the result folder and the measurement of the demo's impact."""
    return measured_impact(tmp_path_factory.mktemp("impact"))


@pytest.fixture(scope="session")
def result(measured: tuple[Path, Measurement]) -> ResultFolder:
    """Give the result of the demo's impact, read from its folder."""
    return read(measured[0])


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Give Chromium, driven by Playwright."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (extra 'dev')")
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if program is None:
        pytest.skip("there is no Chromium to open the page with; install the package 'chromium'")
    with sync_api.sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield launched
        launched.close()
