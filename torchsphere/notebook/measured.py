"""A track and its motion as a measurement and as a result folder, as ``torchsphere track`` writes and reads them."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from torchsphere.diagnostics.impact_warnings import found_impacts
from torchsphere.dynamics.contact_law import ContactForce, contact_force
from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.motion.track import Track
from torchsphere.recording.facts import Facts
from torchsphere.request import Request
from torchsphere.results.reader import ResultFolder, read
from torchsphere.results.writer import Measurement, write_measurement
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
    found, every, notes = (None, (), ()) if motion is None else found_impacts(motion, None, normal_deg)
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
        impacts=every,
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
    """The measurement as a result folder that is kept nowhere: for figures, without images."""
    rate, path = done.track.calibration.frame_rate, Path()
    with tempfile.TemporaryDirectory() as place:
        write_measurement(Path(place), request_for(done.track, done.motion, path, normal_deg), done, rate)
        return replace(read(Path(place)), path=path)


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
