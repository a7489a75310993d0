"""The measurement of one recording, and its ``summary.json``."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import kornia
import numpy as np
import torch

from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.dynamics.mean_motion import mean_motion
from torchsphere.dynamics.shared_errors import ROTATION_PER_RADIUS
from torchsphere.recording import Recording
from torchsphere.request import Request
from torchsphere.results import writer
from torchsphere.tracking.drift import STEP_PER_RADIUS
from torchsphere.tracking.track import Track


@dataclass(frozen=True)
class Measurement:
    """The measurement of one recording.

    ``sha256`` is the hash of its files. ``extra_files`` (name -> source) are copied into the result folder. ``name``
    stands in the summary in place of a temporary path.
    """

    recording: Recording
    track: Track
    motion: Kinematics | None
    impact: Impact | None
    first_frame: int
    warnings: tuple[str, ...]
    seconds: float
    sha256: str
    extra_files: Mapping[str, Path] = field(default_factory=dict)
    name: str | None = None


def summary(request: Request, done: Measurement, frame_rate: float | None) -> dict[str, Any]:
    """The contents of ``summary.json``; docs/results.md explains each key."""
    recording, tracked = done.recording, done.track
    circle = tracked.circle
    # Values in px stay in the camera frame.
    in_lab = done.motion is not None and done.motion.lab_frame
    return {
        "input": {
            "path": done.name or str(request.input),
            "sha256": done.sha256,
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
        "frames_per_status": writer.status_counts(tracked),
        "mean_motion": mean_motion(tracked, done.motion),
        "axes": "lab frame: x right, y up, z to the camera" if in_lab else "camera frame: x right, y down",
        "settings": {k: v for k, v in vars(request).items() if k not in ("input", "out")} | tracked.settings,
        "differentiation": None if done.motion is None else done.motion.about,
        "impact": None if done.impact is None else done.impact.summary(),
        "contact_s": None if done.motion is None else done.motion.contact_s,
        "warnings": list(done.warnings),
        "seconds": round(done.seconds, 3),
        "versions": versions(),
    }


def _radius_effect(tracked: Track) -> dict[str, float]:
    """Effect of the radius's standard deviation on the mean step (px) and on all rotations (relative)."""
    turn = float(np.linalg.norm(np.nan_to_num(tracked.increment[:, 2:4]), axis=1).mean())
    sd = tracked.circle.sd_radius
    return {
        "sd_radius_px": sd,
        "sd_mean_step_px": STEP_PER_RADIUS * turn * sd,
        "relative_sd_rotation": ROTATION_PER_RADIUS * sd / tracked.circle.radius,
    }


def versions() -> dict[str, str]:
    """Versions of the programs that computed the result."""
    from torchsphere import __version__

    return {
        "torchsphere": __version__,
        "torch": torch.__version__,
        "kornia": kornia.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }
