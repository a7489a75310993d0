"""A recording: the facts that its file states, and its images, read on request."""

from __future__ import annotations

import dataclasses
import operator
import weakref
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording.facts import Facts
from torchsphere.runtime.presentation import Presented

Reader = Callable[[int, int], NDArray[Any]]

#: Largest image, px, and its size as stored with all channels, bytes; larger images come from damaged headers, not from
#: cameras (docs/constants.toml).
MAX_PIXELS, MAX_IMAGE_BYTES = 2**26, 2**28


@dataclass(frozen=True, kw_only=True, slots=True, weakref_slot=True)
class Recording(Facts, Presented):
    """Images of one camera, in order, with the facts that the file states about them.

    The attributes are those of `Facts`.
    """

    _reader: Reader = field(repr=False, compare=False)
    _closer: Callable[[], None] = field(default=lambda: None, repr=False, compare=False)
    # As its format's reader gave it, where the images are shown otherwise than they are stored.
    _stored: Recording | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        n, height, width = self.shape
        if min(n, height, width) < 1 or height * width > MAX_PIXELS:
            raise ValueError(
                f"{self.path}: {n} images of {width} x {height} px are stated, which no recording has; "
                "the header is damaged, export the file again"
            )
        # Also releases the file of a recording that is dropped without being closed.
        weakref.finalize(self, self._closer)

    def __repr__(self) -> str:
        n, height, width = self.shape
        rate = "frame rate not stated" if self.frame_rate is None else f"{self.frame_rate:g} frames/s"
        return f"<Recording {str(self.path)!r}: {self.kind}, {n} images of {width} x {height} px, {rate}>"

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: int | slice) -> NDArray[np.float32]:
        """Image (h, w) of a number, counted from the end where negative, or images (m, h, w) of a slice.

        Raises
        ------
        IndexError
            If there is no such image.
        OSError
            If the file is cut or damaged.
        """
        numbers = range(len(self))[key]
        if isinstance(numbers, int):
            return self.images(numbers, numbers + 1)[0]
        if not numbers:
            return np.empty((0, *self.shape[1:]), np.float32)
        if numbers.step == 1:
            return self.images(numbers.start, numbers.stop)
        return np.concatenate([self.images(number, number + 1) for number in numbers])

    def __iter__(self) -> Iterator[NDArray[np.float32]]:
        """The images (h, w), one after the other; the memory holds one."""
        for number in range(len(self)):
            yield self[number]

    def images(self, start: int, stop: int, out: NDArray[np.float32] | None = None) -> NDArray[np.float32]:
        """Read images ``start`` to ``stop - 1``.

        Parameters
        ----------
        start, stop : int
            Half-open range of image numbers, ``0 <= start < stop <= len(self)``.
        out : ndarray of float32, optional
            Array of the shape returned, to read into; by default a new one.

        Returns
        -------
        ndarray of float32, shape (stop - start, h, w)
            Grey levels in the file's own digital levels (12 bit: 0 to 4095), row 0 at the top.

        Raises
        ------
        ValueError
            If the range does not fit, or a floating-point image holds values that are not finite.
        OSError
            If the file is cut or damaged.
        """
        first, last = self._range(start, stop)
        raw = self._reader(first, last)
        if raw.shape != (last - first, *self.shape[1:]):
            raise OSError(
                f"{self.path}: images {first} to {last - 1} came as an array of shape {raw.shape}, "
                f"expected {(last - first, *self.shape[1:])}; the file is damaged"
            )
        with np.errstate(over="ignore"):
            if out is None:
                grey = np.ascontiguousarray(raw, dtype=np.float32)
            else:
                grey = out
                np.copyto(grey, raw, casting="unsafe")
        if raw.dtype.kind == "f" and not np.isfinite(grey).all():
            bad = first + int(np.flatnonzero(~np.isfinite(grey).all(axis=(1, 2)))[0])
            raise ValueError(
                f"{self.path}: image {bad} holds values that are not finite; "
                "expected plain grey levels, so replace them in the file (a mask comes after reading and does not help)"
            )
        return grey

    def _range(self, start: int, stop: int) -> tuple[int, int]:
        try:
            first, last = operator.index(start), operator.index(stop)
        except TypeError:
            first = last = -1
        if not 0 <= first < last <= len(self):
            raise ValueError(
                f"images {start!r} to {stop!r} were asked for; the recording has {len(self)}, "
                "so give whole numbers with 0 <= start < stop <= that"
            )
        return first, last

    @property
    def stored(self) -> Recording:
        """The recording with its images as they are stored, without what `torchsphere.recording.display` does."""
        return self if self._stored is None else self._stored

    def changed(self, **fields: Any) -> Recording:
        """The recording with other facts, or another reader, of the same file."""
        # The new recording refers to this one by its closer: a dropped recording releases its file.
        return dataclasses.replace(self, **({"_closer": self.close} | fields))

    def close(self) -> None:
        """Release the file; reading again may fail or open the file again, depending on the format."""
        self._closer()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
