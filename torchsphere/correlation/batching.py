"""Pairs of several recordings correlated in one batch: a GPU has hardly begun when a short recording's batch ends.

Each recording is followed by a thread of its own. While one batch is on the device, the pairs that the other threads
come with gather, and the next batch holds all of them: it is as large as the device is slow, and nobody waits for a
recording that is busy elsewhere.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchsphere.correlation.gauss_newton import Approach
from torchsphere.correlation.options import Options
from torchsphere.correlation.pairs import Pairs
from torchsphere.correlation.result import Correlation
from torchsphere.correlation.solve import approach, solve

#: Calls that go into one batch at most: 64 of 32 pairs each take some 3 GB at R = 50 px.
MOST = 64


@dataclass(frozen=True)
class Solver:
    """What measures the pairs of a recording.

    Attributes
    ----------
    approach, solve : callable
        As `torchsphere.correlation.solve.approach` and `torchsphere.correlation.solve.solve`.
    """

    approach: Callable[[Pairs, Tensor, Options], Approach] = approach
    solve: Callable[[Pairs, Tensor, Options, Tensor | None], Correlation] = solve


#: For a recording by itself.
ALONE = Solver()


def together() -> Solver:
    """A solver for threads that each follow a recording: it puts their pairs into common batches."""
    meeting = Meeting()

    def approached(pairs: Pairs, start: Tensor, options: Options) -> Approach:
        def of_all(calls: Sequence[tuple[Pairs, Tensor]]) -> list[Approach]:
            both, starts = _joined(calls)
            return approach(both, starts, options).split([len(call[1]) for call in calls])

        near: Approach = meeting.call(("approach", *_kind(pairs, start, options)), of_all, (pairs, start))
        return near

    def solved(pairs: Pairs, near: Tensor, options: Options, start: Tensor | None = None) -> Correlation:
        def of_all(calls: Sequence[tuple[Pairs, Tensor, Tensor]]) -> list[Correlation]:
            both, nears, starts = _joined(calls)
            return solve(both, nears, options, starts).split([len(call[1]) for call in calls])

        call = (pairs, near, near if start is None else start)
        found: Correlation = meeting.call(("solve", *_kind(pairs, near, options)), of_all, call)
        return found

    return Solver(approached, solved)


def _kind(pairs: Pairs, unknowns: Tensor, options: Options) -> tuple[Hashable, ...]:
    """What pairs must have in common to be solved in one batch; a camera's view belongs to its recording."""
    masked = pairs.f.crops.usable is not None, pairs.g.crops.usable is not None
    return (options, pairs.g.c.shape[-1], unknowns.shape[-1], unknowns.dtype, unknowns.device, *masked)


def _joined(calls: Sequence[tuple[Any, ...]]) -> tuple[Any, ...]:
    """Arguments of several calls as those of one: the pairs, and tensors (n, k)."""
    pairs, *tensors = zip(*calls, strict=True)
    return Pairs.joined(pairs), *(torch.cat(parts) for parts in tensors)


class _Call:
    """An argument that waits for its result."""

    def __init__(self, argument: Any) -> None:
        self.argument = argument
        self.result: Any = None
        self.error: BaseException | None = None
        self.is_over = False


class Meeting:
    """Calls of several threads, of which those of one kind are made as one."""

    def __init__(self) -> None:
        self._gathered: dict[Hashable, list[_Call]] = {}
        self._gathering, self._device = threading.Lock(), threading.Lock()

    def call(self, kind: Hashable, of_all: Callable[[Sequence[Any]], Sequence[Any]], argument: Any) -> Any:
        """The result for ``argument`` of ``of_all``, which takes several arguments of one ``kind`` at once.

        An error is raised in every thread whose argument was among them.
        """
        own = _Call(argument)
        with self._gathering:
            self._gathered.setdefault(kind, []).append(own)
        with self._device:
            if not own.is_over:
                self._make(self._taken(kind, own), of_all)
        if own.error is not None:
            raise own.error
        return own.result

    def _taken(self, kind: Hashable, own: _Call) -> list[_Call]:
        """Calls of the kind to be made now: the own one, and as many others as fit."""
        with self._gathering:
            waiting = self._gathered.pop(kind)
            waiting.remove(own)
            if waiting[MOST - 1 :]:
                self._gathered[kind] = waiting[MOST - 1 :]
        return [own, *waiting[: MOST - 1]]

    @staticmethod
    def _make(calls: list[_Call], of_all: Callable[[Sequence[Any]], Sequence[Any]]) -> None:
        try:
            for call, result in zip(calls, of_all([call.argument for call in calls]), strict=True):
                call.result = result
        except BaseException as error:
            for call in calls:
                call.error = error
        for call in calls:
            call.is_over = True
