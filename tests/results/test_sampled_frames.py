"""Frames that a result keeps: the choice of frames, and the same images after saving and loading."""

from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from torchsphere.results.reader import ResultFolder
from torchsphere.results.sampled_frames import MAX_FRAMES, load, rows_to_keep, save


@given(
    bad=st.lists(st.integers(0, 1999), max_size=1500, unique=True),
    worst=st.integers(1, 1999),
    count=st.integers(2, 2000),
)
def test_kept_frames_include_ends_worst_match_and_unmeasured_frames(bad: list[int], worst: int, count: int) -> None:
    status = np.full(count, "ok", dtype="<U16")
    status[[i for i in bad if i < count]] = "lost"
    zncc = np.full(count, 0.99)
    zncc[worst % count] = 0.7
    rows = rows_to_keep(status, zncc)
    assert len(rows) == min(count, MAX_FRAMES)
    assert (np.diff(rows) > 0).all()
    assert {0, count - 1, worst % count} <= set(rows.tolist())
    failed = set(np.flatnonzero(status != "ok").tolist())
    if len(failed) <= MAX_FRAMES // 2:
        assert failed <= set(rows.tolist())


def test_kept_images_come_back_from_their_file_bit_for_bit(result: ResultFolder, tmp_path: Path) -> None:
    assert result.sampled is not None
    save(tmp_path / "frames.npz", result.sampled)
    again = load(tmp_path / "frames.npz")
    assert again.webp == result.sampled.webp
    assert again.box == result.sampled.box
    np.testing.assert_array_equal(again.residual, result.sampled.residual)
