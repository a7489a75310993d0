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

from torchsphere.recording.grey import ALPHA_NOTE, GREY_NOTE, to_grey
from torchsphere.recording.recording import Reader, Recording
from torchsphere.recording.refusal import library_failures

_SCALARS = ("frame_rate", "exposure_s")


@dataclass(frozen=True)
class _Layout:
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
    """Open an array of images ``(n, h, w)`` or ``(n, h, w, 3)``, mapped into memory.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Recording

    Raises
    ------
    ValueError
        Where the array is not numeric, has other dimensions, or its first image is not finite.
    OSError
        Where the file is cut or damaged.
    """
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
        # Mapped anew each time: pages of earlier images do not stay with the process.
        with library_failures(path, "a NumPy array"):
            order = "F" if layout.fortran else "C"
            stack = np.memmap(path, layout.dtype, "r", layout.data_at, layout.shape, order)  # type: ignore[call-overload]
            return _grey(np.array(stack[start:stop]), layout)

    return _recording(path, layout, read, {})


def open_npz(path: Path) -> Recording:
    """Open the only array of images in an archive, read as a stream and never whole.

    Parameters
    ----------
    path : Path
        Beside the images it may hold the scalars ``frame_rate`` (1/s) and ``exposure_s``.

    Returns
    -------
    Recording

    Raises
    ------
    ValueError
        Where there is not exactly one array of images, or it is not numeric.
    OSError
        Where the archive is cut or damaged.
    """
    layouts, scalars = _members(path)
    stacks = [name for name, layout in layouts.items() if len(layout.shape) >= 3]
    if len(stacks) != 1:
        there = ", ".join(f"{name.removesuffix('.npy')}: {layout}" for name, layout in layouts.items()) or "nothing"
        raise ValueError(
            f"{path}: holds {len(stacks)} arrays of images, expected exactly one of shape (n, h, w); "
            f"there are {there}; save the images alone"
        )
    member, layout = stacks[0], layouts[stacks[0]]
    _require_images(path, layout)
    if layout.fortran and layout.shape[0] > 1:
        raise ValueError(
            f"{path}: the images are stored in Fortran order, which cannot be read image by image; "
            "save numpy.ascontiguousarray of them"
        )
    stream = _Stream(path, member, layout)
    return _recording(path, layout, stream.read, scalars, stream, _not_read(layouts))


def _not_read(layouts: dict[str, _Layout]) -> tuple[str, ...]:
    """Notes on what has the name of a scalar and is none."""
    return tuple(
        f"{name} in the file is {layouts[f'{name}.npy']} and no single number, so it is not used; save it as one."
        for name in _SCALARS
        if f"{name}.npy" in layouts
    )


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


def _grey(images: NDArray[Any], layout: _Layout) -> NDArray[Any]:
    return to_grey(images) if len(layout.shape) == 4 else images


def _recording(
    path: Path,
    layout: _Layout,
    read: Reader,
    scalars: dict[str, float],
    stream: _Stream | None = None,
    doubts: tuple[str, ...] = (),
) -> Recording:
    notes: tuple[str, ...] = doubts if "frame_rate" in scalars else (*doubts, "The file states no frame rate.")
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
    with library_failures(path, "a NumPy archive"), zipfile.ZipFile(path) as archive:
        infos = [info for info in archive.infolist() if info.filename.endswith(".npy")]
    for info in infos:
        with library_failures(path, "a NumPy archive"), zipfile.ZipFile(path) as archive, archive.open(info) as file:
            layout = _read_layout(path, file)
            name = info.filename.removesuffix(".npy")
            value = file.read(layout.dtype.itemsize) if name in _SCALARS and prod(layout.shape) == 1 else b""
        # Of Python objects the header states no size; they are never loaded.
        if not layout.dtype.hasobject and layout.data_at + layout.nbytes != info.file_size:
            raise OSError(
                f"{path}: array {name} states {layout}, but its data have another size; it is cut, copy it again"
            )
        if value and layout.dtype.kind in "uif":
            scalars[name] = float(np.frombuffer(value, layout.dtype)[0])
            if not (isfinite(scalars[name]) and scalars[name] > 0):
                raise ValueError(f"{path}: {name} is {scalars[name]}, expected a positive number; correct or remove it")
        else:
            layouts[info.filename] = layout
    return layouts, scalars


class _Stream:
    """Reads images of one archive member forwards and starts again when asked for an earlier one."""

    def __init__(self, path: Path, member: str, layout: _Layout) -> None:
        self._path, self._member, self._layout = path, member, layout
        self._image_bytes = layout.nbytes // layout.shape[0]
        self._archive: zipfile.ZipFile | None = None
        self._file: IO[bytes] | None = None
        self._next = 0
        # Two threads would move the same position.
        self._lock = threading.Lock()

    def read(self, start: int, stop: int) -> NDArray[Any]:
        with self._lock, library_failures(self._path, "a NumPy archive"):
            file = self._at(start)
            images = np.empty((stop - start, *self._layout.shape[1:]), self._layout.dtype)
            for row in images:
                row[...] = np.frombuffer(self._one(file), self._layout.dtype).reshape(row.shape)
            return _grey(images, self._layout)

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
        if self._archive is not None:
            self._archive.close()
        self._file = self._archive = None

    def _at(self, start: int) -> IO[bytes]:
        if self._file is None or start < self._next:
            self.close()
            self._archive = zipfile.ZipFile(self._path)
            self._file = self._archive.open(self._member)
            self._file.read(self._layout.data_at)
            self._next = 0
        while self._next < start:
            self._one(self._file)
        return self._file

    def _one(self, file: IO[bytes]) -> bytes:
        data = file.read(self._image_bytes)
        if len(data) < self._image_bytes:
            raise EOFError(f"image {self._next} is not whole")
        self._next += 1
        return data
