"""One recording from its file to its result folder, as ``torchsphere track`` and ``torchsphere demo`` do."""

from __future__ import annotations

import dataclasses
import shutil
import time
from collections.abc import Mapping
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from torchsphere.diagnostics.contradictions import contradictions
from torchsphere.diagnostics.impact_warnings import filter_warnings, found_impacts
from torchsphere.diagnostics.track_warnings import bandwidth_warnings, track_warnings, window_warnings
from torchsphere.diagnostics.unused_settings import unused_settings
from torchsphere.dynamics.ball import ball
from torchsphere.dynamics.channel_filter import require_class
from torchsphere.dynamics.contact_law import ContactForce, contact_force
from torchsphere.dynamics.filtered_motion import FilteredMotion, filtered_motion
from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics, kinematics
from torchsphere.motion.track import status_counts
from torchsphere.recording import Recording, open_recording
from torchsphere.recording.facts import Facts
from torchsphere.recording.frame_range import resolve_range, restrict
from torchsphere.recording.frame_source import require_device
from torchsphere.recording.ignore_mask import hides_ball, read_ignore, without_effect
from torchsphere.report import draw, frame_sampling, overlay, paraview
from torchsphere.request import Request, require_shell_within
from torchsphere.results import atomic_output, sampled_frames, writer
from torchsphere.results.exports import check_exports
from torchsphere.results.reader import NO_IMPACT, read
from torchsphere.results.writer import Measurement, versions
from torchsphere.runtime import steps, threads
from torchsphere.runtime.file_hash import hash_files
from torchsphere.runtime.steps import LOG
from torchsphere.runtime.warning_levels import by_level, note, severe
from torchsphere.settings.calibration import Calibration, exposure_share
from torchsphere.settings.choices import MAPS
from torchsphere.settings.limits import SettingError
from torchsphere.tracking.follow import Progress, Watch
from torchsphere.tracking.track import Track, track

__all__ = ["Measurement", "Request", "measure", "versions"]


def measure(
    request: Request,
    progress: Progress | None = None,
    extra: Mapping[str, Path] | None = None,
    *,
    name: str | None = None,
    watch: Watch | None = None,
) -> Measurement:
    """Track the recording and write the result folder; files of ``extra`` (name -> source) are copied into it.

    ``name`` replaces the path of a temporary input in the summary. ``progress`` and ``watch`` are those of `track`.

    Raises
    ------
    ValueError, OSError
        For invalid input, before anything is written.
    """
    atomic_output.check_folder(request.out, request.overwrite)
    if request.overlay:
        overlay.check_library()
    check_exports(request.export)
    require_device(torch.device(request.device))
    began = time.perf_counter()
    with open_recording(
        request.input, axes=request.axes, pixel_aspect=request.pixel_aspect, bayer=request.bayer
    ) as recording:
        start, stop = resolve_range(request.frames, len(recording))
        intervals = None if recording.times is None else np.diff(recording.times[start:stop])
        known = request.calibration(recording.frame_rate)
        frame_rate = known.frame_rate
        _check_class(request, frame_rate, intervals)
        with draw.drawing_process(_draws_in_parallel(request, stop - start)) as pool, threads.single_threaded_torch():
            hashed = draw.begin(pool, hash_files, recording.files)
            chosen = restrict(recording, start, stop)
            ignore = read_ignore(request.ignore, recording.shape[1:]) if request.ignore else None
            LOG.info("opened %s: %s, frames %d to %d", recording.path, recording.kind, start, stop - 1)
            tracked = _track(request, known, chosen, ignore, start, progress=progress, watch=watch)
            tracked = dataclasses.replace(tracked, facts=Facts.of(recording, recording.shape))
            LOG.info("tracked: %s", ", ".join(f"{n} {name}" for name, n in status_counts(tracked).items()))
            motion = _kinematics(request, tracked)
            found, every, impact_notes = _impacts(request, tracked, motion)
            filtered = _filtered(request, tracked, motion)
            LOG.info("kinematics: %s; impacts: %d", "none" if motion is None else motion.about["method"], len(every))
            circle = tracked.circle
            warnings = by_level(
                (
                    *track_warnings(request, recording, tracked, frame_rate),
                    *contradictions(motion),
                    *window_warnings(tracked, motion),
                    *bandwidth_warnings(motion),
                    *impact_notes,
                    *(() if motion is None else filter_warnings(motion, found, filtered)),
                    *unused_settings(request, motion, found, has_rate=frame_rate is not None),
                    *map(note, without_effect(request.ignore, recording.shape[1:])),
                    *map(severe, hides_ball(ignore, circle.x, circle.y, circle.radius, start + circle.frame)),
                )
            )
            seconds = time.perf_counter() - began
            if hashed is None or not hashed.done():
                steps.tell_if_large(recording.files, "computing the checksum of the recording")
            sha256 = hashed.result() if hashed is not None and not draw.failed(hashed) else hash_files(recording.files)
            done = Measurement(
                *(recording, tracked, motion, found, start, warnings, seconds, sha256, extra or {}, name, every),
                contact_forces=_contact_forces(request, motion, every),
                filtered=filtered,
            )
            drawing = ", with figures and report" if request.report else ""
            steps.tell("writing the result to %s%s", request.out, drawing)
            _write(request, done, frame_rate, chosen, ignore, pool)
            LOG.info("written")
    return done


#: Largest number of frames for which a second process draws the figures: with more, the second it saves is little.
PARALLEL_DRAWING_FRAMES = 3000


def _draws_in_parallel(request: Request, count: int) -> bool:
    """Whether a second process draws the figures during the measurement."""
    return request.report and count <= PARALLEL_DRAWING_FRAMES and threads.has_idle_cores()


def _track(
    request: Request,
    known: Calibration,
    chosen: Recording,
    ignore: NDArray[np.bool_] | None,
    start: int,
    **calls: Any,
) -> Track:
    # Without this argument `track` chooses a region of interest for the ball.
    roi: dict[str, Any] = {} if request.roi is None else {"roi": request.roi}
    exposure = None if request.shutter_us is None else exposure_share(request.shutter_us, known.frame_rate)
    found = track(
        chosen,
        request.circle,
        ignore=ignore,
        device=request.device,
        refine=request.refine,
        in_place=request.in_place,
        sphere_map=MAPS[request.map],
        exposure=exposure,
        model=request.motion_model(),
        telecentric=request.telecentric,
        camera=request.camera(),
        first_frame=start,
        log=False,  # the command line prints the warnings
        **roi,
        **calls,
    )
    return dataclasses.replace(found, calibration=known)


def _check_class(request: Request, frame_rate: float | None, intervals: NDArray[np.float64] | None) -> None:
    """Raise SettingError for a channel frequency class that the frame rate or uneven ``intervals`` do not allow."""
    if request.cfc is None or frame_rate is None:
        return
    require_class(request.cfc, frame_rate)
    if intervals is not None and not np.allclose(intervals, intervals[0]):
        raise SettingError(
            f"`cfc` = {request.cfc}: a channel frequency class needs evenly spaced images, and their own times have "
            "gaps; leave it out, or measure a part without a gap with `frames`"
        )


def _filtered(request: Request, tracked: Track, motion: Kinematics | None) -> FilteredMotion | None:
    """Acceleration and force by the channel frequency class, if one was asked for."""
    return None if motion is None or request.cfc is None else filtered_motion(tracked, motion, request.cfc)


def _contact_forces(
    request: Request, motion: Kinematics | None, impacts: tuple[Impact, ...]
) -> tuple[ContactForce, ...]:
    """Force against penetration of each impact."""
    if motion is None:
        return ()
    return tuple(contact_force(motion, each, normal_deg=request.normal_deg) for each in impacts)


def _kinematics(request: Request, tracked: Track) -> Kinematics | None:
    known = tracked.calibration
    if known.frame_rate is None or (known.diameter_m is None and known.m_per_px is None):
        return None
    steps.tell("computing velocities and forces")
    return kinematics(
        tracked,
        lab_frame=request.lab_frame,
        log=False,  # the command line prints the warnings
        method=request.method,
        window=request.window,
        order=request.order,
    )


def _impacts(
    request: Request, tracked: Track, motion: Kinematics | None
) -> tuple[Impact | None, tuple[Impact, ...], tuple[str, ...]]:
    """The strongest impact or None, all impacts, and warnings about the strongest."""
    if motion is None:
        return None, (), ()
    if not np.isfinite(tracked.increment[:, 0]).any():
        # `impact` would say that one steady motion explains all frames.
        return None, (), (note(f"{NO_IMPACT}no motion was measured."),)
    solid, known = None, tracked.calibration
    if known.mass_kg is not None:
        radius_m = tracked.circle.radius * motion.scale.m_per_px
        if request.shell_mm is not None and request.diameter_mm is None:
            require_shell_within(request.shell_mm, 1e3 * radius_m)
        solid = ball(
            known.mass_kg,
            2 * radius_m,
            shell_m=None if request.shell_mm is None else 1e-3 * request.shell_mm,
            inertia_kg_m2=request.inertia_kg_m2,
            relative_sd_mass=known.relative_sd_mass,
            relative_sd_diameter=known.relative_sd_scale,
            log=False,
        )
    return found_impacts(motion, solid, request.normal_deg)


def _write(
    request: Request,
    done: Measurement,
    frame_rate: float | None,
    chosen: Recording,
    ignore: NDArray[np.bool_] | None,
    pool: Executor | None,
) -> None:
    with atomic_output.atomic_folder(request.out, request.overwrite) as folder:
        writer.write_measurement(folder, request, done, frame_rate, request.export)
        for name, source in done.extra_files.items():
            shutil.copyfile(source, folder / name)
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
        steps.tell("drawing overlay.mp4")
        overlay.write_overlay(result)
    if request.paraview and result.known.any():
        steps.tell("writing the series for ParaView")
        paraview.write_paraview(result)
