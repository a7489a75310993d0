"""Checksums that say whether two people have the same recordings."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Columns of the truth that a score may rest on.
TRUTH_COLUMNS = ("frame", "time_s", "x_px", "y_px", "radius_px", "qw", "qx", "qy", "qz", "visible")

#: Decimals of the truth that count. The last bits of sine and cosine differ between processors' mathematical libraries.
DECIMALS = 9

_BLOCK = 64


def of_suite(images: NDArray[Any], truth: Mapping[str, NDArray[Any]]) -> str:
    """Checksum of a suite: over its images' decoded grey levels, their shape and type, and over its truth.

    Parameters
    ----------
    images : (n, h, w) ndarray
        Grey levels; a memory-mapped array is read a block of frames at a time.
    truth : mapping of str to (n,) ndarray
        At least `TRUTH_COLUMNS`; each number counts to nine decimals.

    Returns
    -------
    str
        ``sha256:`` and 64 hexadecimal digits.
    """
    digest = hashlib.sha256(f"{images.dtype.name} {images.shape}\n".encode())
    little = images.dtype.newbyteorder("<")
    for start in range(0, len(images), _BLOCK):
        digest.update(np.ascontiguousarray(images[start : start + _BLOCK], dtype=little).tobytes())
    for name in TRUTH_COLUMNS:
        # Adding zero turns -0.0 into 0.0.
        numbers = np.round(np.asarray(truth[name], dtype=np.float64), DECIMALS) + 0.0
        digest.update(f"\n{name} ".encode() + " ".join(f"{v:.{DECIMALS}f}" for v in numbers.tolist()).encode())
    return f"sha256:{digest.hexdigest()}"


def of_benchmark(description: Mapping[str, Any]) -> str:
    """Checksum of a whole benchmark: over everything in its ``suites.json``, the suites' checksums included.

    Parameters
    ----------
    description : mapping
        What the file holds; its own ``checksum`` and the ``renderer``, which is told but not part of what was made, are
        left out.

    Returns
    -------
    str
        ``sha256:`` and 64 hexadecimal digits.
    """
    counted = {name: value for name, value in description.items() if name not in ("checksum", "renderer")}
    text = json.dumps(counted, sort_keys=True, ensure_ascii=True, allow_nan=False)
    return f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"
