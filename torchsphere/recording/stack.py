"""A recording from one array of images in a file: its axes, colour and frame rate, and reading in blocks."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording.facts import doubt_notes, stated
from torchsphere.recording.levels import ALPHA_NOTE, GREY_NOTE, to_grey
from torchsphere.recording.member import joined, split
from torchsphere.recording.recording import MAX_IMAGE_BYTES, Reader, Recording
from torchsphere.recording.stack_axes import ArrayType, Axes, Stored, likelier_order, may_hold_ball
from torchsphere.settings.limits import SettingError

#: Names of numbers beside the images, and the facts of a recording that they are: 1/s, 1/s and s.
NUMBERS = {"frame_rate": "frame_rate", "fps": "frame_rate", "exposure_s": "exposure_s"}

#: Bytes of images that are read at once where single images cannot be read alone (docs/constants.toml).
BLOCK_BYTES = 2**27

#: Number of arrays that a refusal lists.
_LISTED = 12


@dataclass(frozen=True)
class Convention:
    """What a kind of file says of its arrays."""

    kind: str  # in words
    short: str  # in a word, as in "NPZ frame_rate"
    order: str = "nhw"  # of the axes, unless another one is given
    channels_at: int = 3  # place of the axis of colours
    depth_from: str = "type uint8"


def open_stack(
    path: Path, stored: Stored, convention: Convention, given: str | None, numbers: Mapping[str, float | str]
) -> Recording:
    """The recording of an array in a file.

    ``path`` is that of the file, or of the array in it. ``given`` is the order of the axes where the user states one.
    ``numbers`` are the values in the file by the names of `NUMBERS`, or the type and shape of what is no number. Raises
    ValueError for other arrays than images.
    """
    axes = _axes(path, stored, convention, given)
    n, height, width = (axes.size(letter, stored.type.shape) for letter in "nhw")
    known, names, number_notes = _known(path, numbers)
    facts = {fact: (known[fact], f"{convention.short} {name}") for fact, name in names.items()}
    notes = stored.notes + number_notes
    if "frame_rate" not in known:
        notes += ("The file states no frame rate.",)
    if axes.channels:
        notes += (GREY_NOTE,) + ((ALPHA_NOTE,) if axes.size("c", stored.type.shape) == 4 else ())
    doubt = "" if given else _doubt(stored, axes)
    depth: tuple[int | None, str] = 8 if stored.type.dtype == np.uint8 else None, convention.depth_from
    recording = Recording(
        path=path,
        kind=convention.kind,
        shape=(n, height, width),
        **stated({**facts, "bit_depth": depth}),
        notes=notes + doubt_notes(doubt),
        files=(split(path)[0],),
        doubt=doubt,
        _reader=_reader(stored, axes),
        _closer=stored.close,
    )
    if stored.type.dtype.kind == "f":
        recording.images(0, 1)
    return recording


def stacks_among(arrays: Mapping[str, ArrayType]) -> list[str]:
    """Names of the arrays that may be images of a ball: not matrices of rotation, nor covariances."""
    return [name for name, array in arrays.items() if _is_stack(array)]


def chosen(path: Path, arrays: Mapping[str, ArrayType], name: str, stacks: list[str]) -> str:
    """The array of a ``name``, or the only one of the ``stacks``; raises ValueError without one."""
    if name in arrays or (not name and len(stacks) == 1):
        return name or stacks[0]
    listed = [*stacks, *(other for other in arrays if other not in stacks)]
    found = ", ".join(f"{other}: {arrays[other]}" for other in listed[:_LISTED]) or "nothing"
    found += f" and {len(listed) - _LISTED} more" if len(listed) > _LISTED else ""
    if name:
        raise ValueError(f"{path}: holds no array {name!r}; found {found}")
    advice = f"name one, as in {joined(path, stacks[0])}" if stacks else "save the images as such an array"
    raise ValueError(
        f"{path}: holds {len(stacks)} arrays of images, expected exactly one of shape (n, h, w); found {found}; "
        f"{advice}"
    )


def _is_stack(array: ArrayType) -> bool:
    if array.dtype.kind not in "uif" or Axes.of(array.shape, "hwn", 3) is None:
        return False
    lengths = sorted(array.shape)
    return lengths[0] > 0 and may_hold_ball(*lengths[-2:])


def _axes(path: Path, stored: Stored, convention: Convention, given: str | None) -> Axes:
    """The axes of the array; raises ValueError unless it holds images of a camera."""
    array = stored.type
    if array.dtype.kind not in "uif":
        raise ValueError(f"{path}: holds values of type {array.dtype}, expected whole or floating-point grey levels")
    order = given or convention.order
    axes = Axes.of(array.shape, order, convention.channels_at)
    if axes is None or min(array.shape) < 1:
        colour = (*order[: convention.channels_at], "3", *order[convention.channels_at :])
        is_turned = Axes.of(array.shape, "hwn", 2) is not None
        hint = ", or give `axes` = hwn if they are (h, w, 3, n)" if is_turned else ""
        raise SettingError(
            f"{path}: the array has shape {array.shape}, expected images ({', '.join(order)}), or "
            f"({', '.join(colour)}) in colour; reshape it (one image is n = 1){hint}"
        )
    n = axes.size("n", array.shape)
    if array.nbytes // n > MAX_IMAGE_BYTES:
        raise ValueError(
            f"{path}: an image of {array} takes {1e-6 * array.nbytes / n:.0f} MB, which no camera gives; the axes "
            f"are ({', '.join(order)})"
        )
    if stored.in_order and not axes.letters.startswith("n"):
        raise ValueError(
            f"{path}: an archive is read image by image, and its images do not stand along the first axis; save them "
            "as an NPY file, or numpy.moveaxis of them"
        )
    return axes


def _known(path: Path, numbers: Mapping[str, float | str]) -> tuple[dict[str, float], dict[str, str], tuple[str, ...]]:
    """The facts that numbers in the file state, the names of these numbers, and notes on what is no number."""
    known: dict[str, float] = {}
    names: dict[str, str] = {}
    notes: tuple[str, ...] = ()
    for name, fact in NUMBERS.items():
        value = numbers.get(name)
        if isinstance(value, str):
            notes += (f"{name} in the file is {value}, not a single number, so it is not used; save it as a number.",)
        elif value is not None and not (isfinite(value) and value > 0):
            raise ValueError(f"{path}: {name} is {value}, expected a positive number; correct or remove it")
        elif value is not None and known.setdefault(fact, value) != value:
            notes += (f"{name} in the file is {value:g}, and {fact} is {known[fact]:g}, which is used.",)
        elif value is not None:
            names.setdefault(fact, name)
    return known, names, notes


def _doubt(stored: Stored, axes: Axes) -> str:
    """A sentence where the axes seem to have another order, with the option that turns them; empty without doubt."""
    likelier = likelier_order(stored, axes)
    if not likelier:
        return ""
    order = axes.letters.replace("c", "")
    taken, looks = (f"({', '.join(letters)})" for letters in (order, likelier))
    return (
        f"the array {stored.type.shape} is taken as {taken} and looks like {looks}: give `axes` = {likelier} to turn "
        f"it, or `axes` = {order} if it is right as it is"
    )


def _reader(stored: Stored, axes: Axes) -> Reader:
    def read(start: int, stop: int) -> NDArray[Any]:
        images = axes.images(stored.read(axes.part(start, stop)))
        return to_grey(images) if axes.channels else images

    count = _images_at_once(stored, axes)
    return read if count == 1 else _Blocks(read, axes.size("n", stored.type.shape), count).read


def _images_at_once(stored: Stored, axes: Axes) -> int:
    """Number of images that take the time of one."""
    place = axes.letters.index("n")
    affordable = max(1, BLOCK_BYTES * stored.type.shape[place] // stored.type.nbytes)
    if stored.pieces:
        return min(stored.pieces[place], affordable)
    return 1 if place == stored.slow else affordable


class _Blocks:
    """Images that are read in blocks, of which the last one is kept."""

    def __init__(self, read: Reader, count: int, size: int) -> None:
        self._read, self._count, self._size = read, count, size
        self._number, self._block = -1, np.empty(0)
        self._lock = threading.Lock()  # threads share the block

    def read(self, start: int, stop: int) -> NDArray[Any]:
        parts = []
        with self._lock:
            for number in range(start // self._size, (stop - 1) // self._size + 1):
                first = number * self._size
                if number != self._number:
                    self._block = self._read(first, min(first + self._size, self._count))
                    self._number = number
                parts.append(self._block[max(0, start - first) : stop - first])
            # A copy, which the caller may change.
            return np.concatenate(parts)
