"""Sentences on a result: every status has an explanation, without repetition."""

import numpy as np

from torchsphere.correlation.frame_status import STATUSES
from torchsphere.report import explanations


def test_runs_of_frames_are_named_by_their_ends() -> None:
    assert explanations.frame_runs(np.array([3, 7, 8, 9, 12])) == "3, 7-9, 12"
    assert explanations.frame_runs(np.arange(0, 20, 2), most=3) == "0, 2, 4 and 7 more runs"


def test_every_status_has_a_meaning_and_a_remedy() -> None:
    assert tuple(explanations.STATUSES) == STATUSES
    assert all(meaning and (remedy or name == "ok") for name, (meaning, remedy) in explanations.STATUSES.items())
