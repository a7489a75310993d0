"""Axes of the images of a TIFF stack, as ImageJ, OME and tifffile state them: time, depth, channels."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

import tifffile


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
    pixels = re.search(r"<(?:\w+:)?Pixels\b[^>]*>", tif.ome_metadata or "")
    if pixels is not None:
        times, slices, channels = (_ome_size(pixels[0], letter) for letter in "TZC")
        # A channel of a colour image is no image of its own.
        return Axes("OME", times, slices, max(1, channels // samples) if samples >= 3 else channels)
    # The shapes of the arrays that tifffile wrote.
    shapes = [table.get("shape") for table in tif.shaped_metadata or ()]
    whole = [prod(shape) for shape in shapes if isinstance(shape, list) and all(_count(n) == n for n in shape)]
    return Axes("the header", images=sum(whole) // image_values)


def _ome_size(pixels: str, letter: str) -> int:
    found = re.search(rf"\bSize{letter}=\"(\d{{1,9}})\"", pixels)
    return _count(int(found[1])) if found is not None else 1


def _count(stated: Any) -> int:
    return stated if isinstance(stated, int) and stated > 0 else 1
