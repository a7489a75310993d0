"""Images of a recording, an array or a tensor, as tensors on the device."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.recording import Recording
from torchsphere.recording.level_scale import LevelScale
from torchsphere.recording.square_pixels import stretch
from torchsphere.settings.arrays import as_stack
from torchsphere.settings.choices import DEVICES
from torchsphere.settings.limits import SettingError

#: Limit of the memory for images that are read ahead or kept for a second use, bytes (docs/constants.toml).
CACHE_BYTES = 2**27

#: Number of images that are read at once into a buffer (docs/constants.toml).
CHUNK = 4


@dataclass(frozen=True)
class Source:
    """Images that are read on request."""

    read: Callable[..., Any]  # read(start, stop) -> grey levels (stop - start, h, w); files also take `out`
    count: int
    device: torch.device
    dtype: torch.dtype
    is_file: bool = False
    times: NDArray[np.float64] | None = None  # of the images, in frame intervals; None where they are evenly spaced
    stretch: float = 1.0  # longer over shorter side of the pixels that the images were drawn from
    rounding_variance: float = LevelScale().rounding_variance  # that the steps of the levels leave

    @classmethod
    def open(
        cls, recording: Any, device: str | torch.device | None = None, dtype: torch.dtype = torch.float32
    ) -> Source:
        """Wrap a `Recording` or an array (n, h, w); raises ValueError for an invalid device, dtype or array."""
        if dtype not in (torch.float32, torch.float64):
            raise ValueError(f"dtype {dtype}: expected torch.float32 or torch.float64")
        try:
            device = None if device is None else torch.device(device)
        except RuntimeError as error:
            raise SettingError(f"`device` = {device}: torch knows no such device; give cpu or cuda") from error
        if isinstance(recording, Recording):
            longer = stretch(recording.pixel_aspect)
            source = cls(
                *(recording.images, len(recording), device or torch.device("cpu"), dtype, True),
                *(recording.times, longer),
            )
        else:
            images = as_stack(recording, "recording")
            source = cls(lambda start, stop: images[start:stop], len(images), device or images.device, dtype)
        require_device(source.device)
        if source.count < 2:
            raise ValueError(
                f"the recording has {source.count} image(s), and motion needs two or more: give the whole recording"
            )
        return source

    def elapsed(self, first: int, last: int) -> float:
        """Time from one image to another, in frame intervals."""
        return float(last - first) if self.times is None else float(self.times[last] - self.times[first])

    def durations(self, start: int, stop: int) -> NDArray[np.float64]:
        """Times (stop - start - 1,) between successive images from ``start`` to ``stop - 1``, in frame intervals."""
        return np.ones(stop - start - 1) if self.times is None else np.diff(self.times[start:stop])

    def steps_around(self, position: NDArray[np.float64], frames: NDArray[np.int64]) -> NDArray[np.float64]:
        """Mean steps (m, 2) to and from the ``frames`` of a path (n, 2), per interval; 0 where none is known."""
        steps = np.diff(position, axis=0) / self.durations(0, self.count)[:, None]
        steps = np.pad(steps, ((1, 1), (0, 0)), constant_values=np.nan)
        around = np.stack((steps[frames], steps[frames + 1]))
        known = np.isfinite(around)
        found: NDArray[np.float64] = np.where(known, around, 0.0).sum(0) / known.sum(0).clip(1)
        return found

    def images(self, start: int, stop: int) -> Tensor:
        """Grey levels (stop - start, h, w)."""
        return torch.as_tensor(self.read(start, stop)).to(self.device, self.dtype)

    def images_of(self, frames: NDArray[np.int64]) -> Tensor:
        """Grey levels (m, h, w) of the ``frames`` (m,)."""
        return torch.cat([self.images(frame, frame + 1) for frame in frames.tolist()])

    def standardised(self) -> Source:
        """The same images on the scale of `LevelScale`, which neither gain nor offset of the recording changes."""
        scale = LevelScale.of(self.read, self.count)

        def read(start: int, stop: int, out: NDArray[Any] | None = None) -> Tensor:
            if out is None:
                return scale.standard(torch.as_tensor(self.read(start, stop)).to(self.device), self.dtype)
            self.read(start, stop, out=out)
            return scale.standard_in_place(torch.from_numpy(out))

        return replace(self, read=read, rounding_variance=scale.rounding_variance)

    @property
    def fills_buffers(self) -> bool:
        """Whether `images_into` works: the images come from a file, for a CPU, in float32."""
        return self.is_file and self.device.type == "cpu" and self.dtype == torch.float32

    def images_into(self, buffer: Tensor, start: int, stop: int) -> Tensor:
        """Read images into the first rows of ``buffer`` (m, h, w), which saves the system clearing new memory."""
        for a in range(start, stop, CHUNK):
            b = min(a + CHUNK, stop)
            self.read(a, b, out=buffer[a - start : b - start].numpy())
        return buffer[: stop - start]

    def changed(self, change: Callable[[Tensor], Tensor]) -> Source:
        """The images (m, h, w) after a ``change``, which must not write to them."""
        return replace(self, read=lambda start, stop: change(self.images(start, stop)), is_file=False)

    def cached(self, start: int, stop: int) -> Source:
        """The same images, of which ``start`` to ``stop - 1`` are read once; unchanged where they are too large.

        The images are views of the cache, and the caller must not write to them.
        """
        first = self.images(start, start + 1)
        if (stop - start) * first.nbytes > CACHE_BYTES:
            return self
        cache = first.new_empty(stop - start, *first.shape[1:])
        is_read = [False] * (stop - start)
        lock = threading.Lock()

        def read(first: int, last: int) -> Tensor:
            if not start <= first < last <= stop:
                return self.images(first, last)
            a, b = first - start, last - start
            with lock:
                while not all(is_read[a:b]):
                    gap = is_read.index(False, a, b)
                    end = next((i for i in range(gap, b) if is_read[i]), b)
                    cache[gap:end] = self.images(start + gap, start + end)
                    is_read[gap:end] = [True] * (end - gap)
            return cache[a:b]

        return replace(self, read=read, is_file=False)


def require_device(chosen: torch.device) -> None:
    """Raise SettingError unless the device is supported and present."""
    if chosen.type not in DEVICES:
        raise SettingError(f"`device` = {chosen}: expected one of {', '.join(DEVICES)}")
    if chosen.type == "cuda" and not torch.cuda.is_available():
        raise SettingError(
            f"`device` = {chosen} was asked for, but torch finds no CUDA device here; leave it out to use the CPU"
        )
    if chosen.type == "cuda" and (chosen.index or 0) >= torch.cuda.device_count():
        count = torch.cuda.device_count()
        raise SettingError(f"`device` = {chosen}: torch finds {count} CUDA device(s) here, counted from cuda:0")
