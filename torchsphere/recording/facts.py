"""The facts of a recording, which a track keeps without its images and its open file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from torchsphere.settings.limits import in_options


@dataclass(frozen=True, kw_only=True, slots=True)
class Facts:
    """What a recording states; what it does not state is ``None``.

    Attributes
    ----------
    path : Path
        The file or folder that was opened; empty for an array.
    kind : str
        The format in words, for example ``"Photron MRAW, 12 bit packed"``.
    shape : tuple of int
        Number of images, height and width in px, ``(n, h, w)``.
    bit_depth : int or None
        Bits of the grey levels that :meth:`images` returns: 12 means levels from 0 to 4095.
    frame_rate : float or None
        Images per second of the recording (not of a player).
    exposure_s : float or None
        Exposure time in s.
    trigger_offset_frames : int or None
        Number of the first image counted from the trigger; negative before it.
    origins : Mapping of str to str
        Sources of the known values of ``bit_depth``, ``frame_rate``, ``exposure_s`` and ``trigger_offset_frames``.
    notes : tuple of str
        Sentences for the user: conversions, doubts, ignored contents.
    files : tuple of Path
        All files of the recording.
    doubt : str
        A doubt about the order of an array's axes, with names of settings in backticks; empty without one.
    """

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
    doubt: str = ""

    @classmethod
    def of(cls, recording: Any, shape: tuple[int, ...]) -> Facts:
        """The facts of a `torchsphere.recording.recording.Recording`, or the ``shape`` (n, h, w) of an array."""
        if isinstance(recording, Facts):
            return cls(**{name: getattr(recording, name) for name in cls.__dataclass_fields__})
        n, height, width = shape
        return cls(path=Path(), kind="array", shape=(n, height, width))


def doubt_notes(doubt: str) -> tuple[str, ...]:
    """The sentence of `Facts.notes` on a doubt, with options of the command line; none without a doubt."""
    return (in_options(f"{doubt[0].upper()}{doubt[1:]}."),) if doubt else ()
