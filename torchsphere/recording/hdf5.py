"""Images in HDF5 files, those of MATLAB 7.3 among them, through h5py; read in the pieces in which they are stored."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording.member import joined
from torchsphere.recording.recording import Recording
from torchsphere.recording.refusal import LibraryMissingError, library_failures
from torchsphere.recording.stack import NUMBERS, Convention, chosen, open_stack, stacks_among
from torchsphere.recording.stack_axes import ArrayType, Stored

_HDF5 = Convention("HDF5", "HDF5", depth_from="HDF5 type uint8")


def open_hdf5(
    path: Path, axes: str | None = None, name: str = "", convention: Convention = _HDF5, *, is_reversed: bool = False
) -> Recording:
    """Open the dataset of a ``name``, or the only one of images; its axes are those of h5py unless others are given.

    ``is_reversed`` if the axes of the file stand in the opposite order, as those of MATLAB.
    """
    with _opened(path) as file:
        arrays = _arrays(path, file, is_reversed)
        stacks = stacks_among(arrays)
        name = chosen(path, arrays, name, stacks)
        array, place = arrays[name], joined(path, name) if len(stacks) > 1 else path
        with library_failures(path, "an HDF5 file"):
            dataset = file[name]
            numbers, pieces = _numbers(dataset, file), dataset.chunks or ()
        notes = _require_present(path, dataset)

    def read(part: tuple[slice, ...]) -> NDArray[Any]:
        # No open file stays with the process.
        with _opened(path) as file, library_failures(path, "an HDF5 file"):
            values = np.asarray(file[name][part[::-1] if is_reversed else part])
        return values.transpose() if is_reversed else values

    stored = Stored(
        array,
        read,
        slow=len(array.shape) - 1 if is_reversed else 0,
        pieces=pieces[::-1] if is_reversed else pieces,
        notes=notes,
    )
    return open_stack(place, stored, convention, axes, numbers)


def stacks_of(path: Path, *, is_reversed: bool = False) -> list[str]:
    """Names of the datasets that may be images."""
    with _opened(path) as file:
        return stacks_among(_arrays(path, file, is_reversed))


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    try:
        import h5py
    except ImportError as error:
        raise LibraryMissingError(
            f'{path}: reading HDF5 needs h5py, which is not installed; run: pip install "torchsphere[export]"'
        ) from error
    with library_failures(path, "an HDF5 file"):
        file = h5py.File(path, "r")
    with file:
        yield file


def _arrays(path: Path, file: Any, is_reversed: bool) -> dict[str, ArrayType]:
    """Shape and type of each dataset; links out of the file are not followed."""
    import h5py

    found: dict[str, ArrayType] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.shape is not None:
            found[name] = ArrayType(item.shape[::-1] if is_reversed else item.shape, item.dtype)

    with library_failures(path, "an HDF5 file"):
        file.visititems(visit)
    return found


def _numbers(dataset: Any, file: Any) -> dict[str, float | str]:
    """The values of `NUMBERS`: attributes and datasets of the images, of their group, or of the file."""
    places: tuple[Mapping[str, Any], ...] = (dataset.attrs, dataset.parent, dataset.parent.attrs, file, file.attrs)
    found = {name: next((place[name] for place in places if name in place), None) for name in NUMBERS}
    return {name: _number(item) for name, item in found.items() if item is not None}


def _number(item: Any) -> float | str:
    """The value of an attribute or a dataset that is a single number, or else its type and shape."""
    dtype, shape = getattr(item, "dtype", None), getattr(item, "shape", None)
    if dtype is None or shape is None:
        return type(item).__name__
    return float(np.asarray(item[()]).item()) if dtype.kind in "uif" and math.prod(shape) == 1 else f"{dtype} {shape}"


def _require_present(path: Path, dataset: Any) -> tuple[str, ...]:
    """Raise OSError where the images lie in other files that are missing; notes on pieces that were never written."""
    sources = {source.file_name for source in dataset.virtual_sources()} if dataset.is_virtual else set()
    missing = sorted(name for name in sources - {"."} if not (path.parent / name).exists())
    if missing:
        raise OSError(f"{path}: its images lie in {missing[0]}, which is missing; copy all files of the recording")
    if dataset.chunks is None or dataset.is_virtual:
        return ()
    stated = math.prod(-(-size // piece) for size, piece in zip(dataset.shape, dataset.chunks, strict=True))
    lacking = stated - dataset.id.get_num_chunks()
    if lacking == stated:
        raise OSError(f"{path}: states {dataset.shape} of {dataset.name}, and none of it was written; export it again")
    if lacking:
        return (f"{lacking} of the {stated} pieces of the images were never written, and read as their fill value.",)
    return ()
