"""NumPy arrays: .npy, and .npz read image by image as a stream."""

from __future__ import annotations

import threading
import zipfile
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording.member import joined
from torchsphere.recording.recording import Recording
from torchsphere.recording.refusal import library_failures
from torchsphere.recording.stack import NUMBERS, Convention, chosen, open_stack, stacks_among
from torchsphere.recording.stack_axes import ArrayType, Stored

#: Largest number of arrays that an archive is searched for the images (docs/constants.toml).
_MAX_MEMBERS = 1000

_NPY = Convention("NumPy array (NPY)", "NPY", depth_from="NumPy type uint8")
_NPZ = Convention("NumPy archive (NPZ)", "NPZ", depth_from="NumPy type uint8")


@dataclass(frozen=True)
class _Layout:
    """An array as the header of its NPY file describes it."""

    type: ArrayType
    fortran: bool
    data_at: int  # bytes from the start of the member to its first value


def open_npy(path: Path, axes: str | None = None) -> Recording:
    """Open an array of images, mapped into memory; its axes are (n, h, w), or (n, h, w, 3), unless others are given."""
    with path.open("rb") as file:
        layout = _read_layout(path, file)
    array, size = layout.type, path.stat().st_size
    if array.dtype.kind in "uif" and size < layout.data_at + array.nbytes:
        raise OSError(
            f"{path}: is cut: the header states {array}, {array.nbytes} bytes, {size - layout.data_at} are present; "
            "copy the file again"
        )

    def read(part: tuple[slice, ...]) -> NDArray[Any]:
        # A new mapping for each call: the process keeps no pages of earlier images.
        with library_failures(path, "a NumPy array"):
            order = "F" if layout.fortran else "C"
            stack = np.memmap(path, array.dtype, "r", layout.data_at, array.shape, order)  # type: ignore[call-overload]
            return np.array(stack[part])

    slow = len(array.shape) - 1 if layout.fortran else 0
    return open_stack(path, Stored(array, read, slow), _NPY, axes, {})


def open_npz(path: Path, axes: str | None = None, name: str = "") -> Recording:
    """Open an array of images in an archive, of that ``name`` or the only one, as a stream of images.

    The archive may also hold the scalars of `NUMBERS`.
    """
    layouts, numbers = _members(path)
    arrays = {member: layout.type for member, layout in layouts.items()}
    stacks = stacks_among(arrays)
    name = chosen(path, arrays, name, stacks or [other for other in arrays if len(arrays[other].shape) >= 3])
    layout = layouts[name]
    if layout.fortran and layout.type.shape[0] > 1 and layout.type.dtype.kind in "uif":
        raise ValueError(
            f"{path}: the images are stored in Fortran order, which cannot be read image by image; "
            "save numpy.ascontiguousarray of them"
        )
    stream = _Stream(path, f"{name}.npy", layout)
    place = joined(path, name) if len(stacks) > 1 else path
    stored = Stored(layout.type, stream.read, in_order=True, close=stream.close)
    return open_stack(place, stored, _NPZ, axes, numbers)


def _read_layout(path: Path, file: IO[bytes]) -> _Layout:
    with library_failures(path, "a NumPy array"):
        version = np.lib.format.read_magic(file)
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = header(file)
        return _Layout(ArrayType(shape, dtype), fortran, file.tell())


def _members(path: Path) -> tuple[dict[str, _Layout], dict[str, float | str]]:
    """The arrays of an archive by name, and its `NUMBERS` or what stands in their place."""
    layouts: dict[str, _Layout] = {}
    numbers: dict[str, float | str] = {}
    # The directory is read once: for each of many members, it would take minutes.
    with library_failures(path, "a NumPy archive"):
        archive = zipfile.ZipFile(path)
    with archive:
        infos = [info for info in archive.infolist() if info.filename.endswith(".npy")]
        if len(infos) > _MAX_MEMBERS:
            raise ValueError(f"{path}: holds {len(infos)} arrays, expected one of images; save the images alone")
        read = [_member(path, archive, info) for info in infos]
    for info, (layout, value) in zip(infos, read, strict=True):
        name, array = info.filename.removesuffix(".npy"), layout.type
        # The header states no size for Python objects, which are never loaded.
        if not array.dtype.hasobject and layout.data_at + array.nbytes != info.file_size:
            raise OSError(
                f"{path}: array {name} states {array}, but its data have another size; the file is cut, copy it again"
            )
        is_number = value and array.dtype.kind in "uif"
        if name in NUMBERS:
            numbers[name] = float(np.frombuffer(value, array.dtype)[0]) if is_number else str(array)
        if not is_number:
            layouts[name] = layout
    return layouts, numbers


def _member(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> tuple[_Layout, bytes]:
    """The layout of a member, and the bytes of its value if it is one of the scalars."""
    with library_failures(path, "a NumPy archive"), archive.open(info) as file:
        layout = _read_layout(path, file)
        size = layout.type.dtype.itemsize
        is_scalar = info.filename.removesuffix(".npy") in NUMBERS and prod(layout.type.shape) == 1 and size <= 16
        return layout, file.read(size) if is_scalar else b""


class _Stream:
    """Images of one archive member, read forwards; the member is opened again for an earlier image."""

    def __init__(self, path: Path, member: str, layout: _Layout) -> None:
        self._path, self._member, self._type, self._data_at = path, member, layout.type, layout.data_at
        self._image_bytes = layout.type.nbytes // max(1, layout.type.shape[0])
        self._file: IO[bytes] | None = None
        self._lock = threading.Lock()  # threads share the position in the file

    def read(self, part: tuple[slice, ...]) -> NDArray[Any]:
        """The values of a part, whole along all axes but the first."""
        start, stop, array = part[0].start, part[0].stop, self._type
        first_byte = self._data_at + start * self._image_bytes
        with self._lock, library_failures(self._path, "a NumPy archive"):
            if self._file is None or self._file.tell() > first_byte:
                self.close()
                with zipfile.ZipFile(self._path) as archive:
                    self._file = archive.open(self._member)
            # Reading, unlike seeking, keeps the check of the checksum.
            while (gap := first_byte - self._file.tell()) > 0:
                self._bytes(self._file, min(gap, self._image_bytes))
            images = np.empty((stop - start, *array.shape[1:]), array.dtype)
            for row in images:
                row[...] = np.frombuffer(self._bytes(self._file, self._image_bytes), array.dtype).reshape(row.shape)
            return images

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
        self._file = None

    def _bytes(self, file: IO[bytes], count: int) -> bytes:
        data = file.read(count)
        if len(data) < count:
            raise EOFError(f"image {(file.tell() - self._data_at) // self._image_bytes} is incomplete")
        return data
