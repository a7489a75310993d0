"""The facts of a recording, which a track keeps without its images and its open file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


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
        Number of images, height and width in px, ``(n, h, w)``, of the images as they are shown.
    bit_depth : int or None
        Bits of the grey levels that :meth:`images` returns: 12 means levels from 0 to 4095.
    frame_rate : float or None
        Images per second of the recording (not of a player).
    exposure_s : float or None
        Exposure time in s.
    trigger_offset_frames : int or None
        Number of the first image counted from the trigger; negative before it.
    pixel_aspect : float or None
        Width of a stored pixel over its height. The images are shown with square pixels.
    orientation : int
        How the stored images are turned or mirrored to be shown, as the Orientation of TIFF and Exif: 1 (as stored) to
        8; see `torchsphere.recording.orientation`.
    bayer : str or None
        Colours of the 2 x 2 pixels of a stored colour mosaic, row by row, such as "RGGB". The images are shown grey.
    times : ndarray or None
        Times of the images (n,) since the first of the file, in frame intervals (of 1 / ``frame_rate``); None where
        they are evenly spaced.
    origins : Mapping of str to str
        Sources of the known values of ``bit_depth``, ``frame_rate``, ``exposure_s``, ``trigger_offset_frames``,
        ``pixel_aspect``, ``orientation`` and ``bayer``.
    notes : tuple of str
        Sentences for the user: conversions, doubts, ignored contents.
    files : tuple of Path
        All files of the recording.
    doubt : str
        A doubt about the order of an array's axes, with marked names of settings; empty without one.
    """

    path: Path
    kind: str
    shape: tuple[int, int, int]
    bit_depth: int | None = None
    frame_rate: float | None = None
    exposure_s: float | None = None
    trigger_offset_frames: int | None = None
    pixel_aspect: float | None = None
    orientation: int = 1
    bayer: str | None = None
    times: NDArray[np.float64] | None = field(default=None, repr=False, compare=False)
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


def stated(facts: Mapping[str, tuple[Any, str]]) -> dict[str, Any]:
    """Fields of `Facts`, from values with their sources by name; what is None was not stated and is left out."""
    known = {name: pair for name, pair in facts.items() if pair[0] is not None}
    origins = {name: origin for name, (_, origin) in known.items()}
    return {name: value for name, (value, _) in known.items()} | {"origins": origins}


def doubt_notes(doubt: str) -> tuple[str, ...]:
    """The sentence of `Facts.notes` on a doubt; none without a doubt."""
    return (f"{doubt[0].upper()}{doubt[1:]}.",) if doubt else ()
