"""One recording from its file to its result folder: what ``torchsphere track`` and ``torchsphere demo`` do."""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.diagnostics.impact_warnings import impact_warnings
from torchsphere.diagnostics.track_warnings import bandwidth_warnings, track_warnings, window_warnings
from torchsphere.diagnostics.unused_settings import unused
from torchsphere.dynamics.ball import ball
from torchsphere.dynamics.impact import impact
from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics, kinematics
from torchsphere.recording import Recording, open_recording
from torchsphere.recording.frame_range import frames, part
from torchsphere.recording.ignore_mask import hides_ball, read_ignore, without_effect
from torchsphere.report import draw, frame_sampling, overlay, paraview
from torchsphere.report.explanations import NO_IMPACT
from torchsphere.request import Request, require_shell_within
from torchsphere.results import atomic_output, sampled_frames, writer
from torchsphere.results.reader import read
from torchsphere.results.summary import Measurement, summary, versions
from torchsphere.runtime import threads
from torchsphere.runtime.file_hash import hash_files
from torchsphere.settings.choices import MAPS
from torchsphere.tracking.follow import Progress
from torchsphere.tracking.track import Track, track

__all__ = ["Measurement", "Request", "measure", "versions"]


def measure(
    request: Request,
    progress: Progress | None = None,
    extra: Mapping[str, Path] | None = None,
    *,
    name: str | None = None,
) -> Measurement:
    """Track the recording and write the result folder; files of ``extra`` (name -> source) are copied into it.

    ``name`` stands in the summary in place of the input's path, where that is a temporary one.

    Raises
    ------
    ValueError, OSError
        With one sentence on what is wrong; then nothing has been written.
    """
    atomic_output.check_folder(request.out, request.overwrite)
    if request.overlay:
        overlay.check_library()
    if request.device.startswith("cuda") and not torch.cuda.is_available():
        raise ValueError(
            "--device cuda was asked for, but torch finds no CUDA device here; leave it out to use the CPU"
        )
    began = time.perf_counter()
    with open_recording(request.input) as recording:
        start, stop = frames(request.frames, len(recording))
        with draw.drawing_process(_draws_beside(request, stop - start)) as pool, threads.one_each():
            hashed = draw.begin(pool, hash_files, recording.files)
            chosen = part(recording, start, stop)
            ignore = read_ignore(request.ignore, recording.shape[1:]) if request.ignore else None
            tracked = _track(request, chosen, ignore, progress)
            frame_rate = request.fps or recording.frame_rate
            motion = _kinematics(request, tracked, frame_rate, start)
            found, doubts = _impact(request, tracked, motion)
            circle = tracked.circle
            warnings = (
                *track_warnings(request, recording, tracked, frame_rate, start),
                *window_warnings(tracked, motion),
                *bandwidth_warnings(motion),
                *doubts,
                *unused(request, motion, found, has_rate=frame_rate is not None),
                *without_effect(request.ignore, recording.shape[1:]),
                *hides_ball(ignore, circle.x, circle.y, circle.radius, start + circle.frame),
            )
            seconds = time.perf_counter() - began
            sha256 = hashed.result() if hashed is not None and not draw.failed(hashed) else hash_files(recording.files)
            done = Measurement(recording, tracked, motion, found, start, warnings, seconds, sha256, extra or {}, name)
            _write(request, done, frame_rate, chosen, ignore, pool)
    return done


#: Frames up to which another process draws. It takes memory of its own, and what it saves, a second, is little of the
#: time to follow more frames than these.
DRAWN_BESIDE_FRAMES = 3000


def _draws_beside(request: Request, count: int) -> bool:
    """Whether a process is to draw the figures while this one measures: a core is likely to lie idle."""
    return request.report and count <= DRAWN_BESIDE_FRAMES and threads.has_idle_cores()


def _track(request: Request, chosen: Recording, ignore: NDArray[np.bool_] | None, progress: Progress | None) -> Track:
    # Without a region of interest the track takes one that suits the ball.
    roi: dict[str, Any] = {} if request.roi is None else {"roi": request.roi}
    return track(
        chosen,
        request.circle,
        ignore=ignore,
        device=request.device,
        refine=request.refine,
        in_place=request.in_place,
        sphere_map=MAPS[request.map],
        progress=progress,
        model=request.model,
        camera=request.camera(),
        **roi,
    )


def _kinematics(request: Request, tracked: Track, frame_rate: float | None, start: int) -> Kinematics | None:
    if frame_rate is None or (request.diameter_mm is None and request.mm_per_px is None):
        return None
    return kinematics(
        tracked,
        frame_rate=frame_rate,
        diameter_m=_milli(request.diameter_mm),
        m_per_px=_milli(request.mm_per_px),
        mass_kg=_milli(request.mass_g),
        lab_frame=request.lab_frame,
        first_frame=start,
        relative_sd_scale=request.scale_sd_percent / 100,
        method=request.method,
        window=request.window,
        order=request.order,
    )


def _milli(value: float | None) -> float | None:
    """A thousandth: m from mm, kg from g."""
    return None if value is None else 1e-3 * value


def _impact(request: Request, tracked: Track, motion: Kinematics | None) -> tuple[Impact | None, tuple[str, ...]]:
    """The impact, if there is one, and sentences on what is doubtful or unknown about it."""
    if motion is None:
        return None, ()
    if not np.isfinite(tracked.increment[:, 0]).any():
        # The test for an impact would say that one steady motion explains all frames.
        return None, (f"{NO_IMPACT}no motion was measured.",)
    solid = None
    if request.mass_g is not None:
        radius_m = tracked.circle.radius * motion.scale.m_per_px
        if request.shell_mm is not None and request.diameter_mm is None:
            require_shell_within(request.shell_mm, 1e3 * radius_m)
        shell_m, inertia = _milli(request.shell_mm), request.inertia_kg_m2
        solid = ball(1e-3 * request.mass_g, 2 * radius_m, shell_m=shell_m, inertia_kg_m2=inertia)
    found, reason = impact(motion, solid, normal_deg=request.normal_deg)
    if found is None:
        return None, (f"{NO_IMPACT}{reason}",)
    return found, (*impact_warnings(motion, found), *found.missing)


def _write(
    request: Request,
    done: Measurement,
    frame_rate: float | None,
    chosen: Recording,
    ignore: NDArray[np.bool_] | None,
    pool: Executor | None,
) -> None:
    with atomic_output.atomic_folder(request.out, request.overwrite) as folder:
        writer.write_track(folder, done.track, frame_rate, done.first_frame)
        if done.motion is not None:
            writer.write_kinematics(folder, done.motion, done.first_frame)
        for name, source in done.extra_files.items():
            shutil.copyfile(source, folder / name)
        writer.write_summary(folder, summary(request, done, frame_rate))
        if request.report:
            begun = draw.begin_figures(folder, pool)
            mask = None if ignore is None else torch.from_numpy(ignore)
            sampled_frames.save(folder / "frames.npz", frame_sampling.sample(chosen, done.track, mask))
            # Drawn from the written files, so that the folder alone is enough to draw it again.
            draw.draw(folder, pool, begun)
        _export(request, folder)


def _export(request: Request, folder: Path) -> None:
    """Video and ParaView series from the written files, where asked for."""
    if not (request.overlay or request.paraview):
        return
    result = read(folder)
    if request.overlay:
        overlay.write_overlay(result)
    if request.paraview and result.known.any():
        paraview.write_paraview(result)
