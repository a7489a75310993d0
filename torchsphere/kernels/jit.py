"""Compilation of the loops, once for each machine and kept on disk, and the choice between loop and torch."""

from __future__ import annotations

import contextlib
import functools
import logging
import multiprocessing
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
import numba.extending
import numpy as np
import torch
from numba.core.compiler import Compiler
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.runtime import steps

Floats = NDArray[np.float32]
Doubles = NDArray[np.float64]
Integers = NDArray[np.int64]

_LOG = logging.getLogger(__name__)

P = ParamSpec("P")
R = TypeVar("R")

ZERO, ONE, TWO = (np.float32(value) for value in (0, 1, 2))

#: Sums in any order, which vectorises them. NaN and infinities stay exact: they must be seen, and never make an index.
FAST_MATH = {"reassoc", "contract", "arcp", "nsz"}


def suits(*tensors: Tensor, dtype: torch.dtype = torch.float32) -> bool:
    """Whether a loop can take these tensors: on the CPU, of one type, and without derivatives."""
    for tensor in tensors:  # noqa: SIM110  (all() takes three times as long, 40 times in a batch)
        if not tensor.is_cpu or tensor.dtype != dtype or tensor.requires_grad:
            return False
    return True


def in_loops(loops: Callable[..., R], dtype: torch.dtype = torch.float32) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator: where `suits` allows, ``loops`` takes the place of the torch function; tensors are positional."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(function)
        def choose(*args: P.args, **kwargs: P.kwargs) -> R:
            tensors = [t for t in args if isinstance(t, Tensor) and t.is_floating_point()]
            return (loops if suits(*tensors, dtype=dtype) else function)(*args, **kwargs)

        return choose

    return decorate


def in_code(write: Callable[..., Any]) -> Any:
    """Decorator: a function for loops that ``write`` gives in the compiler's intermediate code."""
    return numba.extending.intrinsic(write)


class _NoAliasCompiler(Compiler):
    """Promise that array arguments never overlap: without it, loops with look-ups are three times slower."""

    def define_pipelines(self) -> Any:
        self.state.flags.noalias = True
        return super().define_pipelines()  # type: ignore[no-untyped-call]


def compiled(function: Callable[..., Any]) -> Any:
    """Compile the function on its first call, without Python's lock; its arrays must not overlap.

    Hot loops use whole rows, ``values[n, 0]`` and not ``x, y = values[n]``, which may not be contiguous, and unsigned
    indices: a signed index is checked for counting from the end.
    """
    options: dict[str, Any] = {
        "nogil": True,
        # A called function that was not inlined had its sums in another order in the process that compiled it.
        "forceinline": True,
        "fastmath": FAST_MATH,
        "error_model": "numpy",
        "pipeline_class": _NoAliasCompiler,
    }
    try:
        dispatcher = numba.njit(cache=True, **options)(function)
    except RuntimeError:
        _tell_not_kept("neither the folder of the package nor that of the user can be written")
        return numba.njit(**options)(function)
    # A loop holds the functions of other files that it calls, and numba looks at the loop's own file alone: after an
    # update of another file an old loop would give wrong numbers.
    dispatcher._cache._cache_file._source_stamp = sources_stamp()
    _forgive_disk(dispatcher._cache)
    return dispatcher


def _forgive_disk(cache: Any) -> None:
    """Let a disk that is full, and files that a crash left half-written, cost time and not the measurement."""
    load, save = cache.load_overload, cache.save_overload

    def load_or_none(*arguments: Any) -> Any:
        try:
            found = load(*arguments)
        except Exception:
            found = None
            with contextlib.suppress(OSError):
                cache.flush()
        if found is None:
            _tell_compilation()
        return found

    def save_or_tell(*arguments: Any) -> None:
        try:
            save(*arguments)
        except OSError as error:
            _tell_not_kept(f"{cache.cache_path}: {(error.strerror or str(error)).lower()}")

    cache.load_overload, cache.save_overload = load_or_none, save_or_tell


@functools.cache
def _tell_compilation() -> None:
    """Say once in a process that loops are compiled, which no kept loop needs."""
    steps.tell("compiling the loops over pixels, once for this machine and version (%s)", steps.COMPILATION_TIME)


#: Why compiled loops cannot be kept on disk, once known.
_NOT_KEPT: list[str] = []


def _tell_not_kept(why: str) -> None:
    """Say once, and not in each worker, that compiled loops cannot be kept."""
    if not _NOT_KEPT and multiprocessing.parent_process() is None:
        _LOG.warning(
            "compiled loops cannot be kept (%s); each process compiles them again, which takes %s: name a folder that "
            "can be written in NUMBA_CACHE_DIR",
            why,
            steps.COMPILATION_TIME,
        )
    _NOT_KEPT.append(why)


def are_kept() -> bool:
    """Whether all loops that were compiled so far are kept on disk."""
    return not _NOT_KEPT


@functools.cache
def sources_stamp() -> tuple[tuple[str, float, int], ...]:
    """Name, time of the last change and size of each file with loops: a cache with another stamp is not used."""
    found = ((path.name, path.stat()) for path in sorted(Path(__file__).parent.glob("*.py")))
    return tuple((name, stat.st_mtime, stat.st_size) for name, stat in found)


def arrays(*tensors: Tensor) -> tuple[Any, ...]:
    """Tensors as contiguous NumPy arrays, for which alone the functions are compiled."""
    return tuple(tensor.contiguous().numpy() for tensor in tensors)


def require_one_size(axis: int, *tensors: Tensor) -> None:
    """Raise ValueError unless the tensors have one size along the axis: loops do not check array bounds."""
    sizes = {tensor.shape[axis] for tensor in tensors}
    if len(sizes) > 1:
        shapes = ", ".join(str(tuple(tensor.shape)) for tensor in tensors)
        raise ValueError(f"expected arrays of one size along axis {axis}, got shapes {shapes}")


def require_same_points(*tensors: Tensor) -> None:
    """Raise ValueError unless all tensors have as many pairs and as many points."""
    require_one_size(0, *tensors)
    require_one_size(-1, *tensors)


def require_nodes(images: Tensor, nodes: int) -> None:
    """Raise ValueError unless ``images`` (n, h, w) have so many nodes on either axis."""
    if min(images.shape[-2:]) < nodes:
        raise ValueError(f"expected images of {nodes} px or more on either side, got shape {tuple(images.shape)}")
