"""What one image of a folder states about itself, and the kinds of images that a folder may hold."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from torchsphere.recording.recording import MAX_IMAGE_BYTES, MAX_PIXELS
from torchsphere.recording.tiff import Page


@dataclass(frozen=True)
class ImageHeader:
    """The properties of an image; those of one recording are equal."""

    page: Page
    detail: str = ""  # what else must be equal, in words
    pixel_aspect: float | None = field(default=None, compare=False)  # width over height of a pixel, where it is stated
    has_losses: bool = field(default=False, compare=False)  # whether the compression changed levels

    def __str__(self) -> str:
        return f"{self.page}{', ' if self.detail else ''}{self.detail}"


@dataclass(frozen=True)
class ImageKind:
    """A kind of images: how they are named, described and loaded."""

    name: str
    suffixes: tuple[str, ...]
    describe: Callable[[Path], ImageHeader]  # raises ValueError or OSError for other files
    load: Callable[[Path, ImageHeader], NDArray[Any]]  # levels (h, w) or (h, w, samples)
    look: str  # as `look_of` names the content
    places: Mapping[str, str] = field(hash=False)  # facts of the recording, and where the images state them
    is_lossy: bool = False  # whether the images may be previews of others beside them


def require_size(file: Path, height: int, width: int, needed: int, most: int = MAX_IMAGE_BYTES) -> None:
    """Raise OSError for a stated size that the file's bytes, ``most`` when unpacked, or no camera can have."""
    if min(width, height) < 1 or width * height > MAX_PIXELS or needed > min(most, MAX_IMAGE_BYTES):
        raise OSError(
            f"{file}: states {width} x {height} px, but has {file.stat().st_size} bytes; it is damaged, copy it again"
        )
