"""The queue of jobs to give out: new jobs, jobs to try again, and jobs whose recording another process has locked."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator

from torchsphere.archive.claims import PAUSE_S
from torchsphere.archive.work import Job


class Backlog:
    """A queue over an iterator of jobs; a job is drawn from the iterator when it is taken."""

    def __init__(self, jobs: Iterator[Job]) -> None:
        self._jobs = jobs
        self._retries: deque[Job] = deque()
        self._locked: deque[tuple[float, Job]] = deque()

    def take(self) -> Job | None:
        """The next job, or None if there is none at this moment."""
        if self._retries:
            return self._retries.popleft()
        job = next(self._jobs, None)
        if job is None and self._locked and self._locked[0][0] <= time.monotonic():
            job = self._locked.popleft()[1]
        return job

    def retry(self, job: Job) -> None:
        """Give the job out again, before all others."""
        self._retries.append(job)

    def retry_later(self, job: Job) -> None:
        """Give the job out again, after a pause and all new jobs."""
        self._locked.append((time.monotonic() + PAUSE_S, job))

    @property
    def is_waiting(self) -> bool:
        """Whether a job is in its pause."""
        return bool(self._locked)
