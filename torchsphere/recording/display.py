"""The images of a recording as a player shows them: grey from a mosaic, turned the right way up, with square pixels.

The readers of the formats state how the pixels are stored (`Facts.bayer`, `Facts.orientation`, `Facts.pixel_aspect`).
All that follows, from the circle to the report, lives in the images as they are shown.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording import mosaic, orientation, square_pixels
from torchsphere.recording.levels import GREY_NOTE
from torchsphere.recording.recording import Recording
from torchsphere.settings.choices import BAYER
from torchsphere.settings.limits import PIXEL_ASPECTS, SettingError, require_one_of, require_within

#: Largest denominator of a ratio that is said as one, as 11:10.
_MOST_PARTS = 200


def as_shown(stored: Recording, pixel_aspect: float | None = None, bayer: str | None = None) -> Recording:
    """The recording with its images as a player shows them, and a note on each step; unchanged without any step.

    Parameters
    ----------
    stored : Recording
        As its format's reader gives it: `Recording.stored`.
    pixel_aspect : float, optional
        Width of a stored pixel over its height, in place of the file's.
    bayer : str, optional
        One of `torchsphere.settings.choices.BAYER`, in place of the file's.

    Raises
    ------
    SettingError
        If what was given is out of its range, or the images are no mosaic as they are in colour.
    """
    recording, notes = _with_given(stored, pixel_aspect, bayer)
    shown = recording
    if recording.bayer is not None:
        shown, notes = _grey(shown), (*notes, _about_mosaic(recording))
    if recording.orientation != 1:
        shown, notes = _turned(shown), (*notes, _about_orientation(recording))
    if not square_pixels.is_square(recording.pixel_aspect):
        before = shown.shape[1:]
        shown = _square(shown)
        notes = (*notes, _about_pixels(recording, before, shown.shape[1:]))
    return shown if shown is stored else shown.changed(notes=(*shown.notes, *notes), _stored=stored)


def _with_given(stored: Recording, pixel_aspect: float | None, bayer: str | None) -> tuple[Recording, tuple[str, ...]]:
    """The recording with what was given in place of what it states, and sentences on contradictions and doubts."""
    facts: dict[str, Any] = {}
    origins, notes = dict(stored.origins), []
    if pixel_aspect is not None:
        require_within("pixel_aspect", pixel_aspect, PIXEL_ASPECTS)
        if stored.pixel_aspect is not None and abs(pixel_aspect - stored.pixel_aspect) > square_pixels.SQUARE_WITHIN:
            notes.append(
                f"The file states pixels of {ratio(stored.pixel_aspect)}; {ratio(pixel_aspect)} was given and used."
            )
        facts["pixel_aspect"], origins["pixel_aspect"] = float(pixel_aspect), "given"
    elif stored.pixel_aspect is not None and not PIXEL_ASPECTS[0] <= stored.pixel_aspect <= PIXEL_ASPECTS[1]:
        notes.append(
            f"The file states pixels of {ratio(stored.pixel_aspect)} (width to height, "
            f"{origins.get('pixel_aspect', 'its header')}), which no camera has: square pixels are taken. If they are "
            "not, give `pixel_aspect`."
        )
        facts["pixel_aspect"] = None
        origins.pop("pixel_aspect", None)
    if bayer is not None:
        require_one_of(BAYER)("bayer", bayer)
        if GREY_NOTE in stored.notes:
            raise SettingError(
                f"`bayer` = {bayer}: {stored.path} holds colour images, no mosaic of a sensor; leave it out"
            )
        if stored.bayer is not None and stored.bayer != bayer:
            notes.append(f"The file states a colour mosaic {stored.bayer}; {bayer} was given and used.")
        facts["bayer"], origins["bayer"] = bayer, "given"
    if not (facts or notes):
        return stored, ()
    return stored.changed(**facts, origins=origins), tuple(notes)


def _grey(recording: Recording) -> Recording:
    pattern = recording.bayer
    assert pattern is not None
    if min(recording.shape[1:]) < mosaic.LEAST_SIZE:
        raise SettingError(f"`bayer` = {pattern}: {recording.path} has images too small for a colour mosaic")
    return _changed(recording, lambda images: mosaic.green(images, pattern), recording.shape[1:])


def _turned(recording: Recording) -> Recording:
    code = recording.orientation
    height, width = recording.shape[1:]
    shape = (width, height) if orientation.swaps_axes(code) else (height, width)
    return _changed(recording, lambda images: orientation.turned(images, code), shape)


def _square(recording: Recording) -> Recording:
    """Images with square pixels, after they were turned."""
    aspect = recording.pixel_aspect
    assert aspect is not None
    aspect = 1 / aspect if orientation.swaps_axes(recording.orientation) else aspect
    shape = square_pixels.shape_with_square_pixels(recording.shape[1:], aspect)
    return _changed(recording, lambda images: square_pixels.with_square_pixels(images, aspect), shape)


def _changed(recording: Recording, change: Any, shape: tuple[int, ...]) -> Recording:
    """The recording with a ``change`` of its images (m, h, w), which then have a ``shape`` (h, w)."""

    def read(start: int, stop: int) -> NDArray[np.float32]:
        changed: NDArray[np.float32] = change(recording.images(start, stop))
        return changed

    return recording.changed(shape=(len(recording), *shape), _reader=read)


def ratio(aspect: float) -> str:
    """A width over height as 11:10, or as 1.0837:1 where it is no ratio of small numbers."""
    near = Fraction(aspect).limit_denominator(_MOST_PARTS)
    is_near = abs(near - Fraction(aspect)) < Fraction(aspect) / 10**6
    return f"{near.numerator}:{near.denominator}" if is_near else f"{aspect:.5g}:1"


def _source(recording: Recording, name: str) -> str:
    """Who says so, in brackets behind the fact."""
    origin = recording.origins.get(name, "its header")
    return "as given" if origin == "given" else f"as the file states ({origin})"


def _about_mosaic(recording: Recording) -> str:
    return (
        f"The images are the colour mosaic of a sensor, {recording.bayer} {_source(recording, 'bayer')}: they are "
        "measured on its green pixels, and grey levels between these are interpolated."
    )


def _about_orientation(recording: Recording) -> str:
    code = recording.orientation
    return (
        f"The images are shown {orientation.WORDS[code]}, {_source(recording, 'orientation')}, and as players show "
        f"them: x points right and y down in the shown image."
    )


def _about_pixels(recording: Recording, before: tuple[int, ...], after: tuple[int, ...]) -> str:
    assert recording.pixel_aspect is not None
    turned = " as stored" if orientation.swaps_axes(recording.orientation) else ""
    return (
        f"Pixels are {ratio(recording.pixel_aspect)} (width to height{turned}) {_source(recording, 'pixel_aspect')}: "
        f"images are drawn with square pixels, {after[1]} x {after[0]} px in place of {before[1]} x {before[0]}."
    )
