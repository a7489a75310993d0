"""BMP, JPEG and WebP images through Pillow."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording import orientation
from torchsphere.recording.image_header import ImageHeader, ImageKind, require_size
from torchsphere.recording.refusal import HEAD_BYTES, library_failures, look_of
from torchsphere.recording.tiff import Page

if TYPE_CHECKING:
    from PIL.Image import Exif, Image

#: Samples by Pillow's mode; a palette (P) becomes RGB.
_SAMPLES = {"L": 1, "RGB": 3, "P": 3, "RGBA": 4, "RGBX": 4}
#: EXIF tag of the orientation.
_ORIENTATION = 0x0112


def _look(name: str) -> str:
    return f"a {name} image"


@contextmanager
def _opened(name: str, file: Path) -> Iterator[Image]:
    """The image of that kind, of which Pillow has read the header."""
    from PIL import Image

    look = look_of(file)
    if look != _look(name):
        raise ValueError(f"{file}: looks like {look}, expected {_look(name)}; check the name")
    with library_failures(file, f"a {name}"):
        image = Image.open(file, formats=(name.upper(),))
    with image:
        yield image


def _describe(name: str, file: Path) -> ImageHeader:
    with _opened(name, file) as image, library_failures(file, f"a {name}"):
        code = _orientation(image.getexif())
        frames = getattr(image, "n_frames", 1) if name == "WebP" else 1
        across, down = image.info.get("jfif_density") or image.info.get("dpi") or (0, 0)
        (width, height), mode = image.size, image.mode
    if mode not in _SAMPLES:
        raise ValueError(f"{file}: has pixels of Pillow's mode {mode}, expected 8-bit grey or RGB; save it so")
    if frames > 1:
        raise ValueError(f"{file}: holds {frames} images, expected one image per file; part them")
    samples = _SAMPLES[mode]
    require_size(file, height, width, width * height * samples)
    page = Page(height, width, samples, 8, "u1", 2 if samples >= 3 else 1, False, code)
    # A density is a number of pixels per length: the more, the smaller they are.
    aspect = down / across if across > 0 and down > 0 else None
    return ImageHeader(page, pixel_aspect=aspect, has_losses=_has_losses(name, file))


def exif_orientation(data: bytes) -> int:
    """Orientation by Exif ``data``; 1 (as stored) where it states none or cannot be read."""
    from PIL.Image import Exif

    exif = Exif()
    with warnings.catch_warnings():
        # Of damaged data.
        warnings.simplefilter("ignore")
        try:
            exif.load(data)
        except (SyntaxError, ValueError, OSError, struct.error):
            return 1
        return _orientation(exif)


def _orientation(exif: Exif) -> int:
    code = exif.get(_ORIENTATION, 1)
    return code if code in orientation.STEPS else 1


def _has_losses(name: str, file: Path) -> bool:
    with file.open("rb") as stream:
        return name == "JPEG" or (name == "WebP" and b"VP8L" not in stream.read(HEAD_BYTES))


def _load(name: str, file: Path, expected: ImageHeader) -> NDArray[Any]:
    if _describe(name, file) != expected:
        raise OSError(f"{file}: changed since the folder was opened; open it again")
    with _opened(name, file) as image, library_failures(file, f"a {name}"):
        return np.asarray(image.convert("RGB") if image.mode == "P" else image)


def _kind(name: str, *suffixes: str, is_lossy: bool = False) -> ImageKind:
    functions = partial(_describe, name), partial(_load, name)
    places = {"bit_depth": f"{name} header", "pixel_aspect": f"{name} density", "orientation": "EXIF Orientation"}
    return ImageKind(name, suffixes, *functions, _look(name), places, is_lossy)


BMP = _kind("BMP", ".bmp", ".dib")
JPEG = _kind("JPEG", ".jpg", ".jpeg", is_lossy=True)
WEBP = _kind("WebP", ".webp", is_lossy=True)
