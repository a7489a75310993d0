"""The facts of a recording, which a track keeps without its images and its open file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from torchsphere.recording.recording import Recording


@dataclass(frozen=True)
class Facts:
    """What a recording states, as in `Recording`; ``path`` is empty for an array."""

    path: Path
    kind: str
    shape: tuple[int, int, int]
    bit_depth: int | None = None
    frame_rate: float | None = None
    exposure_s: float | None = None
    trigger_offset_frames: int | None = None
    origins: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()

    @classmethod
    def of(cls, recording: Any, shape: tuple[int, ...]) -> Facts:
        """The facts of a `Recording`, or the ``shape`` (n, h, w) of an array."""
        if isinstance(recording, Recording):
            return cls(**{name: getattr(recording, name) for name in cls.__dataclass_fields__})
        n, height, width = shape
        return cls(Path(), "array", (n, height, width))
