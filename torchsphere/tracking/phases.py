"""The phases of `track`: initial circle -> what explains most of the images -> the track and its evidence."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from torchsphere.correlation.options import Options
from torchsphere.detection.ball_or_not import require_ball
from torchsphere.errors.evidence import Evidence
from torchsphere.motion import findings
from torchsphere.motion.findings import Findings
from torchsphere.motion.track import Track
from torchsphere.tracking import growth, in_place
from torchsphere.tracking.hypotheses import Outcome, Place, best_outcome
from torchsphere.tracking.start import prepared
from torchsphere.tracking.task import Task


class Assembled(NamedTuple):
    """A track without the errors of the ledger, and what these are found by."""

    track: Track
    evidence: Evidence


def run(task: Task, settings: Options, given: dict[str, Any]) -> Assembled:
    """All phases. Options that were ``given`` are not adapted to the ball."""
    ready = prepared(task, settings, given)
    require_ball(ready.start.circle)
    found, evidence = _assembled(best_outcome(ready.task, ready.start))
    known = dataclasses.replace(found.findings, interlaced=ready.interlaced, mosaic=ready.mosaic)
    return Assembled(dataclasses.replace(found, findings=known), evidence)


def _assembled(outcome: Outcome) -> Assembled:
    """The track of an outcome, and what its errors are found by."""
    task, start, record, motion, place = outcome.task, outcome.start, outcome.record, outcome.motion, outcome.place
    motion, drift = (motion, np.zeros(2)) if place is None else in_place.held(motion)
    track = Track(
        position=motion.position,
        increment=motion.increment,
        covariance=motion.covariance,
        orientation=motion.orientation,
        zncc=record.zncc,
        iterations=record.iterations,
        status=record.status,
        radius=motion.radius,
        sd_growth=motion.sd_growth,
        sd_steady=np.zeros(5),
        circle=motion.circle,
        settings=dataclasses.asdict(start.options)
        | {
            "circle_given": task.circle is not None,
            "circle_refined": task.circle is None or task.refine,
            "in_place": task.in_place,
            "telecentric": task.telecentric,
            "device": str(task.source.device),
            "dtype": str(task.source.dtype).removeprefix("torch."),
        },
        findings=Findings(
            map=motion.map,
            grows=start.grows and growth.is_confirmed(motion.radius, motion.map),
            camera_assumed=start.is_camera_assumed,
            repeated_frames=tuple(record.repeated),
            untried_frames=record.untried,
            outline_scatter=outcome.outline_scatter,
            place=None if place is None else _finding(place, drift),
        ),
    )
    evidence = Evidence(
        source=task.source,
        ignore=task.ignore,
        image=start.image,
        contrast=start.contrast,
        options=start.options,
        given=start.given,
        exposure=task.stated_exposure if task.exposure is None else task.exposure,
        position=motion.position,
        circle=motion.circle,
        on_map=motion.on_map,
        uneven_light=record.uneven_share,
        residual_factors=motion.residual_factors,
        unseen_step_px=_unseen_step(place),
    )
    return Assembled(track, evidence)


def _finding(place: Place, drift: NDArray[np.float64]) -> findings.Place:
    """What was found of a ball in its place, against whose steps, with the sum ``drift`` (2,), it was held."""
    limb = place.limb
    return findings.Place(
        recognised=place.is_recognised,
        steps_sum_px=(float(drift[0]), float(drift[1])),
        first_radius_px=place.first_radius_px,
        limbs=None if limb is None else len(limb.frames),
        limbs_stay=limb is not None and limb.stays,
        limbs_radius_px=math.nan if limb is None else float(limb.circle[2]),
        limbs_sd_px=() if limb is None else tuple(limb.sd.tolist()),
        limbs_radius_used=place.is_limbs_radius_used,
    )


def _unseen_step(place: Place | None) -> tuple[float, float]:
    """Standard deviation of a steady step that the limbs of a ball in its place hide, px."""
    if place is None or place.limb is None or not place.limb.stays:
        return 0.0, 0.0
    sd_x, sd_y = in_place.sd_unseen_step(place.limb).tolist()
    return sd_x, sd_y
