"""The task of `track`: its images and what was asked for, checked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from torch import Tensor

from torchsphere.recording.frame_source import Source
from torchsphere.tracking.follow import Progress, Watch


@dataclass(frozen=True)
class Task:
    """The arguments of `track`, checked, and the exposure that the recording states."""

    source: Source
    circle: Any
    ignore: Tensor | None
    refine: bool
    in_place: bool
    telecentric: bool
    sphere_map: bool | None
    exposure: float | None
    stated_exposure: float | None
    progress: Progress | None = None
    watch: Watch | None = None
