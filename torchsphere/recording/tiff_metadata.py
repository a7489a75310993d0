"""What the metadata of a TIFF state of its images, by ImageJ, OME, tifffile and its tags: axes, times, and display."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from torchsphere.recording import image_times, mosaic, orientation
from torchsphere.settings.limits import FRAME_RATES

#: Units of times, s, and of lengths, m, as ImageJ and OME write them.
_TIME_UNITS_S = (
    {"s": 1.0, "sec": 1.0, "ns": 1e-9, "min": 60.0, "h": 3600.0}
    | dict.fromkeys(("ms", "msec"), 1e-3)
    | dict.fromkeys(("us", "µs", "μs", "usec"), 1e-6)
)
_LENGTHS_M = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "µm": 1e-6, "um": 1e-6, "nm": 1e-9, "in": 0.0254, "pixel": 1.0}

#: Times of the planes of an OME file that are read, a plane an image.
_PLANE = re.compile(r"<(?:\w+:)?Plane\b[^>]*>")

#: Tags of the display, and PhotometricInterpretation of a colour mosaic (TIFF/EP, DNG).
_ORIENTATION, _X_RESOLUTION, _Y_RESOLUTION = 274, 282, 283
_CFA_SIZE, _CFA = 33421, 33422
MOSAIC = 32803


@dataclass(frozen=True)
class Axes:
    """Numbers of images along each axis, 1 where nothing is stated, and the total where only that is stated."""

    origin: str = ""
    times: int = 1
    slices: int = 1
    channels: int = 1
    images: int = 0

    def require_plain(self, path: Path, count: int) -> None:
        """Raise ValueError for channels or slices of ``count`` images, OSError where stated images are missing."""
        for name, number in (("channels", self.channels), ("slices in depth (z)", self.slices)):
            stated = self.times * self.slices * self.channels // number
            others = max(stated, count // number if name == "channels" else 1)
            if number > 1 and others > 1 and count > number:
                raise ValueError(
                    f"{path}: holds {number} {name} of {others} images, expected one channel; "
                    f"split the {name.split()[0]} and save one of them"
                )
        total = max(self.images, self.times * self.slices * self.channels)
        if total > count:
            raise OSError(
                f"{path}: is cut or damaged: {count} of the {total} images that {self.origin} states are present; "
                "copy or export it again"
            )

    def notes(self) -> tuple[str, ...]:
        """A sentence where images are called channels or slices."""
        if self.channels > 1:
            called = "channels"
        elif self.slices > 1:
            called = "slices in depth"
        else:
            return ()
        number = max(self.channels, self.slices)
        return (f"{self.origin}'s header calls the {number} images {called}; here they are images in order.",)


def stated_axes(tif: tifffile.TiffFile, samples: int, image_values: int) -> Axes:
    """The axes that the metadata of a file state; an image has ``samples`` channels and ``image_values`` values."""
    imagej = tif.imagej_metadata or {}
    if imagej:
        channels, images = (_count(imagej.get(name)) for name in ("channels", "images"))
        return Axes("ImageJ", channels=channels, images=images)
    pixels = _pixels(tif.ome_metadata)
    if pixels:
        times, slices, channels = (_size(pixels, letter) for letter in "TZC")
        # A channel of a colour image is no image of its own.
        return Axes("OME", times, slices, max(1, channels // samples) if samples >= 3 else channels)
    # The shapes of the arrays that tifffile wrote.
    shapes = [table.get("shape") for table in tif.shaped_metadata or ()]
    whole = [math.prod(shape) for shape in shapes if isinstance(shape, list) and all(_count(n) == n for n in shape)]
    return Axes("the header", images=sum(whole) // image_values)


def _size(pixels: str, letter: str) -> int:
    """Number of images along an axis by OME, 1 where it is not stated."""
    found = re.search(rf"\bSize{letter}=\"(\d{{1,9}})\"", pixels)
    return _count(int(found[1])) if found is not None else 1


def _count(stated: Any) -> int:
    return stated if isinstance(stated, int) and stated > 0 else 1


@dataclass(frozen=True)
class TiffClock:
    """Frame rate, 1/s, its source, and times of the images in frame intervals; None where not stated."""

    frame_rate: float | None = None
    origin: str = ""
    times: NDArray[np.float64] | None = None
    notes: tuple[str, ...] = ()


def clock_of(imagej: dict[str, Any], ome: str | None, count: int) -> TiffClock:
    """The clock of ``count`` images from the metadata of ImageJ or the XML of OME."""
    pixels = _pixels(ome)
    if pixels:
        return _of_ome(pixels, ome or "", count)
    rate, notes = _of_imagej(imagej)
    return TiffClock(rate, "ImageJ finterval" if rate else "", None, notes)


def _of_ome(pixels: str, ome: str, count: int) -> TiffClock:
    """The interval that OME states for all images, or their own times, which count where both do."""
    increment = _quantity(pixels, "TimeIncrement", _TIME_UNITS_S, "s")
    stated = 1 / increment if increment > 0 else None
    stamps = _plane_times(ome, count)
    clock = None if stamps is None else image_times.clock_of(stamps)
    if clock is not None:
        notes = image_times.frame_rate_note(clock, stated, "OME DeltaT") + image_times.spacing_notes(clock)
        counts = clock.counts_beside(stated)
        rate, origin = (clock.frame_rate, "OME DeltaT") if counts else (stated, "OME TimeIncrement")
        return TiffClock(rate, origin, clock.times, notes)
    if stated is None:
        return TiffClock(notes=("A TIFF carries no frame rate.",))
    if not FRAME_RATES[0] <= stated <= FRAME_RATES[1]:
        return TiffClock(notes=(f"OME states a time increment of {increment:g} s, which no camera has.",))
    return TiffClock(stated, "OME TimeIncrement")


def _plane_times(ome: str, count: int) -> NDArray[np.float64] | None:
    """Times of ``count`` images, s; None unless each has one."""
    planes = _PLANE.findall(ome)
    if len(planes) != count or not all("DeltaT=" in plane for plane in planes):
        return None
    numbers = [re.search(r'\bTheT="(\d{1,9})"', plane) for plane in planes]
    times = np.array([_quantity(plane, "DeltaT", _TIME_UNITS_S, "s") for plane in planes])
    if any(number is None for number in numbers):
        return None
    order = np.argsort([int(number[1]) for number in numbers if number is not None], kind="stable")
    return times[order]


def _of_imagej(imagej: dict[str, Any]) -> tuple[float | None, tuple[str, ...]]:
    interval, unit = imagej.get("finterval"), _TIME_UNITS_S.get(str(imagej.get("tunit", "")).strip().lower())
    if isinstance(interval, int | float) and 0 < interval < math.inf:
        # A header may state hundreds of digits, which no float holds.
        interval = float(min(interval, sys.float_info.max))
        rate = 1.0 / (interval * unit) if unit is not None and interval * unit > 0 else math.inf
        if unit is not None and not FRAME_RATES[0] <= rate <= FRAME_RATES[1]:
            return None, (f"ImageJ states a frame interval of {interval:g} {imagej['tunit']}, which no camera has.",)
        if unit is not None:
            return rate, ()
        return None, (f"ImageJ states a frame interval of {interval:g} without a unit of time, so it was not used.",)
    return None, ("A TIFF carries no frame rate.",)


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
    sides = [_quantity(_pixels(tif.ome_metadata), f"PhysicalSize{letter}", _LENGTHS_M, "µm") for letter in "XY"]
    if all(side > 0 for side in sides):
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
    return number if math.isfinite(number) and number > 0 else 0.0


def _pixels(ome: str | None) -> str:
    """The element of OME's XML that describes the images; empty without one."""
    found = re.search(r"<(?:\w+:)?Pixels\b[^>]*>", ome or "")
    return found[0] if found is not None else ""


def _quantity(element: str, name: str, units: Mapping[str, float], usual: str) -> float:
    """A quantity of an element of OME, in SI units, where none is stated in the ``usual`` one; NaN without a number."""
    value = re.search(rf'\b{name}="([^"]{{1,40}})"', element)
    unit = re.search(rf'\b{name}Unit="([^"]{{1,20}})"', element)
    scale = units.get(usual if unit is None else unit[1].strip(), math.nan)
    try:
        found = math.nan if value is None else float(value[1]) * scale
    except ValueError:
        return math.nan
    return found if math.isfinite(found) else math.nan
