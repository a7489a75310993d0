"""Result folders of a Python session, as ``torchsphere track`` writes them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.motion.track import Track
from torchsphere.notebook.measured import measurement, request_for, track_of
from torchsphere.recording import Recording
from torchsphere.recording.frame_range import restrict
from torchsphere.report import draw, frame_sampling
from torchsphere.results import sampled_frames, writer
from torchsphere.results.atomic_output import atomic_folder
from torchsphere.results.exports import check_exports


def save(
    subject: Track | Kinematics,
    folder: str | os.PathLike[str],
    *,
    recording: Any = None,
    normal_deg: float | None = None,
    report: bool = True,
    export: Sequence[str] = (),
    overwrite: bool = False,
) -> Path:
    """Write a result folder, whole or not at all; see `Track.save` and `Kinematics.save`."""
    place = Path(folder)
    export = (export,) if isinstance(export, str) else tuple(export)
    check_exports(export)
    motion = subject if isinstance(subject, Kinematics) else None
    track = subject if isinstance(subject, Track) else track_of(subject)
    if motion is not None and motion.about.get("loaded"):
        raise ValueError(
            "the motion was loaded, and its drawn motions were not kept; copy its folder, or save "
            "torchsphere.kinematics of the loaded track"
        )
    images = None if recording is None or not report else _same_frames(recording, track)
    try:
        with atomic_folder(place, overwrite) as new:
            done = measurement(track, motion, normal_deg, hashed=True)
            request = request_for(track, motion, place, normal_deg)
            writer.write_measurement(new, request, done, track.calibration.frame_rate, export)
            if images is not None:
                sampled_frames.save(new / "frames.npz", frame_sampling.sample(images, track))
            if report:
                draw.draw(new)
    except FileExistsError as error:
        raise FileExistsError(str(error).replace("`overwrite`", "overwrite=True")) from error
    return place


def _same_frames(recording: Any, track: Track) -> Any:
    """The frames of the track; ValueError for a recording of another length."""
    n, first = len(track.status), track.first_frame
    whole = n if track.facts is None else track.facts.shape[0]
    if len(recording) == n:
        return recording
    if len(recording) != whole or whole < first + n:
        raise ValueError(
            f"recording: has {len(recording)} images, and the track {n} of {whole}; give the recording that was tracked"
        )
    return restrict(recording, first, first + n) if isinstance(recording, Recording) else recording[first : first + n]
