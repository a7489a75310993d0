"""Checks of arrays and numbers that come from outside, each with one sentence on what is wrong."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor


def as_images(images: Any, name: str = "images") -> Tensor:
    """Images as a tensor (n, h, w); float64 stays, everything else becomes float32.

    Raises
    ------
    ValueError
        If the array is not of numbers, has not two or three axes, or some of its values are masked.
    """
    _require_unmasked(
        images, name, "plain grey levels: give its `data`, and as `ignore` (h, w) what is masked in any of the images"
    )
    try:
        tensor = images.detach() if isinstance(images, Tensor) else torch.from_numpy(_native(np.asarray(images)))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: expected an array (n, h, w) of grey levels, got {_instead(images)}") from error
    if tensor.is_complex() or tensor.ndim not in (2, 3) or 0 in tensor.shape:
        raise ValueError(f"{name}: expected real grey levels (n, h, w) or (h, w), got shape {tuple(tensor.shape)}")
    tensor = tensor if tensor.ndim == 3 else tensor[None]
    return tensor if tensor.dtype == torch.float64 else tensor.float()


def _instead(images: Any) -> str:
    """What came in place of images, in words, and what to do."""
    if isinstance(images, (str, Path)):
        hint = f"; open the file with torchsphere.open_recording({str(images)!r}) first"
    elif isinstance(images, np.ndarray):
        hint = f" of type {images.dtype}"
    elif hasattr(images, "images"):
        hint = "; give what its images(start, stop) returns"
    else:
        hint = ""
    return f"{type(images).__name__}{hint}"


def _require_unmasked(values: Any, name: str, expected: str) -> None:
    """Raise ValueError where values of a NumPy masked array, or of one in a list, are masked: torch knows no masks."""
    parts = values if isinstance(values, (list, tuple)) else [values]
    masked = sum(int(np.ma.getmaskarray(part).sum()) for part in parts if isinstance(part, np.ma.MaskedArray))
    if masked:
        raise ValueError(f"{name}: got a masked array with {masked} of its values masked; expected {expected}")


def _native(array: np.ndarray) -> np.ndarray:
    """The array in a type that torch knows: unsigned 16 and 32 bit and foreign byte orders are widened."""
    if array.dtype.kind not in "buif":
        raise ValueError(f"no numbers: {array.dtype}")
    if not array.flags.writeable or min(array.strides, default=0) < 0:
        # Torch cannot share memory that it must not write to, or that runs backwards.
        array = array.copy()
    return array if array.dtype in (np.float64, np.float32, np.uint8) else array.astype(np.float32)


def as_mask(mask: Any, images: Tensor) -> Tensor:
    """Boolean mask (h, w) on the images' device.

    Raises
    ------
    ValueError
        If it is not of numbers, its shape is not that of one image, some of its values are masked, or it leaves
        nothing of the images.
    """
    _require_unmasked(mask, "ignore", "True where images are not to be used: give its `mask` alone, or `filled(True)`")
    try:
        tensor = mask.detach() if isinstance(mask, Tensor) else torch.from_numpy(_native(np.asarray(mask)))
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"ignore: expected an array (h, w), True where images are not to be used, got {type(mask).__name__}"
        ) from error
    if tuple(tensor.shape) != tuple(images.shape[-2:]):
        expected = tuple(images.shape[-2:])
        raise ValueError(f"ignore: expected a mask of the image's shape (h, w) = {expected}, got {tuple(tensor.shape)}")
    if bool(tensor.isnan().any()):
        raise ValueError("ignore: holds NaN; expected True where images are not to be used, and False elsewhere")
    ignored = tensor.to(images.device) != 0
    if bool(ignored.all()):
        raise ValueError("ignore: leaves nothing of the images; True is where they are not to be used")
    return ignored


def as_rows(values: Any, n: int, k: int, name: str) -> Tensor:
    """Numbers as float64 rows (n, k) on the CPU, from (k,) for all rows or (n, k).

    Raises
    ------
    ValueError
        If it is not of numbers, or the shape is another.
    """
    try:
        # Torch cannot share memory that runs backwards.
        forwards = np.ascontiguousarray(values) if isinstance(values, np.ndarray) else values
        tensor = torch.as_tensor(forwards, dtype=torch.float64, device="cpu")
    except (TypeError, ValueError, RuntimeError) as error:
        raise ValueError(
            f"{name}: expected {k} numbers, or one row of {k} for each of {n} pairs, got {values!r}"
        ) from error
    if tuple(tensor.shape) not in ((k,), (1, k), (n, k)):
        raise ValueError(f"{name}: expected {k} numbers, or one row of {k} for each of {n} pairs, got {_shape(tensor)}")
    return tensor.expand(n, k)


def _shape(tensor: Tensor) -> str:
    return f"an array of shape {tuple(tensor.shape)}"


def check_circle(circles: Tensor, shape: tuple[int, ...] | torch.Size) -> None:
    """Raise ValueError unless all circles (n, 3) are finite, of one radius of 3 px or more, centred in the image."""
    height, width = shape
    for x, y, radius in circles.tolist():
        if not all(map(math.isfinite, (x, y, radius))):
            raise ValueError(f"circle ({x:g}, {y:g}, {radius:g}): expected three finite numbers x, y, radius in px")
        if radius < 3:
            raise ValueError(f"circle of radius {radius:g} px: the ball must have a radius of 3 px or more")
        if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
            raise ValueError(
                f"circle centred at ({x:g}, {y:g}) lies outside the image of {width} x {height} px (width x height)"
            )
        if 2 * radius > 2 * max(height, width):
            raise ValueError(f"circle of radius {radius:g} px is larger than the image of {width} x {height} px")
    if len(circles) and bool((circles[:, 2] != circles[0, 2]).any()):
        raise ValueError("circle: all pairs of one call must have the same radius")


def check_finite_around(image: Tensor, x: float, y: float, reach: float) -> None:
    """Raise ValueError where a pixel of ``image`` (h, w) within ``reach`` of the circle's centre, px, is no number."""
    left, right, top, bottom = (max(math.floor(v), 0) for v in (x - reach, x + reach, y - reach, y + reach))
    if not bool(image[top : bottom + 1, left : right + 1].isfinite().all()):
        raise ValueError(
            f"the image holds values near the circle at ({x:g}, {y:g}) that are not finite, so that no outline can be "
            "fitted to it: replace them, or track with the circle as given"
        )
