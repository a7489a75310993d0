"""Checks of the user's arrays and numbers; each refusal is one sentence."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchsphere.settings.limits import SettingError


def as_images(images: Any, name: str = "images") -> Tensor:
    """Images (n, h, w) or (h, w) as a tensor (n, h, w); float64 stays, other types become float32."""
    tensor = as_stack(images, name)
    return tensor if tensor.dtype == torch.float64 else tensor.float()


def as_stack(images: Any, name: str = "images") -> Tensor:
    """Images (n, h, w) or (h, w) as a tensor (n, h, w) that shares their memory where torch has their type."""
    _require_unmasked(
        images,
        name,
        "plain grey levels: give its `data`, and as `ignore` (h, w) the pixels that are masked in any image",
    )
    try:
        tensor = images.detach() if isinstance(images, Tensor) else torch.from_numpy(_native(np.asarray(images)))
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"{name}: expected an array (n, h, w) of grey levels, got {_describe(images, name)}"
        ) from error
    hint = _channels(tuple(tensor.shape), name)
    if tensor.is_complex() or tensor.ndim not in (2, 3) or 0 in tensor.shape or hint:
        shape = tuple(tensor.shape)
        raise ValueError(f"{name}: expected real grey levels (n, h, w) or (h, w), got shape {shape}{hint}")
    return tensor if tensor.ndim == 3 else tensor[None]


def _channels(shape: tuple[int, ...], name: str) -> str:
    """A hint on how to get grey levels from an array of this ``shape`` with an axis of channels; empty without one."""
    # No ball is in images three or four pixels wide.
    is_last = len(shape) in (3, 4) and shape[-1] in ((3, 4) if len(shape) == 3 else (1, 3, 4))
    if not is_last and not (len(shape) == 4 and shape[1] in (1, 3, 4)):
        return ""
    axis, part = (-1, "..., ") if is_last else (1, ":, ")
    if shape[axis] == 1:
        return f"; leave the axis of channels out: {name}[{part}0]"
    return f", in colour; give one channel, as in {name}[{part}1], or their mean, {name}[{part}:3].mean({axis})"


def _describe(images: Any, name: str) -> str:
    """The type of an object in place of images, and a hint."""
    if isinstance(images, (str, bytes, Path)):
        opened = f"torchsphere.open_recording({os.fsdecode(images)!r})"
        # A function of pairs takes images, `track` takes the recording itself.
        hint = f"; open the file first: {name} = {opened}{'' if name == 'recording' else '.images(0, 1)'}"
    elif isinstance(images, (list, tuple)) and any(isinstance(each, (str, bytes, Path)) for each in images):
        hint = " with names of files; put these into a folder and open it with torchsphere.open_recording"
    elif isinstance(images, np.ndarray):
        hint = f" of type {images.dtype}"
    elif hasattr(images, "images"):
        hint = "; give the result of its images(start, stop)"
    else:
        hint = ""
    return f"{type(images).__name__}{hint}"


def _require_unmasked(values: Any, name: str, expected: str) -> None:
    """Raise ValueError for masked values of a NumPy array, or of an array in a list, as torch has no masks."""
    parts = values if isinstance(values, (list, tuple)) else [values]
    masked = sum(int(np.ma.getmaskarray(part).sum()) for part in parts if isinstance(part, np.ma.MaskedArray))
    if masked:
        raise ValueError(f"{name}: got a masked array with {masked} of its values masked; expected {expected}")


def _native(array: np.ndarray) -> np.ndarray:
    """The array in a type of torch: float32 for rare types and for foreign byte orders."""
    if array.dtype.kind not in "buif":
        raise ValueError(f"no numbers: {array.dtype}")
    if not array.flags.writeable or min(array.strides, default=0) < 0:
        # Torch cannot share read-only memory or negative strides.
        array = array.copy()
    return array if array.dtype in (np.float64, np.float32, np.uint8, np.uint16) else array.astype(np.float32)


def as_mask(mask: Any, images: Tensor) -> Tensor:
    """Boolean mask (h, w) on the images' device; raises ValueError if no pixel is left."""
    _require_unmasked(mask, "ignore", "True for ignored pixels: give its `mask` alone, or `filled(True)`")
    try:
        tensor = mask.detach() if isinstance(mask, Tensor) else torch.from_numpy(_native(np.asarray(mask)))
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"ignore: expected an array (h, w), True for ignored pixels, got {type(mask).__name__}"
        ) from error
    if tuple(tensor.shape) != tuple(images.shape[-2:]):
        expected = tuple(images.shape[-2:])
        raise ValueError(f"ignore: expected a mask of the image's shape (h, w) = {expected}, got {tuple(tensor.shape)}")
    if bool(tensor.isnan().any()):
        raise ValueError("ignore: holds NaN; expected True for ignored pixels, and False elsewhere")
    ignored = tensor.to(images.device) != 0
    if bool(ignored.all()):
        raise ValueError("ignore: leaves nothing of the images; True means ignored")
    return ignored


def as_rows(values: Any, n: int, k: int, name: str) -> Tensor:
    """Numbers as float64 rows (n, k) on the CPU, from (k,) for all rows or (n, k)."""
    expected = f"{name}: expected {k} numbers, or one row of {k} for each of {n} pairs"
    try:
        # Torch cannot share memory with negative strides.
        forwards = np.ascontiguousarray(values) if isinstance(values, np.ndarray) else values
        tensor = torch.as_tensor(forwards, dtype=torch.float64, device="cpu")
    except (TypeError, ValueError, RuntimeError) as error:
        raise ValueError(f"{expected}, got {values!r}") from error
    if tuple(tensor.shape) not in ((k,), (1, k), (n, k)):
        raise ValueError(f"{expected}, got an array of shape {tuple(tensor.shape)}")
    return tensor.expand(n, k)


def check_circle(circles: Tensor, shape: tuple[int, ...] | torch.Size) -> None:
    """Raise SettingError unless all circles (n, 3) are finite, centred in the image (h, w), of one radius >= 3 px."""
    height, width = shape
    for x, y, radius in circles.tolist():
        given = f"`circle` = {x:g},{y:g},{radius:g}"
        if not all(map(math.isfinite, (x, y, radius))):
            raise SettingError(f"{given}: expected three finite numbers x, y, radius in px")
        if radius < 3:
            raise SettingError(f"{given}: expected a radius of 3 px or more")
        if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
            raise SettingError(f"{given}: its centre lies outside the image of {width} x {height} px (width x height)")
        if 2 * radius > 2 * max(height, width):
            raise SettingError(f"{given}: its radius is larger than the image of {width} x {height} px")
    if len(circles) and bool((circles[:, 2] != circles[0, 2]).any()):
        raise SettingError("`circle`: all pairs of one call must have the same radius")


def check_finite_around(image: Tensor, x: float, y: float, reach: float) -> None:
    """Raise ValueError unless all pixels of ``image`` (h, w) within ``reach`` (px) of the centre are finite."""
    left, right, top, bottom = (max(math.floor(v), 0) for v in (x - reach, x + reach, y - reach, y + reach))
    if not bool(image[top : bottom + 1, left : right + 1].isfinite().all()):
        raise ValueError(
            f"the image holds values near the circle at ({x:g}, {y:g}) that are not finite, so that no outline can be "
            "fitted: replace the values, or track with the circle as given"
        )
