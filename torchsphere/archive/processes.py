"""Own processes on one machine: one that dies is replaced, and costs the recording in flight one more try."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

import torch

from torchsphere.archive.backlog import Backlog
from torchsphere.archive.claims import PAUSE_S
from torchsphere.archive.work import BUSY, DEATHS, Job, Measure, Outcome, give_up, settle
from torchsphere.runtime import signals

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
    process: BaseProcess
    connection: Connection
    job: Job | None = None
    is_ready: bool = False


def run(jobs: Iterator[Job], workers: int, measure: Measure) -> Iterator[Outcome]:
    """Have the jobs done by so many processes; an outcome each, as they end.

    Raises
    ------
    OSError
        Where no worker can be started, or nothing can be written any more.
    """
    backlog, deaths = Backlog(jobs), Counter[str]()
    pool: dict[int, _Worker] = {}
    failed_starts = 0
    try:
        while True:
            for index in range(workers):
                worker = pool.get(index)
                if worker is not None and worker.job is not None:
                    continue
                job = backlog.take()
                if job is None:
                    break
                if worker is None:
                    worker = pool[index] = _start(index, workers, measure)
                _send(worker, job)
            if not any(worker.job for worker in pool.values()) and not backlog.waits:
                return
            for connection in wait([worker.connection for worker in pool.values()], timeout=PAUSE_S):
                index, worker = next((i, w) for i, w in pool.items() if w.connection is connection)
                try:
                    outcome = worker.connection.recv()
                except (EOFError, OSError):
                    del pool[index]
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
        _end(list(pool.values()))


def _send(worker: _Worker, job: Job) -> None:
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


def _start(index: int, workers: int, measure: Measure) -> _Worker:
    here, there = _CONTEXT.Pipe()
    process = _CONTEXT.Process(target=_serve, args=(there, measure, index, workers > 1), daemon=True)
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
    # Held by the worker alone, so that its death ends the connection.
    there.close()
    return _Worker(process, here)


def _end(pool: Sequence[_Worker]) -> None:
    for worker in pool:
        worker.process.terminate()
    for worker in pool:
        worker.process.join(_GRACE_S)
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join()
        worker.connection.close()
        worker.process.close()


def _serve(connection: Connection, measure: Measure, index: int, is_one_of_many: bool) -> None:
    """The worker's process: settle jobs until the connection ends."""
    signals.serve_parent()
    signal.signal(signal.SIGTERM, _leave)
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
