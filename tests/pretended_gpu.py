"""Tensors that pretend to be on a GPU: computed on the CPU, they are refused where a GPU would refuse them.

Fake tensors have no values, so that code that waits for a number of the device cannot run on them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode

CUDA, CPU = torch.device("cuda"), torch.device("cpu")

_MARK = "pretends_to_be_on_a_gpu"


def on_gpu(tensor: Tensor) -> bool:
    """Whether the tensor pretends to be on a GPU."""
    return hasattr(tensor, _MARK)


def tensors_of(thing: Any) -> Iterator[Tensor]:
    """All tensors in nested tuples, lists and dictionaries."""
    if isinstance(thing, Tensor):
        yield thing
    elif isinstance(thing, tuple | list):
        for part in thing:
            yield from tensors_of(part)
    elif isinstance(thing, dict):
        yield from tensors_of(list(thing.values()))


def _is_cuda(wanted: Any) -> bool:
    return isinstance(wanted, torch.device | str) and torch.device(wanted).type == "cuda"


class PretendedGpu(TorchFunctionMode):
    """Within this context, ``device="cuda"`` and ``.to("cuda")`` make tensors that pretend to be on a GPU.

    A mix of devices and ``.numpy()`` of such a tensor raise RuntimeError, as on a GPU. As there, numbers without axes
    may come from the CPU, and so may the numbers of the rows that are taken.
    """

    def __torch_function__(  # type: ignore[no-untyped-def]
        self, function, types, args=(), kwargs=None
    ) -> Any:
        kwargs = dict(kwargs or {})
        name = getattr(function, "__name__", "")
        first = args[0] if args and isinstance(args[0], Tensor) else None
        if name == "__get__":
            return self._attribute(function, args, kwargs)
        if name in ("numpy", "data_ptr", "__array__") and first is not None and on_gpu(first):
            raise RuntimeError("can't convert cuda tensor to numpy")
        if name in ("to", "cpu", "cuda") and first is not None:
            return self._moved(function, name, first, args[1:], kwargs)
        wanted = kwargs.get("device")
        if wanted is not None:
            kwargs["device"] = CPU
        result = function(*args, **kwargs)
        located = [*tensors_of(args), *tensors_of(kwargs)]
        if name in ("__getitem__", "__setitem__") and first is not None:
            numbers = list(tensors_of(args[1]))
            if not on_gpu(first) and any(on_gpu(tensor) for tensor in numbers):
                raise RuntimeError("indices should be either on cpu or on the same device as the indexed tensor")
            located = [first, *tensors_of(args[2:])]
        marked = _is_cuda(wanted) if wanted is not None else self._place(name, located)
        for tensor in tensors_of(result):
            if marked and name not in ("tolist", "item"):
                setattr(tensor, _MARK, True)
        return result

    def _attribute(self, function: Any, args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
        owner, of = args[0], getattr(function, "__self__", None)
        result, name = function(*args, **kwargs), getattr(of, "__name__", "")
        if not on_gpu(owner):
            return result
        if isinstance(result, torch.device):
            return CUDA
        if name in ("is_cpu", "is_cuda"):
            return name == "is_cuda"
        for tensor in tensors_of(result):
            setattr(tensor, _MARK, True)
        return result

    def _moved(self, function: Any, name: str, tensor: Tensor, args: tuple[Any, ...], kwargs: dict[str, Any]) -> Tensor:
        there = on_gpu(tensor)
        if name != "to":
            there, args, kwargs = name == "cuda", (), {}
        for wanted in (*args, *kwargs.values()):
            if isinstance(wanted, Tensor):
                there = on_gpu(wanted)
            elif isinstance(wanted, torch.device | str):
                there = _is_cuda(wanted)
        rest = [CPU if isinstance(a, torch.device | str) else a for a in args if a is not None or name != "to"]
        named = {key: CPU if key == "device" else value for key, value in kwargs.items()}
        moved: Tensor = tensor.to(*rest, **named) if rest or named else tensor
        if there == on_gpu(tensor) and moved is tensor:
            return tensor
        moved = moved.detach().clone() if moved is tensor else moved
        if there:
            setattr(moved, _MARK, True)
        return moved

    def _place(self, name: str, tensors: list[Tensor]) -> bool:
        """Whether a result of these ``tensors`` is on the GPU; raises if they are on different devices."""
        marked = [on_gpu(tensor) for tensor in tensors]
        if not any(marked):
            return False
        allowed = [there or tensor.ndim == 0 for there, tensor in zip(marked, tensors, strict=True)]
        whole = any(there and tensor.ndim > 0 for there, tensor in zip(marked, tensors, strict=True))
        if not all(allowed) or (not whole and not all(marked) and any(t.ndim for t in tensors)):
            raise RuntimeError(f"{name}: expected all tensors to be on the same device")
        return True
