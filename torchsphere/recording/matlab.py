"""Images in MAT files: those of MATLAB 7.3 are HDF5 files, the others are loaded as a whole through SciPy."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording import hdf5
from torchsphere.recording.member import joined
from torchsphere.recording.recording import Recording
from torchsphere.recording.refusal import HDF5_SIGNATURE, HEAD_BYTES, library_failures
from torchsphere.recording.stack import NUMBERS, Convention, chosen, open_stack, stacks_among
from torchsphere.recording.stack_axes import ArrayType, Stored

#: In MATLAB the images of a stack stand along its last axis, and the colours of each in front of it.
_MAT = Convention("MATLAB array (MAT)", "MAT", "hwn", 2, "MATLAB class uint8")

#: NumPy's types by MATLAB's classes of numbers; other classes hold no images.
_TYPES = {"double": "f8", "single": "f4", "logical": "u1"} | {
    f"{sign}int{bits}": f"{sign or 'i'}{bits // 8}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}

#: Largest array that is loaded as a whole, bytes: no array of these files may be larger (docs/constants.toml).
MAX_BYTES = 2**31


def open_matlab(path: Path, axes: str | None = None, name: str = "") -> Recording:
    """Open the array of a ``name``, or the only one of images; its axes are (h, w, n) or (h, w, 3, n) unless given."""
    if _is_hdf5(path):
        return hdf5.open_hdf5(path, axes, name, _MAT, is_reversed=True)
    arrays = _arrays(path)
    stacks = stacks_among(arrays)
    name = chosen(path, arrays, name, stacks)
    array = arrays[name]
    if array.nbytes > MAX_BYTES:
        raise OSError(f"{path}: states {name} of {array}, more than such a file can hold; it is damaged, copy it again")
    loaded = _Loaded(path, name, array)
    stored = Stored(array, loaded.read, slow=len(array.shape) - 1, close=loaded.close)
    place = joined(path, name) if len(stacks) > 1 else path
    return open_stack(place, stored, _MAT, axes, _numbers(path, arrays))


def stacks_of(path: Path) -> list[str]:
    """Names of the arrays that may be images."""
    return hdf5.stacks_of(path, is_reversed=True) if _is_hdf5(path) else stacks_among(_arrays(path))


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as file:
        return HDF5_SIGNATURE in file.read(HEAD_BYTES)


def _arrays(path: Path) -> dict[str, ArrayType]:
    """Shape and type of each array; those of other classes than numbers have the type of objects."""
    from scipy.io import whosmat

    with library_failures(path, "a MATLAB file"):
        return {name: ArrayType(shape, np.dtype(_TYPES.get(kind, "O"))) for name, shape, kind in whosmat(path)}


def _load(path: Path, names: list[str]) -> dict[str, Any]:
    from scipy.io import loadmat

    with library_failures(path, "a MATLAB file"):
        return dict(loadmat(path, variable_names=names))


def _numbers(path: Path, arrays: dict[str, ArrayType]) -> dict[str, float | str]:
    """The values of `NUMBERS`, or what stands in their place."""
    given = {name: arrays[name] for name in NUMBERS if name in arrays}
    single = [name for name, array in given.items() if array.dtype.kind in "uif" and array.nbytes <= 8]
    values = _load(path, single) if single else {}
    return {name: float(values[name].item()) if name in single else str(array) for name, array in given.items()}


class _Loaded:
    """An array that is loaded when it is first read, and released when the recording is closed."""

    def __init__(self, path: Path, name: str, array: ArrayType) -> None:
        self._path, self._name, self._array = path, name, array
        self._values: NDArray[Any] | None = None
        self._lock = threading.Lock()

    def read(self, part: tuple[slice, ...]) -> NDArray[Any]:
        with self._lock:
            if self._values is None:
                self._values = self._load()
            return self._values[part]

    def _load(self) -> NDArray[Any]:
        values = np.asarray(_load(self._path, [self._name])[self._name])
        if values.shape != self._array.shape or values.dtype.kind not in "uif":
            raise ValueError(
                f"{self._path}: {self._name} is {ArrayType(values.shape, values.dtype)}, expected {self._array} of "
                "plain grey levels; save it as such"
            )
        return values

    def close(self) -> None:
        self._values = None
