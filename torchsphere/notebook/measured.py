"""A track and its motion as a measurement and as a result folder, as ``torchsphere track`` writes and reads them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from torchsphere.diagnostics.impact_warnings import impact_warnings
from torchsphere.dynamics.contact_law import ContactForce, contact_force
from torchsphere.dynamics.impact import impact, impacts
from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.geometry.orientation import quaternions
from torchsphere.motion.track import Track
from torchsphere.recording.facts import Facts
from torchsphere.report.explanations import NO_IMPACT
from torchsphere.request import Request
from torchsphere.results.columns import force_path_columns, track_columns
from torchsphere.results.reader import ForcePathTable, ResultFolder, SIMotion
from torchsphere.results.writer import Measurement, plain, summary
from torchsphere.runtime.file_hash import hash_files
from torchsphere.settings.choices import METHODS


def track_of(motion: Kinematics) -> Track:
    """The track of a motion; ValueError for a motion that was not made by `kinematics`."""
    if motion.track is None:
        raise ValueError("the motion has no track; make it with torchsphere.kinematics")
    return motion.track


def measurement(
    track: Track, motion: Kinematics | None = None, normal_deg: float | None = None, *, hashed: bool = False
) -> Measurement:
    """The measurement of a track and its motion, with the impacts of the motion.

    ``hashed``: read the files of the recording, where they still are, for the hash that identifies them.
    """
    found: Impact | None = None
    notes: list[str] = []
    every: list[Impact] = []
    if motion is not None:
        found, reason = impact(motion, normal_deg=normal_deg, log=False)
        every = impacts(motion, normal_deg=normal_deg, log=False)
        notes = [f"{NO_IMPACT}{reason[0].lower()}{reason[1:]}"] if found is None else [*found.missing]
        notes += [] if found is None else impact_warnings(motion, found)
    forces = () if motion is None else tuple(contact_force(motion, one, normal_deg=normal_deg) for one in every)
    warnings = dict.fromkeys((*track.warnings, *(() if motion is None else motion.warnings), *notes))
    facts = track.facts or Facts(path=Path(), kind="array", shape=(track.first_frame + len(track.status), 0, 0))
    return Measurement(
        recording=facts,
        track=track,
        motion=motion,
        impact=found,
        first_frame=track.first_frame,
        warnings=tuple(warnings),
        seconds=0.0,
        sha256=hash_files(facts.files) if hashed and all(path.is_file() for path in facts.files) else "",
        name=None if facts.files else facts.kind,
        impacts=tuple(every),
        contact_forces=forces,
    )


def request_for(track: Track, motion: Kinematics | None, folder: Path, normal_deg: float | None = None) -> Request:
    """The settings of the command line with which this track and its motion would have been measured."""
    known, facts = track.calibration, track.facts
    options: dict[str, Any] = dict(known.options())
    if facts is not None and facts.frame_rate == known.frame_rate:
        options.pop("fps", None)
    if known.diameter_m is None and known.m_per_px is None:
        options.pop("mass_g", None)
    of_motion: dict[str, Any] = {}
    if motion is not None:
        method = motion.about.get("method")
        of_motion = {
            "lab_frame": motion.lab_frame,
            "method": method if method in METHODS else METHODS[0],
        }
    circle = track.circle
    return Request(
        input=Path("array") if facts is None or not facts.files else facts.path,
        out=folder,
        circle=(circle.x, circle.y, circle.radius) if track.settings.get("circle_given") else None,
        normal_deg=normal_deg,
        **options,
        **of_motion,
    )


def result_folder(done: Measurement, normal_deg: float | None = None) -> ResultFolder:
    """The measurement as a result folder that is nowhere written: for figures, without images."""
    track, motion = done.track, done.motion
    request = request_for(track, motion, Path(), normal_deg)
    rate = track.calibration.frame_rate
    columns = track_columns(track, rate, track.first_frame)
    first = np.full((1, 5), np.nan)
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2))
    contents = plain(summary(request, done, rate))
    return ResultFolder(
        path=Path(),
        summary=contents,
        frame=columns["frame"],
        time_s=columns["time_s"],
        status=track.status,
        position=track.position,
        radius=columns["radius_px"],
        increment=np.concatenate((first, track.increment)),
        sd_increment=np.concatenate((first, sd)),
        zncc=track.zncc,
        quaternion=quaternions(track.orientation),
        motion=None if motion is None else _si_motion(motion),
        sampled=None,
        force_path=_force_path(done),
    )


def _si_motion(motion: Kinematics) -> SIMotion:
    return SIMotion(**{name: getattr(motion, name) for name in SIMotion.__dataclass_fields__})


def _force_path(done: Measurement) -> ForcePathTable | None:
    """Force against penetration of the strongest impact."""
    starts = [float(one.contact_start.value) for one in done.impacts]
    if done.impact is None or float(done.impact.contact_start.value) not in starts:
        return None
    force = done.contact_forces[starts.index(float(done.impact.contact_start.value))]
    columns = force_path_columns([force], done.first_frame)
    if not columns:
        return None
    names = ("penetration_m", "force_N", "sd_penetration_m", "sd_force_N")
    return ForcePathTable(is_loading=columns["branch"] == "loading", **{name: columns[name] for name in names})


def with_force(found: Impact) -> Measurement:
    """The measurement of an impact alone, with its force against penetration; ValueError where there is no force."""
    motion = found.motion
    if motion is None or motion.about.get("loaded"):
        raise ValueError(
            "the impact was loaded, and its drawn motions were not kept; plot the folder: torchsphere.load(folder).plot"
            "('force_path')"
        )
    # Only a target whose normal was given has a tangential velocity.
    is_given = found.tangential_velocity_ratio is not None
    force: ContactForce = contact_force(
        motion, found, normal_deg=float(found.normal_direction.value) if is_given else None
    )
    if force.path is None:
        raise ValueError(f"the impact has no force to plot: {force.missing[:1].lower()}{force.missing[1:]}")
    track = track_of(motion)
    facts = track.facts or Facts(path=Path(), kind="array", shape=(len(track.status), 0, 0))
    return Measurement(
        *(facts, track, motion, found, track.first_frame, (), 0.0, ""), impacts=(found,), contact_forces=(force,)
    )
