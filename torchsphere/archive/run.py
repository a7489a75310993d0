"""A run over an archive: what is to do, an engine that has it done, the table of how it all stands."""

from __future__ import annotations

import dataclasses
import hashlib
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from torchsphere.archive import folder, records, summary
from torchsphere.archive.key import Key, key_of
from torchsphere.archive.manifest import Archive, Item
from torchsphere.archive.records import DONE, FAILED, PENDING
from torchsphere.archive.work import STOP, Job, Outcome, is_settled
from torchsphere.report import index_page

#: What has jobs done: `processes.run` or `dask_engine.run` with all but the jobs given.
Engine = Callable[[Iterator[Job]], Iterator[Outcome]]

#: Least time between two versions of the table during a run, s, and how much longer than its writing it is.
EVERY_S, TIMES = 30.0, 50.0


@dataclasses.dataclass(frozen=True)
class Counts:
    """How the recordings of a run's share stand; ``measured`` of them were measured in this run.

    ``failures`` has the failed ones in the order of the archive, each with its reason; it is told at the end alone.
    """

    done: int = 0
    failed: int = 0
    pending: int = 0
    measured: int = 0
    failures: tuple[tuple[str, str], ...] = dataclasses.field(default=(), compare=False)

    @property
    def total(self) -> int:
        """All of the share."""
        return self.done + self.failed + self.pending


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, with how the recordings stood."""

    def __init__(self, counts: Counts) -> None:
        super().__init__()
        self.counts = counts


class _Standing:
    """How each recording stands: rows of the table, by the recording's number."""

    def __init__(self, archive: Archive, out: Path, jobs: Sequence[Job]) -> None:
        self._out, self._jobs = out, jobs
        self._rows: list[dict[str, Any]] = [{} for _ in archive.items]
        for i in range(len(self._rows)):
            self.read(i)

    def read(self, i: int) -> None:
        job = self._jobs[i]
        record = records.read(self._out, job.item.result)
        row: dict[str, Any] = {"recording": job.item.recording, "state": PENDING, "reason": None}
        # A result that was taken away is to be measured again; a failure stands until it is.
        if record is not None and is_settled(record, dataclasses.replace(job, retry_failed=False)):
            row |= {"state": record.state, "reason": record.reason or None, **record.row}
        self._rows[i] = row

    def state(self, i: int) -> str:
        return str(self._rows[i]["state"])

    def failures(self, numbers: Sequence[int]) -> tuple[tuple[str, str], ...]:
        """Recordings that failed, of those with these numbers, and why."""
        failed = [self._rows[i] for i in numbers if self.state(i) == FAILED]
        return tuple((row["recording"], row["reason"] or "") for row in failed)

    def write(self, *, everything: bool) -> None:
        """Write the table, at the end also as a page; other runs are waited for: the last to end has seen all."""
        with folder.claims_of(self._out).summary():
            for i in range(len(self._rows)):
                if everything or self.state(i) == PENDING:
                    self.read(i)
            summary.write(self._out, self._rows)
            if everything:
                index_page.write_index(self._out, self._rows)


def run(
    archive: Archive,
    out: Path,
    engine: Engine,
    *,
    shard: tuple[int, int] = (1, 1),
    retry_failed: bool = False,
    changed: Callable[[Counts], None] | None = None,
) -> Counts:
    """Measure what is new or changed in an archive, and write its table.

    Parameters
    ----------
    archive : Archive
    out : Path
        Folder for the results.
    engine : callable
        Jobs -> outcomes.
    shard : tuple of int
        (k, n): only the k-th of n parts, which do not depend on each other.
    retry_failed : bool
        Measure again what failed in an earlier run.
    changed : callable, optional
        Called with the counts at the start and after each recording.

    Returns
    -------
    Counts
        Of this shard's recordings.

    Raises
    ------
    OSError
        Where ``out`` is no folder for this, or the engine cannot go on; what was measured is kept.
    Interrupted
        On Ctrl-C; what was measured is kept.
    """
    folder.prepare(out)
    name = uuid.uuid4().hex
    jobs = [Job(item, _key(item), out, name, retry_failed) for item in archive.items]
    standing = _Standing(archive, out, jobs)
    mine = [i for i, item in enumerate(archive.items) if in_shard(item.result, shard)]
    results = [item.result for item in archive.items]
    folder.sweep(out, results)
    to_do = [i for i in mine if standing.state(i) == PENDING or (retry_failed and standing.state(i) == FAILED)]
    states = Counter(PENDING if retry_failed and standing.state(i) == FAILED else standing.state(i) for i in mine)
    counts = Counts(states[DONE], states[FAILED], states[PENDING])
    number = {jobs[i].item.result: i for i in to_do}
    try:
        standing.write(everything=False)
        due = time.monotonic() + EVERY_S
        if changed is not None:
            changed(counts)
        for outcome in engine(jobs[i] for i in to_do):
            if outcome.state == STOP:
                raise OSError(f"{outcome.reason}; the run stops here, what was measured is kept")
            standing.read(number[outcome.result])
            counts = _after(counts, outcome)
            if changed is not None:
                changed(counts)
            if time.monotonic() >= due:
                began = time.monotonic()
                standing.write(everything=False)
                due = time.monotonic() + max(EVERY_S, TIMES * (time.monotonic() - began))
    except KeyboardInterrupt:
        raise Interrupted(counts) from None
    finally:
        folder.sweep(out, results)
        standing.write(everything=True)
    return dataclasses.replace(counts, failures=standing.failures(mine))


def in_shard(result: str, shard: tuple[int, int]) -> bool:
    """Whether a recording belongs to part k of n, by its name: others that come or go do not move it."""
    k, n = shard
    return int.from_bytes(hashlib.sha256(result.encode()).digest()[:8], "big") % n == k - 1


def _key(item: Item) -> Key:
    return key_of(item.input, item.settings)


def _after(counts: Counts, outcome: Outcome) -> Counts:
    done = outcome.state == DONE
    return dataclasses.replace(
        counts,
        done=counts.done + done,
        failed=counts.failed + (not done),
        pending=counts.pending - 1,
        measured=counts.measured + outcome.measured,
    )
