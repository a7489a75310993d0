"""Worker processes on this machine; a dead worker is replaced, and its recording is tried once more."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

import torch

from torchsphere.archive.backlog import Backlog
from torchsphere.archive.claims import PAUSE_S
from torchsphere.archive.work import BUSY, MAX_DEATHS, Job, Measure, Outcome, fail_job, run_job
from torchsphere.runtime import signals

#: Workers are spawned, as the threads of torch, and CUDA, do not survive a fork.
_CONTEXT = multiprocessing.get_context("spawn")
#: Failed starts in a row after which the run ends (docs/constants.toml).
_MAX_FAILED_STARTS = 3
#: Numbers of threads that libraries read when loaded; processes with many threads slow each other down.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
#: Time for workers to clean up when the run is interrupted, s (docs/constants.toml).
_GRACE_S = 5.0


@dataclass
class _Worker:
    process: BaseProcess
    connection: Connection
    job: Job | None = None
    is_ready: bool = False


def run(jobs: Iterator[Job], workers: int, measure: Measure) -> Iterator[Outcome]:
    """Measure the jobs in ``workers`` processes, and yield their outcomes; raises OSError if no worker can start."""
    backlog, deaths = Backlog(jobs), Counter[str]()
    pool: dict[int, _Worker] = {}
    failed_starts = 0
    try:
        while True:
            _give_out(backlog, pool, workers, measure)
            if not any(worker.job for worker in pool.values()) and not backlog.is_waiting:
                return
            indices: dict[Any, int] = {worker.connection: index for index, worker in pool.items()}
            for connection in wait(list(indices), timeout=PAUSE_S):
                worker = pool[indices[connection]]
                try:
                    outcome = worker.connection.recv()
                except (EOFError, OSError):
                    del pool[indices[connection]]
                    failed_starts = 0 if worker.is_ready else failed_starts + 1
                    outcome = _after_death(worker, backlog, deaths, failed_starts)
                else:
                    if outcome is None:
                        worker.is_ready = True
                job = worker.job
                if outcome is None or job is None:
                    continue
                worker.job = None
                if outcome.state == BUSY:
                    backlog.retry_later(job)
                else:
                    yield outcome
    finally:
        _end(pool.values())


def _give_out(backlog: Backlog, pool: dict[int, _Worker], workers: int, measure: Measure) -> None:
    """Give a job to each worker that has none, and start the workers that are missing."""
    for index in range(workers):
        worker = pool.get(index)
        if worker is not None and worker.job is not None:
            continue
        job = backlog.take()
        if job is None:
            return
        if worker is None:
            worker = pool[index] = _start(index, workers, measure)
        worker.job = job
        # The death of a worker is noticed when its answer is read.
        with contextlib.suppress(OSError):
            worker.connection.send(job)


def _after_death(worker: _Worker, backlog: Backlog, deaths: Counter[str], failed_starts: int) -> Outcome | None:
    """Put the job of a dead worker back; its outcome if its worker died too often."""
    worker.process.join()
    worker.connection.close()
    cause = _cause_of_death(worker.process.exitcode)
    if failed_starts >= _MAX_FAILED_STARTS:
        raise OSError(f"worker processes end as they start ({cause}); try 'torchsphere track' on one recording")
    if worker.job is None:
        return None
    result = worker.job.item.result
    deaths[result] += worker.is_ready
    if deaths[result] < MAX_DEATHS:
        backlog.retry(worker.job)
        return None
    return fail_job(worker.job, f"the worker process died ({cause}), and so did a fresh one")


def _cause_of_death(exit_code: int | None) -> str:
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
    # With this end closed, the death of the worker ends the connection.
    there.close()
    return _Worker(process, here)


def _end(workers: Collection[_Worker]) -> None:
    for worker in workers:
        worker.process.terminate()
    for worker in workers:
        worker.process.join(_GRACE_S)
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join()
        worker.connection.close()
        worker.process.close()


def _serve(connection: Connection, measure: Measure, index: int, is_one_of_many: bool) -> None:
    """Run in the worker process: run jobs until the connection ends."""
    signals.become_worker()
    # An exception removes the unfinished result folder.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    if is_one_of_many:
        torch.set_num_threads(1)
    with contextlib.suppress(EOFError, OSError):
        connection.send(None)
        while True:
            job = connection.recv()
            connection.send(run_job(job, measure, index))
