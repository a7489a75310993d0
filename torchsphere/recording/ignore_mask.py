"""Regions of the image that are ignored, from mask images and polygons."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording.folder import IMAGE_SUFFIXES, read_image
from torchsphere.settings.limits import SettingError

#: Covered share of the ball's disc from which a mask counts as inverted (docs/constants.toml).
MOST_OF_BALL = 0.7


def read_ignore(texts: Sequence[str], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Union of masks (h, w), True where the image is ignored; raises ValueError or OSError for invalid texts.

    Each text names a mask image, which is not black where the recording is ignored, or holds polygons as
    ``x,y x,y x,y``, separated by semicolons.
    """
    mask = np.zeros(shape, dtype=bool)
    for text in texts:
        mask |= _region(text, shape)
    if mask.all():
        raise SettingError(
            f"`ignore` = {', '.join(texts)}: leaves nothing of the recording's images; pixels that are not black in a "
            "mask, or lie within a polygon, are ignored, and a mask's transparency is not read; invert an "
            "inverted mask again"
        )
    return mask


def located(texts: Sequence[str], folder: Path) -> list[str]:
    """The texts with mask images as paths from ``folder``; polygons, of any length, and missing images stay."""
    found = []
    for text in texts:
        path = folder / text
        try:
            found.append(str(path) if path.is_file() else text)
        except (OSError, ValueError):
            # A polygon may be longer than the name of a file may be.
            found.append(text)
    return found


def without_effect(texts: Sequence[str], shape: tuple[int, ...]) -> tuple[str, ...]:
    """Sentences on the texts that ignore no pixel of the images (h, w)."""
    black = "; pixels that are not black in a mask are ignored, its transparency is not read: paint the region white"
    return tuple(
        f"Given and without effect: `ignore` = {text!r} covers no pixel of the {shape[1]} x {shape[0]} px"
        f"{black if _is_image(text) else ''}."
        for text in texts
        if not _region(text, shape).any()
    )


def hides_ball(ignore: NDArray[np.bool_] | None, x: float, y: float, radius: float, frame: int) -> tuple[str, ...]:
    """A sentence if the mask (h, w) covers most of the ball's disc (px) in a frame, as an inverted mask does."""
    if ignore is None:
        return ()
    rows, columns = np.indices(ignore.shape)
    disc = (columns - x) ** 2 + (rows - y) ** 2 < radius**2
    share = float(ignore[disc].mean()) if disc.any() else 0.0
    if share < MOST_OF_BALL:
        return ()
    return (
        f"`ignore` covers {100 * share:.0f} % of the ball in frame {frame}; pixels that are not black in a mask are "
        "ignored, so invert a mask that shows the ball in white.",
    )


def _is_image(text: str) -> bool:
    return text.lower().endswith(IMAGE_SUFFIXES)


def _region(text: str, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """The mask (h, w) of one text."""
    mask = np.zeros(shape, dtype=bool)
    if _is_image(text):
        image = read_image(Path(text))
        if image.shape != tuple(shape):
            raise SettingError(
                f"`ignore` = {text}: has {image.shape[1]} x {image.shape[0]} px, "
                f"the recording {shape[1]} x {shape[0]} px; save the mask at the size of the recording"
            )
        return image > 0
    for part in filter(str.strip, text.split(";")):
        mask |= inside_polygon(_corners(part), shape)
    return mask


def _corners(text: str) -> NDArray[np.float64]:
    try:
        numbers = [float(v) for v in re.split(r"[\s,]+", text.strip()) if v]
    except ValueError as error:
        raise SettingError(
            f"`ignore` = {text!r}: expected a PNG image or a polygon as 'x,y x,y x,y ...' in px"
        ) from error
    if len(numbers) < 6 or len(numbers) % 2 or not all(map(math.isfinite, numbers)):
        raise SettingError(
            f"`ignore` = {text!r}: a polygon needs three or more corners 'x,y', all finite numbers in px"
        )
    return np.array(numbers).reshape(-1, 2)


def inside_polygon(corners: NDArray[np.float64], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Pixels (h, w) whose centres lie in the polygon of ``corners`` (m, 2) as (x, y): even-odd rule."""
    height, width = shape
    x, y = np.arange(width)[None, :], np.arange(height)[:, None]
    inside = np.zeros(shape, dtype=bool)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if y0 == y1:
            continue
        crossed = (y0 <= y) != (y1 <= y)
        inside ^= crossed & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return inside
