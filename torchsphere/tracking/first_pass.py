"""The motion from frame to frame, from a start; a circle in doubt is tried on a few pairs first."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from torchsphere.correlation.frame_status import ALL_KNOWN, TRANSLATION_KNOWN
from torchsphere.detection.ball_or_not import needs_proof, shows_outline
from torchsphere.runtime import steps
from torchsphere.runtime.steps import LOG
from torchsphere.tracking.follow import Follower
from torchsphere.tracking.record import Record
from torchsphere.tracking.start import Start
from torchsphere.tracking.task import Task

#: Pairs by which a circle in doubt is tested, and share of these that must be measured (docs/constants.toml).
TRIAL_PAIRS, TRIAL_SHARE = 12, 0.25

#: Failed searches over rotations after which the rest of these pairs is tried without (docs/constants.toml).
TRIAL_SEARCHES = 2


def follow(task: Task, start: Start) -> Record:
    """The motion from frame to frame; of a few pairs alone where these show no ball."""
    first, options = start.circle, start.options
    is_seen = task.circle is None or shows_outline(start.image, first, options.camera)
    record = None
    if first.doubt or not is_seen:
        steps.tell("testing the circle %s px, which its image leaves in doubt", first.text())
        record = failed_trial(task, start)
    if record is None:
        LOG.info("following the circle %s px of frame %d with the model %s", first.text(), first.frame, options.model)
        calls: dict[str, Any] = {"progress": task.progress, "watch": task.watch}
        follower = Follower(task.source, first, task.ignore, options, in_place=task.in_place, **calls)
        record = follower.run(task.source.count)
    if not is_seen and not record.is_confirmed(first.frame):
        # Neither its own image nor any other supports the given circle.
        record = record.without(first.frame)
    return record.without_rotation() if options.model == "translation" else record


def failed_trial(task: Task, start: Start) -> Record | None:
    """The record of a few pairs after a start in doubt, if hardly one of these was measured; else None.

    Each frame that fails takes a search: a circle that no image supports is not looked for in all of them.
    """
    first, count = start.circle, task.source.count
    stop = min(first.frame + 1 + TRIAL_PAIRS, count)
    follower = Follower(task.source, first, task.ignore, start.options, in_place=task.in_place, searches=TRIAL_SEARCHES)
    record = follower.run(stop)
    tried = record.status[first.frame + 1 : stop]
    # A map proves a circle that was found, and needs its texture; a lamp has an outline, too.
    needs_texture = task.circle is None and not task.in_place and needs_proof(first)
    if np.isin(tried, ALL_KNOWN if needs_texture else TRANSLATION_KNOWN).sum() >= TRIAL_SHARE * len(tried):
        return None
    return dataclasses.replace(record, untried=count - stop)
