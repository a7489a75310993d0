"""One recording from its file to its result folder: what ``torchsphere track`` and ``torchsphere demo`` do."""

from __future__ import annotations

import functools
import math
import platform
import shutil
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import kornia
import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere import parallel, results
from torchsphere.choices import MAPS
from torchsphere.circle import Circle
from torchsphere.drift import STEP_PER_RADIUS
from torchsphere.follow import Progress
from torchsphere.impact import Impact, ball, impact
from torchsphere.joint import ALONE, Solver, together
from torchsphere.kinematics import ROTATION_PER_RADIUS, Kinematics, kinematics
from torchsphere.masks import read_ignore
from torchsphere.mean_motion import mean_motion
from torchsphere.recording import Recording, open_recording
from torchsphere.report import draw, kept, overlay, paraview, sampled
from torchsphere.report.folder import read
from torchsphere.report.words import NO_IMPACT
from torchsphere.request import Request, require_shell_within
from torchsphere.setting import SettingError
from torchsphere.track import Track, track
from torchsphere.unused import unused

__all__ = ["Measurement", "Request", "circle_text", "measure", "measure_jointly", "versions"]


@dataclass(frozen=True)
class Measurement:
    """What was measured of one recording; ``name`` is what to call it where its path would tell nothing."""

    recording: Recording
    track: Track
    motion: Kinematics | None
    impact: Impact | None
    first_frame: int
    warnings: tuple[str, ...]
    seconds: float
    extra_files: Mapping[str, Path] = field(default_factory=dict)
    name: str | None = None


def measure(
    request: Request,
    progress: Progress | None = None,
    extra: Mapping[str, Path] | None = None,
    *,
    name: str | None = None,
    solver: Solver = ALONE,
) -> Measurement:
    """Track the recording and write the result folder; files of ``extra`` (name -> source) are copied into it.

    ``name`` stands in the summary in place of the input's path, where that is a temporary one; ``solver`` is what
    measures the pairs.

    Raises
    ------
    ValueError, OSError
        With one sentence on what is wrong; then nothing has been written.
    """
    results.check_folder(request.out, request.overwrite)
    if request.overlay:
        overlay.check_library()
    if request.device.startswith("cuda") and not torch.cuda.is_available():
        raise ValueError(
            "--device cuda was asked for, but torch finds no CUDA device here; leave it out to use the CPU"
        )
    began = time.perf_counter()
    with open_recording(request.input) as recording:
        start, stop = _frames(request.frames, len(recording))
        part = _part(recording, start, stop)
        options: dict[str, Any] = {"model": request.model, "camera": request.camera()}
        if request.roi is not None:
            options["roi"] = request.roi
        ignore = read_ignore(request.ignore, recording.shape[1:]) if request.ignore else None
        tracked = track(
            part,
            request.circle,
            ignore=ignore,
            device=request.device,
            refine=request.refine,
            in_place=request.in_place,
            sphere_map=MAPS[request.map],
            progress=progress,
            solver=solver,
            **options,
        )
        frame_rate = request.fps or recording.frame_rate
        with parallel.one_each():
            motion = _kinematics(request, tracked, frame_rate, start)
            found, missing = _impact(request, tracked, motion)
            warnings = (
                *_warnings(request, recording, tracked, frame_rate, start),
                *missing,
                *unused(request, motion, found, has_rate=frame_rate is not None),
            )
            seconds = time.perf_counter() - began
            done = Measurement(recording, tracked, motion, found, start, warnings, seconds, extra or {}, name)
            _write(request, done, frame_rate, part, ignore)
    return done


@functools.cache
def _of_this_process() -> Solver:
    return together()


def measure_jointly(
    request: Request, progress: Progress | None = None, extra: Mapping[str, Path] | None = None
) -> Measurement:
    """`measure` for the threads of a process: the pairs of their recordings come into common batches."""
    return measure(request, progress, extra, solver=_of_this_process())


def _frames(asked: tuple[int | None, int | None], count: int) -> tuple[int, int]:
    if count < 2:
        raise ValueError("the recording has one frame; motion needs two or more")
    start, stop = (0 if asked[0] is None else asked[0]), (count if asked[1] is None else asked[1])
    given = ":".join("" if end is None else str(end) for end in asked)
    there = f"the recording has {count} frames, 0 to {count - 1}"
    if start < 0 or stop < 0:
        raise SettingError(
            f"`frames` = {given} counts from the end, and frames are counted from 0; {there}, so give numbers from "
            f"0 to {count}, as in {max(count - 5, 0)}: for the last {min(count, 5)}"
        )
    if stop > count or start >= count:
        raise SettingError(f"`frames` = {given} reaches beyond the end; {there}, so give numbers up to {count}")
    if stop - start < 2:
        first = min(start, max(count - 2, 0))
        holds = "holds one frame, and motion needs two or more" if stop - start == 1 else "holds no frame"
        raise SettingError(
            f"`frames` = {given} {holds}, as the number behind the colon is the first that is left out; {there}, so "
            f"give a longer range, as in {first}:{min(first + 2, count)}"
        )
    return start, stop


def _part(recording: Recording, start: int, stop: int) -> Recording:
    """The frames ``start`` to ``stop`` as a recording of their own."""
    if (start, stop) == (0, len(recording)):
        return recording
    return Recording(
        path=recording.path,
        kind=recording.kind,
        shape=(stop - start, *recording.shape[1:]),
        bit_depth=recording.bit_depth,
        _reader=lambda a, b: recording.images(start + a, start + b),
    )


def _kinematics(request: Request, tracked: Track, frame_rate: float | None, start: int) -> Kinematics | None:
    if frame_rate is None or (request.diameter_mm is None and request.mm_per_px is None):
        return None
    return kinematics(
        tracked,
        frame_rate=frame_rate,
        diameter_m=None if request.diameter_mm is None else 1e-3 * request.diameter_mm,
        m_per_px=None if request.mm_per_px is None else 1e-3 * request.mm_per_px,
        mass_kg=None if request.mass_g is None else 1e-3 * request.mass_g,
        lab_frame=request.lab_frame,
        first_frame=start,
        relative_sd_scale=request.scale_sd_percent / 100,
        method=request.method,
        window=request.window,
        order=request.order,
    )


def _impact(request: Request, tracked: Track, motion: Kinematics | None) -> tuple[Impact | None, tuple[str, ...]]:
    """The impact, if there is one, and in words what of it is not known, and why."""
    if motion is None:
        return None, ()
    if not np.isfinite(tracked.increment[:, 0]).any():
        # Without this, "one steady motion explains all frames" would be said of frames that show none.
        return None, (f"{NO_IMPACT}no motion was measured.",)
    thing = None
    if request.mass_g is not None:
        radius_m = tracked.circle.radius * motion.scale.m_per_px
        if request.shell_mm is not None and request.diameter_mm is None:
            require_shell_within(request.shell_mm, 1e3 * radius_m)
        thing = ball(
            1e-3 * request.mass_g,
            2 * radius_m,
            shell_m=None if request.shell_mm is None else 1e-3 * request.shell_mm,
            inertia_kg_m2=request.inertia_kg_m2,
        )
    found, reason = impact(motion, thing, normal_deg=request.normal_deg)
    return found, found.missing if found is not None else (f"{NO_IMPACT}{reason}",)


def _warnings(
    request: Request, recording: Recording, tracked: Track, frame_rate: float | None, start: int
) -> tuple[str, ...]:
    """Sentences that a reader of the result has to know."""
    # What the file lacks and the user gave is nothing to know of.
    found = [note for note in recording.notes if request.fps is None or "no frame rate" not in note]
    n = len(tracked.status)
    bad = n - int((tracked.status == "ok").sum())
    if bad:
        counts = ", ".join(f"{count} {name}" for name, count in results.status_counts(tracked).items())
        found.append(f"{bad} of {n} frames were not fully measured: {counts}.")
    repeated = tracked.settings["repeated_frames"]
    if repeated:
        numbers = ", ".join(str(start + i) for i in repeated)
        found.append(
            f"Frames that repeat the image before them bit for bit while the ball moves, not measured: {numbers}."
        )
    if frame_rate is None:
        found.append("The frame rate is not known, so there are no times and no kinematics; give --fps.")
    elif recording.frame_rate is not None and request.fps is not None and request.fps != recording.frame_rate:
        found.append(f"The file states {recording.frame_rate:g} frames/s; {request.fps:g} was given and used.")
    if request.diameter_mm is None and request.mm_per_px is None:
        found.append("No scale was given, so there are no kinematics; give --diameter-mm or --mm-per-px.")
    if math.isnan(tracked.circle.sd_radius):
        found.append("The circle was given without an uncertainty; what it adds to the results' is not included.")
    if tracked.settings["circle_refined"] and tracked.circle.doubt:
        found.append(tracked.circle.doubt)
    if request.mm_per_px is not None:
        found.append("The scale was given and taken as exact; its uncertainty is not included.")
    about_map = tracked.settings["sphere_map"]
    if not about_map["used"] and not request.in_place and _turns_in_place(tracked):
        found.append(
            "The ball turns fast and hardly moves; if it cannot leave its place, say --in-place against drift."
        )
    if not about_map["used"] and request.map != "off" and not about_map["reason"].startswith("not needed"):
        found.append(f"Poses rest on the frame-to-frame steps, whose errors add up: {about_map['reason']}.")
    if request.model == "published":
        found.append("The published modes are no rigid rotation: they bias translation and rotation; see the README.")
    if request.model == "translation":
        found.append("The translation model takes any rotation of the ball for translation.")
    return tuple(found)


def _turns_in_place(tracked: Track) -> bool:
    """Whether the ball turns by more than it moves: more than 1 deg per frame, less than two radii in all."""
    turn = np.linalg.norm(tracked.increment[:, 2:], axis=1)
    known = tracked.position[np.isfinite(tracked.position[:, 0])]
    reach = float(np.ptp(known, axis=0).max()) if len(known) else np.inf
    swept = np.nansum(turn) * tracked.circle.radius
    fast = bool(np.isfinite(turn).any()) and float(np.nanmedian(turn)) > np.radians(1.0)
    return fast and reach < 2 * tracked.circle.radius and swept > 3 * reach


def _write(
    request: Request,
    done: Measurement,
    frame_rate: float | None,
    part: Recording,
    ignore: NDArray[np.bool_] | None,
) -> None:
    with results.whole_folder(request.out, request.overwrite) as folder:
        results.write_track(folder, done.track, frame_rate, done.first_frame)
        if done.motion is not None:
            results.write_kinematics(folder, done.motion, done.first_frame)
        for name, source in done.extra_files.items():
            shutil.copyfile(source, folder / name)
        results.write_summary(folder, _summary(request, done, frame_rate))
        if request.report:
            mask = None if ignore is None else torch.from_numpy(ignore)
            kept.save(folder / "frames.npz", sampled.sample(part, done.track, mask))
            # From what was written, so that the folder alone is always enough to draw it again.
            draw.draw(folder)
        _export(request, folder)


def _export(request: Request, folder: Path) -> None:
    """What was asked for beside figures and report, made from what was written."""
    if not (request.overlay or request.paraview):
        return
    result = read(folder)
    if request.overlay:
        overlay.write_overlay(result)
    if request.paraview and result.known.any():
        paraview.write_paraview(result)


def _summary(request: Request, done: Measurement, frame_rate: float | None) -> dict[str, Any]:
    recording, tracked = done.recording, done.track
    circle = tracked.circle
    return {
        "input": {
            "path": done.name or str(request.input),
            "sha256": results.hash_files(recording.files),
            "kind": recording.kind,
            "frames": len(recording),
            "first_frame": done.first_frame,
            "last_frame": done.first_frame + len(tracked.status) - 1,
            "width_px": recording.shape[2],
            "height_px": recording.shape[1],
            "bit_depth": recording.bit_depth,
            "exposure_s": recording.exposure_s,
            "trigger_offset_frames": recording.trigger_offset_frames,
            "origins": dict(recording.origins),
        },
        "frame_rate": frame_rate,
        "frame_rate_origin": "given" if request.fps is not None else recording.origins.get("frame_rate"),
        "circle": {**vars(circle), "frame": done.first_frame + circle.frame, "unit": "px"},
        "radius_effect": _radius_effect(tracked),
        "scale": None if done.motion is None else vars(done.motion.scale),
        "frames_per_status": results.status_counts(tracked),
        "mean_motion": mean_motion(tracked, done.motion),
        "axes": "lab frame: x right, y up, z to the camera" if request.lab_frame else "camera frame: x right, y down",
        "settings": {k: v for k, v in vars(request).items() if k not in ("input", "out")} | tracked.settings,
        "differentiation": None if done.motion is None else done.motion.about,
        "impact": None if done.impact is None else done.impact.summary(),
        "contact_s": None if done.motion is None else done.motion.contact_s,
        "warnings": list(done.warnings),
        "seconds": round(done.seconds, 3),
        "versions": versions(),
    }


def _radius_effect(tracked: Track) -> dict[str, float]:
    """What the radius's standard deviation does to the mean step (px) and to all rotations (relative)."""
    turn = float(np.linalg.norm(np.nan_to_num(tracked.increment[:, 2:4]), axis=1).mean())
    sd = tracked.circle.sd_radius
    return {
        "sd_radius_px": sd,
        "sd_mean_step_px": STEP_PER_RADIUS * turn * sd,
        "relative_sd_rotation": ROTATION_PER_RADIUS * sd / tracked.circle.radius,
    }


def versions() -> dict[str, str]:
    """Versions of what computed the result."""
    from torchsphere import __version__

    return {
        "torchsphere": __version__,
        "torch": torch.__version__,
        "kornia": kornia.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }


def circle_text(circle: Circle) -> str:
    """The circle as ``--circle`` takes it."""
    return f"{circle.x:.2f},{circle.y:.2f},{circle.radius:.2f}"
