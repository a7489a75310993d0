"""What is kept of a measured hypothesis."""

from typing import Any, cast

import numpy as np

from torchsphere.geometry.circle import Circle
from torchsphere.sphere_map.decision import MadeMap
from torchsphere.tracking.absolute_motion import AbsoluteMotion
from torchsphere.tracking.hypotheses import Hypothesis, Outcome
from torchsphere.tracking.record import Record

COUNT, CIRCLE = 5, Circle(10.0, 10.0, 8.0, 0.0, 0.0, 0.0, 0)


def outcome(on_map: list[bool], beside: list[bool]) -> Outcome:
    """Five frames that were measured, some of which are on a map, or lie beside the ball."""
    record = Record.empty(COUNT, CIRCLE)
    record.status[:], record.position[:], record.increment[:] = "ok", 10.0, 0.0
    arrays = record.position, record.increment, np.zeros((COUNT - 1, 5, 5)), np.tile(np.eye(3), (COUNT, 1, 1))
    motion = AbsoluteMotion(
        *arrays, np.full(COUNT, 8.0), np.zeros(COUNT - 1), CIRCLE, MadeMap(), np.array(on_map), record.increment
    )
    made = Outcome(cast(Any, None), cast(Any, None), record, motion)
    made.__dict__["beside"] = np.array(beside)
    return made


def test_a_frame_counts_where_it_was_measured_and_again_on_a_map_but_not_beside_the_ball() -> None:
    assert outcome([True] * 5, [False] * 5).score == 10
    assert outcome([True, True, False, False, False], [False] * 5).score == 7
    assert outcome([True, True, False, False, False], [False, False, False, True, True]).score == 5


def test_frames_beside_the_ball_never_stay_in_a_result() -> None:
    kept = outcome([True, True, True, False, False], [False, False, False, False, True]).without_frames_beside()
    assert np.isfinite(kept.motion.position[:, 0]).tolist() == [True, True, True, True, False]
    assert np.isfinite(kept.motion.increment[:, 0]).tolist() == [True, True, True, False]
    assert kept.record.status.tolist()[:4] == ["ok"] * 4
    assert kept.record.status[4] != "ok"


def test_a_score_must_be_more_than_its_share_of_the_best_unless_the_images_are_certain() -> None:
    task, start = cast(Any, None), cast(Any, None)
    assert not Hypothesis(task, start).beats(10, 10)
    assert Hypothesis(task, start).beats(11, 10)
    assert Hypothesis(task, start, kept_from=0.8).beats(9, 10)
    assert Hypothesis(task, start, is_certain=True).beats(0, 10)
