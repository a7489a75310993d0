"""The two files of a suite that the renderer writes: images and truth."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from torchsphere.benchmark.checksum import TRUTH_COLUMNS

Array = NDArray[np.float64]

IMAGES, TRUTH = "frames.tif", "truth.csv"


def read_images(path: Path) -> NDArray[Any]:
    """Grey levels (n, h, w) of a stack, as they are stored; memory-mapped unless they are compressed.

    Raises
    ------
    ValueError
        Where the file is no stack of grey images.
    OSError
        Where it cannot be read.
    """
    try:
        images: NDArray[Any] = tifffile.imread(path, out="memmap")
    except (tifffile.TiffFileError, ValueError) as error:
        raise ValueError(f"{path}: is no stack of images ({error}); make the benchmark again") from error
    if images.ndim == 2:
        images = images[None]
    if images.ndim != 3 or images.dtype.kind != "u":
        raise ValueError(f"{path}: holds {images.dtype} of the shape {images.shape}, expected grey images (n, h, w)")
    return images


def read_truth(path: Path) -> dict[str, Array]:
    """Columns (n,) of a ``truth.csv`` by name, those of `TRUTH_COLUMNS` alone.

    Raises
    ------
    ValueError
        Where a column is missing or holds something else than finite numbers.
    OSError
        Where it cannot be read.
    """
    with path.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.reader(stream))
    head, body = (rows[0], rows[1:]) if rows else ([], [])
    missing = [name for name in TRUTH_COLUMNS if name not in head]
    if missing:
        raise ValueError(f"{path}: lacks the column {missing[0]}; expected {', '.join(TRUTH_COLUMNS)}")
    try:
        columns = {name: np.array([float(row[head.index(name)]) for row in body]) for name in TRUTH_COLUMNS}
    except (ValueError, IndexError) as error:
        raise ValueError(f"{path}: holds a row without its numbers ({error}); make the benchmark again") from error
    for name, column in columns.items():
        if not np.isfinite(column).all():
            raise ValueError(f"{path}: column {name} holds a number that is not finite; make the benchmark again")
    return columns
