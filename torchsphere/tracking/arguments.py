"""Arguments of `track` by all of their names: those of Python, and those of the command line."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from torchsphere.geometry.camera import Camera
from torchsphere.recording import Recording, display
from torchsphere.recording.frame_range import resolve_range, restrict
from torchsphere.settings.arrays import as_stack
from torchsphere.settings.calibration import (
    CAMERA_NUMBERS,
    OPTION_NAMES,
    Calibration,
    exposure_share,
    implausible_units,
    with_option_names,
)
from torchsphere.settings.choices import MAPS
from torchsphere.settings.limits import SettingError, as_positive, require_one_of, require_within


def sphere_map(sphere_map: bool | None, name: str | None) -> bool | None:
    """The argument `sphere_map`, which the command line calls ``map``."""
    if name is None:
        return sphere_map
    require_one_of(tuple(MAPS))("map", name)
    if sphere_map is not None and sphere_map is not MAPS[name]:
        raise ValueError(f"sphere_map = {sphere_map!r} and map = {name!r} contradict each other; leave one out")
    return MAPS[name]


def calibration(recording: Any, given: dict[str, Any], options: dict[str, Any]) -> tuple[Calibration, tuple[str, ...]]:
    """What is known beside the images, and sentences on contradictions and units; takes its names from ``options``."""
    by_option = {name: options.pop(name) for name in OPTION_NAMES if OPTION_NAMES[name][0] in given and name in options}
    of_file = Calibration()
    with contextlib.suppress(ValueError):
        of_file = Calibration(frame_rate=getattr(recording, "frame_rate", None))
    found, notes = of_file.overridden(Calibration(**with_option_names("track", given, by_option)), "The file")
    return found, (*notes, *implausible_units(found.diameter_m, found.mass_kg))


def with_camera(options: dict[str, Any], diameter_m: float | None) -> dict[str, Any]:
    """The options with a camera in place of the numbers by which the command line describes one."""
    given = {name: options[name] for name in CAMERA_NUMBERS if options.get(name) is not None}
    rest = {name: value for name, value in options.items() if name not in CAMERA_NUMBERS}
    if not given:
        return rest
    if rest.get("camera") is not None:
        raise ValueError(f"camera and {', '.join(given)} were both given; leave one of them out")
    return rest | {"camera": Camera.of_numbers(given, None if diameter_m is None else 1e3 * diameter_m)}


def given_exposure(exposure: float | None, shutter_us: float | None, frame_rate: float | None) -> float | None:
    """The exposure over the time between frames; ``shutter_us`` is the exposure time, us."""
    if shutter_us is not None:
        if exposure is not None:
            raise ValueError("exposure and shutter_us were both given; leave one out")
        return exposure_share(as_positive("shutter_us", shutter_us), frame_rate)
    if exposure is not None:
        require_within("exposure", exposure, (0.0, 1.0))
    return exposure


@contextlib.contextmanager
def doubts_told(recording: Any) -> Iterator[None]:
    """Add a doubt about the recording's axes to a refusal: no ball shows in images that are cut the wrong way."""
    try:
        yield
    except ValueError as error:
        doubt = getattr(recording, "doubt", "")
        if not doubt:
            raise
        refusal = error if isinstance(error, SettingError) else SettingError(str(error))
        raise refusal.joined_by(doubt) from error


def as_shown(recording: Any, pixel_aspect: float | None, bayer: str | None) -> Any:
    """A recording of the images as a player shows them, where the sides of their pixels or a mosaic are given."""
    if pixel_aspect is None and bayer is None:
        return recording
    if isinstance(recording, Recording):
        return display.as_shown(recording.stored, pixel_aspect, bayer)
    images = as_stack(recording, "recording").cpu().numpy()
    n, height, width = images.shape
    array = Recording(path=Path(), kind="array", shape=(n, height, width), _reader=lambda a, b: images[a:b])
    return display.as_shown(array, pixel_aspect, bayer)


def part_of(recording: Any, frames: tuple[int | None, int | None] | slice | None) -> tuple[Any, int]:
    """The frames to measure, and the number of the first of them."""
    if frames is None:
        return recording, 0
    if isinstance(frames, slice):
        if frames.step not in (None, 1):
            raise ValueError(f"frames = {frames!r}: expected frames in a row, without a step")
        frames = (frames.start, frames.stop)
    if not isinstance(recording, Recording):
        recording = as_stack(recording, "recording")
    start, stop = resolve_range(frames, len(recording))
    return (restrict(recording, start, stop) if isinstance(recording, Recording) else recording[start:stop]), start
