"""Quantities over time, in the frame of the result."""

import dataclasses

import numpy as np

from torchsphere.report.time_series import time_series
from torchsphere.results.reader import ResultFolder


def test_the_lab_frame_turns_the_shown_angles_over_as_the_axes(result: ResultFolder) -> None:
    settings = result.summary["settings"] | {"lab_frame": True}
    lab = dataclasses.replace(result, summary=result.summary | {"settings": settings})
    here, there = (next(p for p in time_series(r) if p.key == "turned").values for r in (result, lab))
    np.testing.assert_array_equal(there, here * [1, -1, -1])
