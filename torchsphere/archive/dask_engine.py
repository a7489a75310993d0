"""Workers of a Dask cluster: each task writes its result itself, and few tasks are in flight at any time."""

from __future__ import annotations

import logging
import queue
from collections import Counter
from collections.abc import Iterator
from typing import Any

import torch

from torchsphere.archive.backlog import Backlog
from torchsphere.archive.claims import PAUSE_S
from torchsphere.archive.work import BUSY, Job, Measure, Outcome, fail_job, run_job
from torchsphere.recording.refusal import LibraryMissingError

#: Tasks in flight per worker, the running task and the next (docs/constants.toml).
IN_FLIGHT = 2
#: Number of drops by the scheduler, after deaths of workers, at which a recording fails (docs/constants.toml).
_MAX_DROPS = 10
_LOG = logging.getLogger(__name__)


def run(jobs: Iterator[Job], address: str, measure: Measure) -> Iterator[Outcome]:
    """Measure the jobs on the workers of the scheduler at ``address``, and yield the outcome of each job as it ends.

    All machines must see the recordings and the output folder under the same paths. Raises OSError without Dask or a
    scheduler, and ValueError if a worker has more than one thread.
    """
    client = _client(address)
    ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
    # The futures are kept here, as Dask cancels a future that nothing refers to.
    flying: dict[str, tuple[Any, Job]] = {}
    backlog, drops, number, is_told = Backlog(jobs), Counter[str](), 0, False
    try:
        while True:
            workers = _worker_count(client, address)
            if workers == 0 and not is_told:
                _LOG.warning("the Dask scheduler at %s has no workers; waiting for one", address)
            is_told = workers == 0
            places = IN_FLIGHT * max(1, workers)
            while len(flying) < places and (job := backlog.take()) is not None:
                number += 1
                future = client.submit(_task, job, measure, key=f"torchsphere-{job.run}-{number}", pure=False)
                flying[future.key] = future, job
                future.add_done_callback(ended.put)
            if not flying and not backlog.is_waiting:
                return
            try:
                future = ended.get(timeout=PAUSE_S)
            except queue.Empty:
                continue
            _, job = flying.pop(future.key)
            outcome = _outcome(future, job, address, drops)
            # The scheduler forgets the task, so its memory does not grow with the number of recordings.
            future.release()
            if outcome is None:
                backlog.retry(job)
            elif outcome.state == BUSY:
                backlog.retry_later(job)
            else:
                yield outcome
    finally:
        # This cancels tasks that wait; tasks that run still write their results.
        client.close()


def _task(job: Job, measure: Measure) -> Outcome:
    torch.set_num_threads(1)
    return run_job(job, measure)


def _client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError as error:
        raise LibraryMissingError(
            f"--scheduler {address}: needs Dask; install it with: pip install 'torchsphere[dask]'"
        ) from error
    try:
        return Client(address, set_as_default=False)  # type: ignore[no-untyped-call,unused-ignore]
    except (OSError, TimeoutError, ValueError) as error:
        raise OSError(f"--scheduler {address}: no Dask scheduler answers there; check the address") from error


def _worker_count(client: Any, address: str) -> int:
    if client.status != "running":
        raise _scheduler_gone(address)
    threads = client.nthreads()
    if any(count > 1 for count in threads.values()):
        raise ValueError(f"--scheduler {address}: has workers of several threads; start them with --nthreads 1")
    return len(threads)


def _outcome(future: Any, job: Job, address: str, drops: Counter[str]) -> Outcome | None:
    """How the job of a future ended; None if it is to be tried again."""
    from distributed import KilledWorker

    if future.cancelled():
        raise _scheduler_gone(address)
    error = future.exception()
    if error is None:
        outcome: Outcome = future.result()
        return outcome
    if not isinstance(error, KilledWorker):
        raise OSError(f"--scheduler {address}: a worker cannot take a task ({error}); has it the same torchsphere?")
    drops[job.item.result] += 1
    if drops[job.item.result] < _MAX_DROPS:
        return None
    return fail_job(job, f"the Dask scheduler gave it up {_MAX_DROPS} times, as its workers died")


def _scheduler_gone(address: str) -> OSError:
    return OSError(f"--scheduler {address}: the scheduler has gone; what was measured is kept, start it again")
