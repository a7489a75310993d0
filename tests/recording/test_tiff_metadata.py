"""The frame rate of OME-TIFF."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from torchsphere.recording import Recording, open_recording

IMAGES = np.zeros((8, 4, 6), np.uint16)


def write_ome(path: Path, **metadata: Any) -> Recording:
    tifffile.imwrite(path, IMAGES, ome=True, photometric="minisblack", metadata={"axes": "TYX", **metadata})
    return open_recording(path)


@pytest.mark.parametrize(
    ("value", "unit", "rate"),
    [(0.5, "ms", 2000), (20, "µs", 50_000), (1e-3, "s", 1000), (2, None, 0.5), (2, "min", 1 / 120)],
)
def test_the_time_increment_is_the_frame_rate(tmp_path: Path, value: float, unit: str | None, rate: float) -> None:
    stated = {"TimeIncrement": value} | ({} if unit is None else {"TimeIncrementUnit": unit})
    with write_ome(tmp_path / "a.ome.tif", **stated) as recording:
        assert recording.frame_rate == pytest.approx(rate)
        assert recording.origins["frame_rate"] == "OME TimeIncrement"
        assert recording.times is None
        assert not [note for note in recording.notes if "frame rate" in note]


@pytest.mark.parametrize("stated", [{}, {"TimeIncrement": 0.0}, {"TimeIncrement": 1.0, "TimeIncrementUnit": "pixel"}])
def test_without_a_time_there_is_no_rate(tmp_path: Path, stated: dict[str, Any]) -> None:
    with write_ome(tmp_path / "a.ome.tif", **stated) as recording:
        assert recording.frame_rate is None
        assert "no frame rate" in " ".join(recording.notes)


def planes(times: np.ndarray, unit: str) -> dict[str, Any]:
    return {"Plane": {"DeltaT": times.tolist(), "DeltaTUnit": [unit] * len(times)}}


def test_the_times_of_the_planes_win_over_the_increment(tmp_path: Path) -> None:
    times = np.arange(8) + 4.0 * (np.arange(8) >= 5)
    stated = {"TimeIncrement": 2.0, "TimeIncrementUnit": "ms"} | planes(times, "ms")
    with write_ome(tmp_path / "a.ome.tif", **stated) as recording:
        assert recording.frame_rate == pytest.approx(1000)
        assert recording.origins["frame_rate"] == "OME DeltaT"
        np.testing.assert_allclose(recording.times, times, atol=1e-6)
        assert "header states 500" in " ".join(recording.notes)
        assert "before image 5" in " ".join(recording.notes)


def test_times_that_agree_with_the_increment_leave_it(tmp_path: Path) -> None:
    stated = {"TimeIncrement": 2.0, "TimeIncrementUnit": "ms"} | planes(2.0 * np.arange(8), "ms")
    with write_ome(tmp_path / "a.ome.tif", **stated) as recording:
        assert recording.frame_rate == 500
        assert recording.times is None


def test_uneven_planes_keep_their_own_times_beside_an_increment(tmp_path: Path) -> None:
    # Their mean interval is known to 1 % only, and differs from the increment by less.
    times = 1.004 * np.arange(8) + np.array([0.0, 0.03, -0.02, 0.03, -0.01, 0.02, -0.03, 0.0])
    stated = {"TimeIncrement": 1.0, "TimeIncrementUnit": "ms"} | planes(times, "ms")
    with write_ome(tmp_path / "a.ome.tif", **stated) as recording:
        np.testing.assert_allclose(np.diff(recording.times) / recording.frame_rate, 1e-3 * np.diff(times), rtol=1e-6)
