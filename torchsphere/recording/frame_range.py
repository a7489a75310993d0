"""Some of the frames of a recording: the range that is measured, and a few that stand for many."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording import Recording
from torchsphere.settings.limits import SettingError


def resolve_range(asked: tuple[int | None, int | None], count: int) -> tuple[int, int]:
    """First frame and the frame after the last, of ``count`` frames; raises ValueError for fewer than two frames."""
    if count < 2:
        raise ValueError("the recording has one frame, and motion needs two or more: give the whole recording")
    start, stop = (0 if asked[0] is None else asked[0]), (count if asked[1] is None else asked[1])
    given = ":".join("" if end is None else str(end) for end in asked)
    there = f"the recording has {count} frames, 0 to {count - 1}"
    if start < 0 or stop < 0:
        raise SettingError(
            f"`frames` = {given} counts from the end, and frames are counted from 0; {there}, so give numbers from "
            f"0 to {count}, as in {max(count - 5, 0)}: for the last {min(count, 5)}"
        )
    if start >= count:
        raise SettingError(
            f"`frames` = {given} starts behind the last frame; {there}, so give a first number below {count}, and "
            f"below {count - 1} for the two frames that motion needs"
        )
    if stop > count:
        raise SettingError(
            f"`frames` = {given} reaches beyond the end; {there}, so give {count} at most behind the colon, which is "
            "the first frame that is left out"
        )
    if stop - start < 2:
        first = min(start, max(count - 2, 0))
        holds = "holds one frame, and motion needs two or more" if stop - start == 1 else "holds no frame"
        raise SettingError(
            f"`frames` = {given} {holds}, as the number behind the colon is the first that is left out; {there}, so "
            f"give a longer range, as in {first}:{min(first + 2, count)}"
        )
    return start, stop


def spread(frames: NDArray[Any], most: int) -> NDArray[Any]:
    """Up to ``most`` of the ``frames`` (m, ...), evenly between the first and the last."""
    return frames[np.unique(np.linspace(0, len(frames) - 1, min(most, len(frames))).round().astype(int))]


def restrict(recording: Recording, start: int, stop: int) -> Recording:
    """The frames ``start`` to ``stop - 1`` as a recording."""
    if (start, stop) == (0, len(recording)):
        return recording
    return Recording(
        path=recording.path,
        kind=recording.kind,
        shape=(stop - start, *recording.shape[1:]),
        bit_depth=recording.bit_depth,
        doubt=recording.doubt,
        pixel_aspect=recording.pixel_aspect,
        orientation=recording.orientation,
        bayer=recording.bayer,
        frame_rate=recording.frame_rate,
        exposure_s=recording.exposure_s,
        times=None if recording.times is None else recording.times[start:stop],
        _reader=lambda a, b: recording.images(start + a, start + b),
    )
