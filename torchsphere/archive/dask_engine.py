"""Workers of a Dask cluster: each task writes its result itself, and only a few are in flight at any time."""

from __future__ import annotations

import logging
import queue
from collections import Counter
from collections.abc import Iterator
from typing import Any

import torch

from torchsphere.archive.backlog import Backlog
from torchsphere.archive.claims import PAUSE_S
from torchsphere.archive.work import BUSY, Job, Measure, Outcome, give_up, settle
from torchsphere.recording.refusal import LibraryMissingError

#: Futures in flight per worker: one that it measures, one that waits. More would only burden the scheduler.
IN_FLIGHT = 2
#: Times that the scheduler may give a recording up. Those that wait on a worker share the blame for its death with
#: the one that killed it, which `settle` finds by its mark and ends after `work.DEATHS` starts.
_BLAMED = 10
_LOG = logging.getLogger(__name__)


def run(jobs: Iterator[Job], address: str, measure: Measure) -> Iterator[Outcome]:
    """Have the jobs done by the workers of the scheduler at ``address``; an outcome each, as they end.

    All machines must see the recordings and the output folder under the same paths.

    Raises
    ------
    OSError
        Where Dask is not installed, the scheduler cannot be reached or goes away, or nothing can be written any more.
    ValueError
        Where a worker has more threads than one.
    """
    client = _client(address)
    ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
    # With their futures, as one that is dropped is cancelled.
    flying: dict[str, tuple[Any, Job]] = {}
    backlog, blamed, number, is_told = Backlog(jobs), Counter[str](), 0, False
    try:
        while True:
            # Workers may come and go.
            workers = _workers(client, address)
            if workers == 0 and not is_told:
                _LOG.warning("the Dask scheduler at %s has no workers; waiting for one", address)
            is_told = workers == 0
            places = IN_FLIGHT * max(1, workers)
            while len(flying) < places and (job := backlog.take()) is not None:
                number += 1
                future = client.submit(_task, job, measure, key=f"torchsphere-{job.run}-{number}", pure=False)
                flying[future.key] = future, job
                future.add_done_callback(ended.put)
            if not flying and not backlog.waits:
                return
            try:
                future = ended.get(timeout=PAUSE_S)
            except queue.Empty:
                continue
            _, job = flying.pop(future.key)
            outcome = _outcome(future, job, address, blamed)
            # What the scheduler no longer knows takes no memory, however many recordings there are.
            future.release()
            if outcome is None:
                backlog.again(job)
            elif outcome.state == BUSY:
                backlog.later(job)
            else:
                yield outcome
    finally:
        # Futures that are dropped are cancelled; the recordings that workers have begun still reach their folders.
        client.close()


def _task(job: Job, measure: Measure) -> Outcome:
    # One recording per worker and one thread per recording: the workers share the cores.
    torch.set_num_threads(1)
    return settle(job, measure)


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


def _workers(client: Any, address: str) -> int:
    if client.status != "running":
        raise OSError(f"--scheduler {address}: the scheduler has gone; what was measured is kept, start it again")
    threads = client.nthreads()
    if any(count > 1 for count in threads.values()):
        raise ValueError(f"--scheduler {address}: has workers of several threads; start them with --nthreads 1")
    return len(threads)


def _outcome(future: Any, job: Job, address: str, blamed: Counter[str]) -> Outcome | None:
    """How the job of a future ended; None where it is to be given out again."""
    from distributed import KilledWorker

    if future.cancelled():
        raise OSError(f"--scheduler {address}: the scheduler has gone; what was measured is kept, start it again")
    error = future.exception()
    if error is None:
        outcome: Outcome = future.result()
        return outcome
    if not isinstance(error, KilledWorker):
        raise OSError(f"--scheduler {address}: a worker cannot take a task ({error}); has it the same torchsphere?")
    blamed[job.item.result] += 1
    if blamed[job.item.result] < _BLAMED:
        return None
    return give_up(job, f"the Dask scheduler gave it up {_BLAMED} times, as its workers died")
