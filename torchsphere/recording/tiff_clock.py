"""The frame rate of a TIFF, and the times of its images, as ImageJ and OME state them."""

from __future__ import annotations

import math
import re
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording import image_times
from torchsphere.settings.limits import FRAME_RATES

_TIME_UNITS_S = {
    "s": 1.0,
    "sec": 1.0,
    "ms": 1e-3,
    "msec": 1e-3,
    "us": 1e-6,
    "µs": 1e-6,
    "μs": 1e-6,
    "usec": 1e-6,
    "ns": 1e-9,
    "min": 60.0,
    "h": 3600.0,
}

#: Times of the planes of an OME file that are read, a plane an image.
_PLANE = re.compile(r"<(?:\w+:)?Plane\b[^>]*>")


@dataclass(frozen=True)
class TiffClock:
    """Frame rate, 1/s, its source, and times of the images in frame intervals; None where not stated."""

    frame_rate: float | None = None
    origin: str = ""
    times: NDArray[np.float64] | None = None
    notes: tuple[str, ...] = ()


def clock_of(imagej: dict[str, Any], ome: str | None, count: int) -> TiffClock:
    """The clock of ``count`` images from the metadata of ImageJ or the XML of OME."""
    pixels = re.search(r"<(?:\w+:)?Pixels\b[^>]*>", ome or "")
    if pixels is not None and ome is not None:
        return _of_ome(pixels[0], ome, count)
    rate, notes = _of_imagej(imagej)
    return TiffClock(rate, "ImageJ finterval" if rate else "", None, notes)


def _of_ome(pixels: str, ome: str, count: int) -> TiffClock:
    """The interval that OME states for all images, or their own times, which count where both do."""
    increment = _seconds(pixels, "TimeIncrement")
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
    times = np.array([_seconds(plane, "DeltaT", missing=math.nan) for plane in planes])
    if any(number is None for number in numbers):
        return None
    order = np.argsort([int(number[1]) for number in numbers if number is not None], kind="stable")
    return times[order]


def _seconds(element: str, name: str, missing: float = 0.0) -> float:
    """A time of an element of OME, s; a time without a unit is in seconds."""
    value = re.search(rf'\b{name}="([^"]{{1,40}})"', element)
    unit = re.search(rf'\b{name}Unit="([^"]{{1,20}})"', element)
    scale = _TIME_UNITS_S.get("s" if unit is None else unit[1].strip(), math.nan)
    try:
        found = missing if value is None else float(value[1]) * scale
    except ValueError:
        return missing
    return found if math.isfinite(found) else missing


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
