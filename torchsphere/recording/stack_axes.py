"""The axes of an array of images: their order, and a doubt about it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Spread of the images' mean and contrast along the axis of time over that along the axis that may be it instead, from
#: which the order is doubted (docs/constants.toml).
DOUBT_RATIO = 4.0
#: Largest number of planes, and of their values along an axis, that a look at an array takes.
LOOK_PLANES, LOOK_VALUES = 32, 256
#: Bytes that are read for a look at an array.
LOOK_BYTES = 2**26

#: Numbers of channels of a colour image.
_CHANNELS = (3, 4)
#: Longest side that cannot show a ball: `check_circle` takes balls of 3 px radius.
_TOO_SHORT_PX = 6


@dataclass(frozen=True)
class ArrayType:
    """Shape and type of an array."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    @property
    def nbytes(self) -> int:
        """Size of all values."""
        return prod(self.shape) * self.dtype.itemsize

    def __str__(self) -> str:
        return f"{self.dtype} {self.shape}"


@dataclass(frozen=True)
class Stored:
    """An array in a file, and how a part of it is read."""

    type: ArrayType
    read: Callable[[tuple[slice, ...]], NDArray[Any]]  # values of a part, in the order of the axes
    slow: int = 0  # axis across which planes are read soonest
    in_order: bool = False  # whether planes are read one after the other alone
    pieces: tuple[int, ...] = ()  # lengths of the pieces that are stored together; empty where values stand alone
    notes: tuple[str, ...] = ()  # sentences for the user
    close: Callable[[], None] = lambda: None  # release what reading holds


@dataclass(frozen=True)
class Axes:
    """The order of the axes of an array, a letter each: number, height, width, and channel of a colour."""

    letters: str

    @classmethod
    def of(cls, shape: Sequence[int], order: str, channels_at: int) -> Axes | None:
        """The axes of an array in that ``order``; None unless there are three, or four with channels of a colour.

        Channels stand last, or between the axes of an image and that of the images; ``channels_at`` is their place
        where both could be.
        """
        if len(shape) == 3:
            return cls(order)
        can_be = (3, 2) if order.endswith("n") else (3,)
        places = [place for place in (channels_at, *can_be) if len(shape) == 4 and shape[place] in _CHANNELS]
        return cls(order[: places[0]] + "c" + order[places[0] :]) if places else None

    @property
    def channels(self) -> bool:
        """Whether the images have colour."""
        return "c" in self.letters

    def size(self, letter: str, shape: Sequence[int]) -> int:
        """Length of one axis."""
        return shape[self.letters.index(letter)]

    def part(self, start: int, stop: int) -> tuple[slice, ...]:
        """The part of the array that holds images ``start`` to ``stop - 1``."""
        return tuple(slice(start, stop) if letter == "n" else slice(None) for letter in self.letters)

    def images(self, values: NDArray[Any]) -> NDArray[Any]:
        """Images (n, h, w) or (n, h, w, c) of a part of the array."""
        return values.transpose([self.letters.index(letter) for letter in ("nhwc" if self.channels else "nhw")])


def may_hold_ball(height: int, width: int) -> bool:
    """Whether a ball can show in images of that size, as it cannot in columns of three numbers."""
    return min(height, width) > _TOO_SHORT_PX


def likelier_order(stored: Stored, axes: Axes) -> str:
    """The order, of "nhw" and "hwn", that fits the array clearly better than that of ``axes``; empty without one.

    All images of a still camera have about the same mean and contrast; the rows of a scene do not, and a ball that
    crosses a part of the rows adds to that.
    """
    order = axes.letters.replace("c", "")
    other = "hwn" if order[0] == "n" else "nhw"
    places = [place for place, letter in enumerate(axes.letters) if letter != "c"]
    sizes = [stored.type.shape[place] for place in places]
    fits, other_fits = (
        may_hold_ball(*(size for size, letter in zip(sizes, name, strict=True) if letter != "n"))
        for name in (order, other)
    )
    if not (fits and other_fits):
        return other if other_fits else ""
    with np.errstate(invalid="ignore", over="ignore"):
        look = _look(stored, axes)
        along = [_spread(look, axis) for axis in (order.index("n"), other.index("n"))]
    return other if along[1] * DOUBT_RATIO < along[0] else ""


def _look(stored: Stored, axes: Axes) -> NDArray[np.float32]:
    """Some values (a, b, c) of the array in the order of its axes: planes that are thinned out."""
    slow, shape = stored.slow, stored.type.shape
    count = shape[slow]
    together = stored.pieces[slow] if stored.pieces else 1
    affordable = max(2, LOOK_BYTES * count // (stored.type.nbytes * together))
    last = min(count, affordable) if stored.in_order else count
    rows = np.unique(np.linspace(0, last - 1, min(LOOK_PLANES, affordable)).astype(int))
    thin = tuple(slice(None, None, -(-size // LOOK_VALUES)) for size in shape)
    every = [slice(None)] * len(shape)
    planes = []
    for row in rows.tolist():
        plane = stored.read(tuple(slice(row, row + 1) if axis == slow else whole for axis, whole in enumerate(every)))
        planes.append(plane[tuple(slice(None) if axis == slow else thin[axis] for axis in range(len(every)))])
    values = np.concatenate(planes, slow, dtype=np.float32, casting="unsafe")
    return values[(slice(None),) * axes.letters.index("c") + (1,)] if axes.channels else values


def _spread(values: NDArray[np.float32], axis: int) -> float:
    """Width of the range that holds the mean and the contrast of most of the slices along an axis."""
    others = tuple({0, 1, 2} - {axis})
    widths = [np.quantile(of, 0.95) - np.quantile(of, 0.05) for of in (values.mean(others), values.std(others))]
    return float(np.hypot(*widths))
