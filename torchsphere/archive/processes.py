"""Own processes on one machine: one that dies is replaced, and costs the recordings in flight one more try.

A process has one or more lanes, a thread and a recording in flight each. Where it dies with several in flight, nobody
knows of which: each of them is tried again with nothing beside it.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

import torch

from torchsphere.archive.backlog import PAUSE_S, Backlog
from torchsphere.archive.work import BUSY, DEATHS, Job, Measure, Outcome, give_up, settle

#: A child of its own start, not a copy of this process: torch's threads and CUDA do not survive a fork.
_CONTEXT = multiprocessing.get_context("spawn")
#: Starts in a row that may fail before it is taken that no worker can start here.
_STARTS = 3
#: What libraries read when they are loaded; processes whose threads compete for cores slow each other down.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
#: Time to clean up in when the run is interrupted, s.
_GRACE_S = 5.0


@dataclass
class _Worker:
    """A lane of the process number ``index``."""

    index: int
    process: BaseProcess
    connection: Connection
    job: Job | None = None
    is_ready: bool = False


def run(jobs: Iterator[Job], workers: int, measure: Measure, lanes: int = 1) -> Iterator[Outcome]:
    """Have the jobs done by ``workers`` processes of so many ``lanes`` each; an outcome each, as they end.

    Raises
    ------
    OSError
        Where no worker can be started, or nothing can be written any more.
    """
    backlog, deaths = Backlog(jobs), Counter[str]()
    pool: list[_Worker] = []
    failed_starts = 0
    try:
        while True:
            for index in range(workers):
                _give_out(index, pool, backlog, deaths, lambda index: _start(index, workers, measure, lanes))
            if not any(worker.job for worker in pool) and not backlog.waits:
                return
            for connection in wait([worker.connection for worker in pool], timeout=PAUSE_S):
                worker = next(w for w in pool if w.connection is connection)
                try:
                    outcome = worker.connection.recv()
                except (EOFError, OSError):
                    pool.remove(worker)
                    failed_starts = 0 if worker.is_ready else failed_starts + 1
                    yield from _after_death(worker, backlog, deaths, failed_starts)
                    continue
                if outcome is None:
                    worker.is_ready = True
                    continue
                job, worker.job = worker.job, None
                if outcome.state == BUSY and job is not None:
                    backlog.later(job)
                else:
                    yield outcome
    finally:
        _end(pool)


def _give_out(
    index: int, pool: list[_Worker], backlog: Backlog, deaths: Counter[str], start: Callable[[int], list[_Worker]]
) -> None:
    """A job for every idle lane of a process; it is started only where there is a job for it."""
    while True:
        lanes = [worker for worker in pool if worker.index == index]
        busy = [worker.job.item.result for worker in lanes if worker.job is not None]
        # What was in flight when a process died is tried alone: otherwise its neighbours would be blamed with it.
        if (lanes and len(busy) == len(lanes)) or any(deaths[result] for result in busy):
            return
        job = backlog.take()
        if job is None:
            return
        if busy and deaths[job.item.result]:
            backlog.again(job)
            return
        if not lanes:
            lanes = start(index)
            pool += lanes
        worker = next(worker for worker in lanes if worker.job is None)
        worker.job = job
        # A worker that died in this moment is noticed when its answer is read.
        with contextlib.suppress(OSError):
            worker.connection.send(job)


def _after_death(worker: _Worker, backlog: Backlog, deaths: Counter[str], failed_starts: int) -> Iterator[Outcome]:
    worker.process.join()
    worker.connection.close()
    how, job = _how(worker.process.exitcode), worker.job
    if failed_starts >= _STARTS:
        raise OSError(f"worker processes end as they start ({how}); try 'torchsphere track' on one recording")
    if job is None:
        return
    result = job.item.result
    deaths[result] += worker.is_ready
    if deaths[result] < DEATHS:
        backlog.again(job)
        return
    outcome = give_up(job, f"the worker process died ({how}), and so did a fresh one")
    if outcome.state == BUSY:
        backlog.later(job)
    else:
        yield outcome


def _how(exit_code: int | None) -> str:
    if exit_code is not None and exit_code < 0:
        with contextlib.suppress(ValueError):
            return f"signal {-exit_code}, {signal.Signals(-exit_code).name}"
    return f"exit code {exit_code}"


def _start(index: int, workers: int, measure: Measure, lanes: int) -> list[_Worker]:
    pipes = [_CONTEXT.Pipe() for _ in range(lanes)]
    there = [pipe[1] for pipe in pipes]
    process = _CONTEXT.Process(target=_serve, args=(there, measure, index, workers * lanes > 1), daemon=True)
    before = {name: os.environ.get(name) for name in _THREADS}
    try:
        if workers > 1:
            os.environ.update(dict.fromkeys(_THREADS, "1"))
        process.start()
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
    # Held by the worker alone, so that its death ends the connections.
    for connection in there:
        connection.close()
    return [_Worker(index, process, here) for here, _ in pipes]


def _end(pool: list[_Worker]) -> None:
    processes = list({worker.process.pid: worker.process for worker in pool}.values())
    for process in processes:
        process.terminate()
    for process in processes:
        process.join(_GRACE_S)
        if process.is_alive():
            process.kill()
            process.join()
    for worker in pool:
        worker.connection.close()
    for process in processes:
        process.close()


def _serve(connections: Sequence[Connection], measure: Measure, index: int, is_one_of_many: bool) -> None:
    """The worker's process: settle jobs, in a thread per connection, until the connections end."""
    # Ctrl-C reaches all processes of a terminal; the first of them ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)
    threading.Thread(target=_die_with_parent, daemon=True).start()
    others = [
        threading.Thread(target=_settle_all, args=(other, measure, index, is_one_of_many), daemon=True)
        for other in connections[1:]
    ]
    for other in others:
        other.start()
    _settle_all(connections[0], measure, index, is_one_of_many)
    for other in others:
        other.join()


def _settle_all(connection: Connection, measure: Measure, index: int, is_one_of_many: bool) -> None:
    """Settle jobs until the connection ends."""
    if is_one_of_many:
        torch.set_num_threads(1)
    with contextlib.suppress(EOFError, OSError):
        connection.send(None)
        while True:
            job = connection.recv()
            connection.send(settle(job, measure, index))


def _leave(*_: Any) -> None:
    # As an exception, so that the unfinished folder is removed.
    sys.exit(0)


def _die_with_parent() -> None:
    """End at once when the parent has ended, however it did: nobody waits for the result any more."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
