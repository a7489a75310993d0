"""Images as tensors on the device, whatever they come from: a recording, an array, a tensor."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchsphere.recording import Recording
from torchsphere.settings.arrays import as_images
from torchsphere.settings.choices import DEVICES

#: Images that are wanted several times are kept, and those that may be wanted next are looked at, up to this many bytes
#: in all: 65 of 1024 x 480 px.
KEPT_BYTES = 2**27

#: Images that are read at once into memory that there is already.
CHUNK = 4


@dataclass(frozen=True)
class Source:
    """Images that are read when they are asked for.

    Attributes
    ----------
    read : callable
        ``read(start, stop)`` -> grey levels (stop - start, h, w), NumPy or torch; that of a file takes ``out`` as well,
        as `Recording.images` does.
    count : int
        Number of images.
    device, dtype
        Where and in which precision they are handed out.
    is_file : bool
        They come from a file, and so in memory of their own.
    """

    read: Callable[..., Any]
    count: int
    device: torch.device
    dtype: torch.dtype
    is_file: bool = False

    @classmethod
    def open(
        cls, recording: Any, device: str | torch.device | None = None, dtype: torch.dtype = torch.float32
    ) -> Source:
        """Wrap a `Recording`, which is read lazily, or an array (n, h, w); ValueError if no motion can come of it."""
        if dtype not in (torch.float32, torch.float64):
            raise ValueError(f"dtype {dtype}: expected torch.float32 or torch.float64")
        try:
            device = None if device is None else torch.device(device)
        except RuntimeError as error:
            raise ValueError(f"device {device!r}: torch knows no such device; use 'cpu' or 'cuda'") from error
        if isinstance(recording, Recording):
            chosen = torch.device(device or "cpu")
            source = cls(recording.images, len(recording), chosen, dtype, is_file=True)
        else:
            images = as_images(recording, "recording")
            chosen = torch.device(device) if device is not None else images.device
            source = cls(lambda start, stop: images[start:stop], len(images), chosen, dtype)
        _require_device(chosen)
        if source.count < 2:
            raise ValueError(f"the recording has {source.count} image(s); motion needs two or more")
        return source

    def images(self, start: int, stop: int) -> Tensor:
        """Grey levels (stop - start, h, w)."""
        return torch.as_tensor(self.read(start, stop)).to(self.device, self.dtype)

    @property
    def fills_rooms(self) -> bool:
        """Whether `images_in` can be used: images in memory, and those for a GPU, are handed out without."""
        return self.is_file and self.device.type == "cpu" and self.dtype == torch.float32

    def images_in(self, room: Tensor, start: int, stop: int) -> Tensor:
        """`images` of a file in memory that was taken before: the first of ``room`` (m, h, w), what it held is lost.

        Memory that is taken and given back with each batch, 21 MB for 33 images of 512 x 256 px, is cleared by the
        system each time: measured in a thread, 7 ms a batch, half as long as it takes to measure.
        """
        for a in range(start, stop, CHUNK):
            b = min(a + CHUNK, stop)
            self.read(a, b, out=room[a - start : b - start].numpy())
        return room[: stop - start]

    def keeping(self, start: int, stop: int) -> Source:
        """The same images, of which ``start`` to ``stop - 1`` are read once; as it is where they are too large to keep.

        They are handed out as views, which nobody may write to.
        """
        first = self.images(start, start + 1)
        if (stop - start) * first.nbytes > KEPT_BYTES:
            return self
        kept = first.new_empty(stop - start, *first.shape[1:])
        known = [False] * (stop - start)
        reading = threading.Lock()

        def read(first: int, last: int) -> Tensor:
            if not start <= first < last <= stop:
                return self.images(first, last)
            a, b = first - start, last - start
            with reading:
                while not all(known[a:b]):
                    lacking = known.index(False, a, b)
                    end = next((i for i in range(lacking, b) if known[i]), b)
                    kept[lacking:end] = self.images(start + lacking, start + end)
                    known[lacking:end] = [True] * (end - lacking)
            return kept[a:b]

        return Source(read, self.count, self.device, self.dtype)


def _require_device(chosen: torch.device) -> None:
    """Raise ValueError unless that device is here, and one that the code runs on."""
    if chosen.type not in DEVICES:
        raise ValueError(f"device {str(chosen)!r}: expected one of {', '.join(DEVICES)}; all else is not supported")
    if chosen.type == "cuda" and not torch.cuda.is_available():
        raise ValueError("device 'cuda' was asked for, but torch finds no CUDA device here; use device 'cpu'")
    if chosen.type == "cuda" and (chosen.index or 0) >= torch.cuda.device_count():
        count = torch.cuda.device_count()
        raise ValueError(f"device {str(chosen)!r}: torch finds {count} CUDA device(s) here, counted from cuda:0")
