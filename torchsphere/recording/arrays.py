"""NumPy arrays: .npy, and .npz read image by image as a stream."""

from __future__ import annotations

import threading
import zipfile
from dataclasses import dataclass
from math import isfinite, prod
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording.levels import ALPHA_NOTE, GREY_NOTE, to_grey
from torchsphere.recording.recording import MAX_IMAGE_BYTES, Reader, Recording
from torchsphere.recording.refusal import library_failures

_SCALARS = ("frame_rate", "exposure_s")
#: Largest number of arrays that an archive is searched for the images (docs/constants.md).
_MAX_MEMBERS = 1000


@dataclass(frozen=True)
class _Layout:
    """An array as the header of its NPY file describes it."""

    shape: tuple[int, ...]
    fortran: bool
    dtype: np.dtype[Any]
    data_at: int  # bytes from the start of the member to its first value

    @property
    def nbytes(self) -> int:
        return prod(self.shape) * self.dtype.itemsize

    def __str__(self) -> str:
        return f"{self.dtype} {self.shape}"


def open_npy(path: Path) -> Recording:
    """Open an array of images ``(n, h, w)`` or ``(n, h, w, 3)``, mapped into memory."""
    with path.open("rb") as file:
        layout = _read_layout(path, file)
    _require_images(path, layout)
    size = path.stat().st_size
    if size < layout.data_at + layout.nbytes:
        raise OSError(
            f"{path}: is cut: the header states {layout}, {layout.nbytes} bytes, {size - layout.data_at} are present; "
            "copy the file again"
        )

    def read(start: int, stop: int) -> NDArray[Any]:
        # A new mapping for each call: the process keeps no pages of earlier images.
        with library_failures(path, "a NumPy array"):
            order = "F" if layout.fortran else "C"
            stack = np.memmap(path, layout.dtype, "r", layout.data_at, layout.shape, order)  # type: ignore[call-overload]
            return _grey(np.array(stack[start:stop]), layout)

    return _recording(path, layout, read, {})


def open_npz(path: Path) -> Recording:
    """Open the only array of images in an archive, as a stream of images.

    The archive may also hold the scalars ``frame_rate`` (1/s) and ``exposure_s``.
    """
    layouts, scalars = _members(path)
    stacks = [name for name, layout in layouts.items() if len(layout.shape) >= 3]
    if len(stacks) != 1:
        found = ", ".join(f"{name.removesuffix('.npy')}: {layout}" for name, layout in layouts.items()) or "nothing"
        raise ValueError(
            f"{path}: holds {len(stacks)} arrays of images, expected exactly one of shape (n, h, w); "
            f"found {found}; save the images alone"
        )
    member, layout = stacks[0], layouts[stacks[0]]
    _require_images(path, layout)
    if layout.fortran and layout.shape[0] > 1:
        raise ValueError(
            f"{path}: the images are stored in Fortran order, which cannot be read image by image; "
            "save numpy.ascontiguousarray of them"
        )
    stream = _Stream(path, member, layout)
    # The scalars that are single numbers were taken out of the layouts.
    notes = tuple(
        f"{name} in the file is {layouts[f'{name}.npy']}, not a single number, so it is not used; save it as a number."
        for name in _SCALARS
        if f"{name}.npy" in layouts
    )
    return _recording(path, layout, stream.read, scalars, stream, notes)


def _read_layout(path: Path, file: IO[bytes]) -> _Layout:
    with library_failures(path, "a NumPy array"):
        version = np.lib.format.read_magic(file)
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = header(file)
        return _Layout(shape, fortran, dtype, file.tell())


def _require_images(path: Path, layout: _Layout) -> None:
    if layout.dtype.kind not in "uif":
        raise ValueError(f"{path}: holds values of type {layout.dtype}, expected whole or floating-point grey levels")
    grey, colour = len(layout.shape) == 3, len(layout.shape) == 4 and layout.shape[3] in (3, 4)
    if not (grey or colour) or min(layout.shape) < 1:
        raise ValueError(
            f"{path}: the array has shape {layout.shape}, expected images (n, h, w), or (n, h, w, 3) in colour; "
            "reshape it (one image is n = 1)"
        )
    if layout.nbytes // layout.shape[0] > MAX_IMAGE_BYTES:
        raise ValueError(
            f"{path}: an image of {layout} takes {1e-6 * layout.nbytes / layout.shape[0]:.0f} MB, which no camera "
            "gives; the axes are (n, h, w)"
        )


def _grey(images: NDArray[Any], layout: _Layout) -> NDArray[Any]:
    return to_grey(images) if len(layout.shape) == 4 else images


def _recording(
    path: Path,
    layout: _Layout,
    read: Reader,
    scalars: dict[str, float],
    stream: _Stream | None = None,
    notes: tuple[str, ...] = (),
) -> Recording:
    if "frame_rate" not in scalars:
        notes += ("The file states no frame rate.",)
    if len(layout.shape) == 4:
        notes += (GREY_NOTE,) + ((ALPHA_NOTE,) if layout.shape[3] == 4 else ())
    depth = 8 if layout.dtype == np.uint8 else None
    origins = {name: f"NPZ {name}" for name in scalars} | ({"bit_depth": "NumPy type uint8"} if depth else {})
    n, height, width = layout.shape[:3]
    recording = Recording(
        path=path,
        kind="NumPy archive (NPZ)" if stream else "NumPy array (NPY)",
        shape=(n, height, width),
        bit_depth=depth,
        frame_rate=scalars.get("frame_rate"),
        exposure_s=scalars.get("exposure_s"),
        origins=origins,
        notes=notes,
        files=(path,),
        _reader=read,
        _closer=stream.close if stream else lambda: None,
    )
    if layout.dtype.kind == "f":
        recording.images(0, 1)
    return recording


def _members(path: Path) -> tuple[dict[str, _Layout], dict[str, float]]:
    layouts: dict[str, _Layout] = {}
    scalars: dict[str, float] = {}
    # The directory is read once: for each of many members, it would take minutes.
    with library_failures(path, "a NumPy archive"):
        archive = zipfile.ZipFile(path)
    with archive:
        infos = [info for info in archive.infolist() if info.filename.endswith(".npy")]
        if len(infos) > _MAX_MEMBERS:
            raise ValueError(f"{path}: holds {len(infos)} arrays, expected one of images; save the images alone")
        read = [_member(path, archive, info) for info in infos]
    for info, (layout, value) in zip(infos, read, strict=True):
        name = info.filename.removesuffix(".npy")
        # The header states no size for Python objects, which are never loaded.
        if not layout.dtype.hasobject and layout.data_at + layout.nbytes != info.file_size:
            raise OSError(
                f"{path}: array {name} states {layout}, but its data have another size; the file is cut, copy it again"
            )
        if value and layout.dtype.kind in "uif":
            scalars[name] = float(np.frombuffer(value, layout.dtype)[0])
            if not (isfinite(scalars[name]) and scalars[name] > 0):
                raise ValueError(f"{path}: {name} is {scalars[name]}, expected a positive number; correct or remove it")
        else:
            layouts[info.filename] = layout
    return layouts, scalars


def _member(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> tuple[_Layout, bytes]:
    """The layout of a member, and the bytes of its value if it is one of the scalars."""
    with library_failures(path, "a NumPy archive"), archive.open(info) as file:
        layout = _read_layout(path, file)
        is_scalar = info.filename.removesuffix(".npy") in _SCALARS and prod(layout.shape) == 1
        return layout, file.read(layout.dtype.itemsize) if is_scalar and layout.dtype.itemsize <= 16 else b""


class _Stream:
    """Images of one archive member, read forwards; the member is opened again for an earlier image."""

    def __init__(self, path: Path, member: str, layout: _Layout) -> None:
        self._path, self._member, self._layout = path, member, layout
        self._image_bytes = layout.nbytes // layout.shape[0]
        self._file: IO[bytes] | None = None
        self._lock = threading.Lock()  # threads share the position in the file

    def read(self, start: int, stop: int) -> NDArray[Any]:
        layout, first_byte = self._layout, self._layout.data_at + start * self._image_bytes
        with self._lock, library_failures(self._path, "a NumPy archive"):
            if self._file is None or self._file.tell() > first_byte:
                self.close()
                with zipfile.ZipFile(self._path) as archive:
                    self._file = archive.open(self._member)
            # Reading, unlike seeking, keeps the check of the checksum.
            while (gap := first_byte - self._file.tell()) > 0:
                self._bytes(self._file, min(gap, self._image_bytes))
            images = np.empty((stop - start, *layout.shape[1:]), layout.dtype)
            for row in images:
                row[...] = np.frombuffer(self._bytes(self._file, self._image_bytes), layout.dtype).reshape(row.shape)
            return _grey(images, layout)

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
        self._file = None

    def _bytes(self, file: IO[bytes], count: int) -> bytes:
        data = file.read(count)
        if len(data) < count:
            raise EOFError(f"image {(file.tell() - self._layout.data_at) // self._image_bytes} is incomplete")
        return data
