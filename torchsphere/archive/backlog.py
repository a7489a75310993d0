"""Jobs that are still to be given out: new ones, such as are to be tried again, and such as another process has."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator

from torchsphere.archive.claims import PAUSE_S
from torchsphere.archive.work import Job


class Backlog:
    """A queue over an iterator of jobs, which is drawn from only as jobs are taken."""

    def __init__(self, jobs: Iterator[Job]) -> None:
        self._jobs = jobs
        self._again: deque[Job] = deque()
        self._later: deque[tuple[float, Job]] = deque()

    def take(self) -> Job | None:
        """The next job, or None where there is none at this moment."""
        if self._again:
            return self._again.popleft()
        job = next(self._jobs, None)
        if job is None and self._later and self._later[0][0] <= time.monotonic():
            job = self._later.popleft()[1]
        return job

    def again(self, job: Job) -> None:
        """Give the job out once more, next."""
        self._again.append(job)

    def later(self, job: Job) -> None:
        """Give the job out once more, after a pause."""
        self._later.append((time.monotonic() + PAUSE_S, job))

    @property
    def waits(self) -> bool:
        """Whether there are jobs whose pause is not over."""
        return bool(self._later)
