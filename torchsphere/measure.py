"""One recording from its file to its result folder, as ``torchsphere track`` and ``torchsphere demo`` do."""

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
from torchsphere.diagnostics.unused_settings import unused_settings
from torchsphere.dynamics.ball import ball
from torchsphere.dynamics.impact import impact, impacts
from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics, kinematics
from torchsphere.recording import Recording, open_recording
from torchsphere.recording.frame_range import resolve_range, restrict
from torchsphere.recording.ignore_mask import hides_ball, read_ignore, without_effect
from torchsphere.report import draw, frame_sampling, overlay, paraview
from torchsphere.report.explanations import NO_IMPACT
from torchsphere.request import Request, require_shell_within
from torchsphere.results import atomic_output, sampled_frames, writer
from torchsphere.results.reader import read
from torchsphere.results.writer import Measurement, summary, versions
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

    ``name`` replaces the path of a temporary input in the summary.

    Raises
    ------
    ValueError, OSError
        For invalid input, before anything is written.
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
        start, stop = resolve_range(request.frames, len(recording))
        with draw.drawing_process(_draws_in_parallel(request, stop - start)) as pool, threads.single_threaded_torch():
            hashed = draw.begin(pool, hash_files, recording.files)
            chosen = restrict(recording, start, stop)
            ignore = read_ignore(request.ignore, recording.shape[1:]) if request.ignore else None
            tracked = _track(request, chosen, ignore, progress, start)
            frame_rate = request.fps or recording.frame_rate
            motion = _kinematics(request, tracked, frame_rate, start)
            found, every, impact_notes = _impacts(request, tracked, motion)
            circle = tracked.circle
            warnings = (
                *track_warnings(request, recording, tracked, frame_rate),
                *window_warnings(tracked, motion),
                *bandwidth_warnings(motion),
                *impact_notes,
                *unused_settings(request, motion, found, has_rate=frame_rate is not None),
                *without_effect(request.ignore, recording.shape[1:]),
                *hides_ball(ignore, circle.x, circle.y, circle.radius, start + circle.frame),
            )
            seconds = time.perf_counter() - began
            sha256 = hashed.result() if hashed is not None and not draw.failed(hashed) else hash_files(recording.files)
            done = Measurement(
                recording, tracked, motion, found, start, warnings, seconds, sha256, extra or {}, name, every
            )
            _write(request, done, frame_rate, chosen, ignore, pool)
    return done


#: Largest number of frames for which a second process draws the figures: with more, the second it saves is little.
PARALLEL_DRAWING_FRAMES = 3000


def _draws_in_parallel(request: Request, count: int) -> bool:
    """Whether a second process draws the figures during the measurement."""
    return request.report and count <= PARALLEL_DRAWING_FRAMES and threads.has_idle_cores()


def _track(
    request: Request, chosen: Recording, ignore: NDArray[np.bool_] | None, progress: Progress | None, start: int
) -> Track:
    # Without this argument `track` chooses a region of interest for the ball.
    roi: dict[str, Any] = {} if request.roi is None else {"roi": request.roi}
    exposure = _exposure(request, request.fps or chosen.frame_rate)
    return track(
        chosen,
        request.circle,
        ignore=ignore,
        device=request.device,
        refine=request.refine,
        in_place=request.in_place,
        sphere_map=MAPS[request.map],
        exposure=exposure,
        progress=progress,
        model=request.motion_model(),
        telecentric=request.telecentric,
        camera=request.camera(),
        first_frame=start,
        log=False,  # the command line prints the warnings
        **roi,
    )


def _exposure(request: Request, frame_rate: float | None) -> float | None:
    """The exposure that was given over the time between frames; None where none was."""
    if request.shutter_us is None:
        return None
    if frame_rate is None:
        raise ValueError("--shutter-us was given, but no frame rate is known to compare it with; give --fps, too")
    share = 1e-6 * request.shutter_us * frame_rate
    if share > 1 + 1e-6:
        raise ValueError(
            f"--shutter-us {request.shutter_us:g}: longer than the {1e6 / frame_rate:.4g} us from frame to frame; "
            "give the exposure time, or correct --fps"
        )
    return min(share, 1.0)


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
    """A thousandth of the value: m from mm, kg from g."""
    return None if value is None else 1e-3 * value


def _impacts(
    request: Request, tracked: Track, motion: Kinematics | None
) -> tuple[Impact | None, tuple[Impact, ...], tuple[str, ...]]:
    """The strongest impact or None, all impacts, and warnings about the strongest."""
    if motion is None:
        return None, (), ()
    if not np.isfinite(tracked.increment[:, 0]).any():
        # `impact` would say that one steady motion explains all frames.
        return None, (), (f"{NO_IMPACT}no motion was measured.",)
    solid = None
    if request.mass_g is not None:
        radius_m = tracked.circle.radius * motion.scale.m_per_px
        if request.shell_mm is not None and request.diameter_mm is None:
            require_shell_within(request.shell_mm, 1e3 * radius_m)
        shell_m, inertia = _milli(request.shell_mm), request.inertia_kg_m2
        solid = ball(1e-3 * request.mass_g, 2 * radius_m, shell_m=shell_m, inertia_kg_m2=inertia)
    found, reason = impact(motion, solid, normal_deg=request.normal_deg)
    if found is None:
        return None, (), (f"{NO_IMPACT}{reason[0].lower()}{reason[1:]}",)
    every = impacts(motion, solid, normal_deg=request.normal_deg)
    return found, tuple(every), (*impact_warnings(motion, found), *found.missing)


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
            # Figures come from the written files, so that the folder alone is enough to draw them again.
            draw.draw(folder, pool, begun)
        _export(request, folder)


def _export(request: Request, folder: Path) -> None:
    """The requested video and ParaView series, from the written files."""
    if not (request.overlay or request.paraview):
        return
    result = read(folder)
    if request.overlay:
        overlay.write_overlay(result)
    if request.paraview and result.known.any():
        paraview.write_paraview(result)
