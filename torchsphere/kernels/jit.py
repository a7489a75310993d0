"""How a function is compiled: once for each machine, and kept on disk."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba.core.compiler import Compiler
from torch import Tensor

#: Sums may be taken in any order, which is what lets several points be done at once. NaN and infinities stay what they
#: are, unlike with all of Numba's shortcuts: values that are no numbers must be told, and never make an index.
_MATHEMATICS = {"reassoc", "contract", "arcp", "nsz"}


class _Apart(Compiler):
    """Arrays that a function is given never overlap.

    Without that promise a loop that looks values up and writes others is done point by point: three times as slow.
    """

    def define_pipelines(self) -> Any:
        self.state.flags.noalias = True
        return super().define_pipelines()  # type: ignore[no-untyped-call]


def compiled(function: Callable[..., Any]) -> Any:
    """The function, compiled on its first call, free of Python's lock; its arrays must not overlap.

    Hot loops go over whole rows, ``values[n, 0]`` and not one of ``x, y = values[n]``, whose places in memory are no
    longer known to be neighbours; indices of look-ups have no sign, or each is checked for counting from the end.
    """
    options: dict[str, Any] = {
        "nogil": True,
        # A function that was called, and not put in place of its call, was another one in the process that compiled it
        # than in those that load it, with sums in another order: the first run's last digits were its own.
        "forceinline": True,
        "fastmath": _MATHEMATICS,
        "error_model": "numpy",
        "pipeline_class": _Apart,
    }
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:
        # Neither beside the module nor in the user's own cache can anything be written: each process compiles anew.
        return numba.njit(**options)(function)


def arrays(*tensors: Tensor) -> tuple[Any, ...]:
    """Tensors as NumPy arrays whose values lie together: a function is compiled for such alone."""
    return tuple(tensor.contiguous().numpy() for tensor in tensors)


def require_one_size(axis: int, *tensors: Tensor) -> None:
    """Raise ValueError unless all tensors are as long along that axis: no loop looks where an array ends."""
    sizes = {tensor.shape[axis] for tensor in tensors}
    if len(sizes) > 1:
        shapes = ", ".join(str(tuple(tensor.shape)) for tensor in tensors)
        raise ValueError(f"expected arrays of one size along axis {axis}, got shapes {shapes}")


def require_room(images: Tensor, nodes: int) -> None:
    """Raise ValueError unless ``images`` (n, h, w) have so many nodes on either axis."""
    if min(images.shape[-2:]) < nodes:
        raise ValueError(f"expected images of {nodes} px or more on either side, got shape {tuple(images.shape)}")
