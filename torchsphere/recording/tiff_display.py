"""How the pixels of a TIFF are stored, as its tags and OME's metadata state it: orientation, ratio of sides, mosaic."""

from __future__ import annotations

import re
from math import isfinite
from typing import Any

import tifffile

from torchsphere.recording import mosaic, orientation

_ORIENTATION, _X_RESOLUTION, _Y_RESOLUTION = 274, 282, 283
_CFA_SIZE, _CFA = 33421, 33422
#: PhotometricInterpretation of a colour mosaic (TIFF/EP, DNG).
MOSAIC = 32803

#: Units of lengths in OME's metadata, m; a file without a unit means micrometres.
_LENGTHS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "µm": 1e-6, "um": 1e-6, "nm": 1e-9, "in": 0.0254, "pixel": 1.0}


def orientation_of(page: tifffile.TiffPage) -> int:
    """The code of the tag Orientation, 1 where it is missing or none of the eight."""
    code = _value(page, _ORIENTATION)
    return int(code) if code in orientation.STEPS else 1


def bayer_of(page: tifffile.TiffPage) -> str | None:
    """The pattern of a mosaic of 2 x 2 red, green and blue pixels; None for others and for grey pages."""
    size, codes = _value(page, _CFA_SIZE), _value(page, _CFA)
    if int(page.photometric or 0) != MOSAIC or tuple(size or ()) != (2, 2) or codes is None:
        return None
    return mosaic.pattern_of(tuple(bytes(codes)) if isinstance(codes, bytes) else tuple(codes))


def pixel_aspect_of(tif: tifffile.TiffFile) -> tuple[float | None, str]:
    """Width over height of a pixel, and who states it; None where nobody does.

    A resolution without a unit states the ratio alone, which is all that is asked.
    """
    pixels = re.search(r"<(?:\w+:)?Pixels\b[^>]*>", tif.ome_metadata or "")
    if pixels is not None:
        sides = [_ome_length(pixels[0], letter) for letter in "XY"]
        if all(sides):
            return sides[0] / sides[1], "OME PhysicalSizeX and PhysicalSizeY"
    page = tif.pages[0].aspage()
    across, down = (_number(_value(page, code)) for code in (_X_RESOLUTION, _Y_RESOLUTION))
    # A resolution is a number of pixels per length: the more, the smaller they are.
    return (down / across, "TIFF XResolution and YResolution") if across and down else (None, "")


def _value(page: tifffile.TiffPage, code: int) -> Any:
    tag = page.tags.get(code)
    return None if tag is None else tag.value


def _number(value: Any) -> float:
    """A rational number of a tag; 0 where it is none."""
    if not (isinstance(value, tuple) and len(value) == 2 and value[1]):
        return 0.0
    number = float(value[0]) / float(value[1])
    return number if isfinite(number) and number > 0 else 0.0


def _ome_length(pixels: str, letter: str) -> float:
    """Side of a pixel along an axis, m; 0 where it is not stated."""
    size = re.search(rf'\bPhysicalSize{letter}="([^"]{{1,40}})"', pixels)
    unit = re.search(rf'\bPhysicalSize{letter}Unit="([^"]{{1,20}})"', pixels)
    try:
        length = 0.0 if size is None else float(size[1])
    except ValueError:
        length = 0.0
    scale = _LENGTHS_M.get("µm" if unit is None else unit[1], 0.0)
    return length * scale if isfinite(length) and length > 0 else 0.0
