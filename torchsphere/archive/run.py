"""A run over an archive: list the recordings to measure, have an engine measure them, write the table of all."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import time
import uuid
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from torchsphere.archive import folder, records, summary
from torchsphere.archive.claims import claims_of
from torchsphere.archive.manifest import Archive
from torchsphere.archive.records import DONE, ENDS, FAILED, PENDING, UNUSABLE, key_of
from torchsphere.archive.work import STOP, Job, Outcome, is_valid
from torchsphere.report import pages
from torchsphere.results.exports import check_exports
from torchsphere.runtime import steps

#: Measures jobs: `processes.run` or `dask_engine.run` with all arguments but the jobs given.
Engine = Callable[[Iterator[Job]], Iterator[Outcome]]

#: Recordings, each with a sentence.
Named = tuple[tuple[str, str], ...]

#: Shortest pause between two writings of the table, s, and as a multiple of the time of writing (docs/constants.toml).
EVERY_S, WRITING_TIMES = 30.0, 50.0


@dataclasses.dataclass(frozen=True)
class Counts:
    """Numbers of recordings, by state, in a run's share of the archive."""

    done: int = 0
    failed: int = 0
    pending: int = 0
    measured: int = 0  # in this run, with whatever outcome
    unusable: int = 0
    # recordings that failed, those without a usable result, and those that are done and lack something, each with its
    # reason, in the order of the archive; empty until the run ends
    failures: Named = dataclasses.field(default=(), compare=False)
    without_motion: Named = dataclasses.field(default=(), compare=False)
    incomplete: Named = dataclasses.field(default=(), compare=False)
    # recordings that are done with severe warnings, each with its result folder and their number
    severe: tuple[tuple[str, str, int], ...] = dataclasses.field(default=(), compare=False)

    @property
    def total(self) -> int:
        """All recordings of the share."""
        return self.done + self.unusable + self.failed + self.pending

    def after(self, outcome: Outcome) -> Counts:
        """The counts after a pending recording was measured or failed."""
        return dataclasses.replace(
            self,
            done=self.done + (outcome.state == DONE),
            unusable=self.unusable + (outcome.state == UNUSABLE),
            failed=self.failed + (outcome.state not in (DONE, UNUSABLE)),
            pending=self.pending - 1,
            measured=self.measured + outcome.measured,
        )


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, with the counts at that moment."""

    def __init__(self, counts: Counts) -> None:
        super().__init__()
        self.counts = counts


class _Table:
    """The table of an archive: a row per recording, by its number, from the records."""

    def __init__(self, out: Path, jobs: Sequence[Job]) -> None:
        self._out, self._jobs = out, jobs
        self._rows: list[dict[str, Any]] = [{} for _ in jobs]
        self._due = 0.0
        # A recording that wants a kind of file has the whole table in it, too.
        self._exports = sorted({kind for job in jobs for kind in job.item.settings.get("export", ())})
        for i in range(len(jobs)):
            self.read(i)

    def read(self, i: int) -> None:
        """Read the record of a recording again."""
        job = self._jobs[i]
        record = records.read(self._out, job.item.result)
        row: dict[str, Any] = {"recording": job.item.recording, "state": PENDING, "reason": None}
        # A failure stays until it is measured again; a removed result is pending.
        if record is not None and is_valid(record, dataclasses.replace(job, retry_failed=False)):
            row |= {"state": record.state, "reason": record.reason or None, **record.row}
        self._rows[i] = row

    def state(self, i: int) -> str:
        return str(self._rows[i]["state"])

    def named(self, counts: Counts, numbers: Sequence[int]) -> Counts:
        """The counts with the recordings among these numbers that a reader must know of."""
        rows = [self._rows[i] for i in numbers]
        of: dict[str, list[tuple[str, str]]] = {state: [] for state in (*ENDS, PENDING)}
        for row in rows:
            of[row["state"]].append((row["recording"], row["reason"] or ""))
        severe = [row for row in rows if row["state"] == DONE and row.get("severe_warnings")]
        return dataclasses.replace(
            counts,
            failures=tuple(of[FAILED]),
            without_motion=tuple(of[UNUSABLE]),
            incomplete=tuple((name, reason) for name, reason in of[DONE] if reason),
            severe=tuple((row["recording"], row["result"], row["severe_warnings"]) for row in severe),
        )

    def write_if_due(self) -> None:
        if time.monotonic() >= self._due:
            self.write(is_last=False)

    def write(self, *, is_last: bool) -> None:
        """Write the table, also as a page, with the results of other runs."""
        began = time.monotonic()
        with claims_of(self._out).summary_lock():
            for i in range(len(self._rows)):
                if is_last or self.state(i) == PENDING:
                    self.read(i)
            summary.write(self._out, self._rows, self._exports if is_last else ())
            pages.write_index(self._out, self._rows, is_growing=not is_last)
        ended = time.monotonic()
        self._due = ended + max(EVERY_S, WRITING_TIMES * (ended - began))


def run(
    archive: Archive,
    out: Path,
    engine: Engine,
    *,
    shard: tuple[int, int] = (1, 1),
    retry_failed: bool = False,
    changed: Callable[[Counts], None] | None = None,
) -> Counts:
    """Measure the new and changed recordings of part ``shard`` (k, n) of an archive, and write the table of all.

    ``changed`` gets the counts of this part at the start and after each recording. Raises OSError if ``out`` cannot be
    used or the engine cannot go on, and Interrupted on Ctrl-C; finished results stay.
    """
    folder.prepare(out)
    check_exports(sorted({kind for item in archive.items for kind in item.settings.get("export", ())}))
    name = uuid.uuid4().hex
    steps.tell("reading the state of %d recordings", len(archive.items))
    jobs = [Job(item, key_of(item.input, item.settings), out, name, retry_failed) for item in archive.items]
    table = _Table(out, jobs)
    results = [item.result for item in archive.items]
    folder.sweep(out, results)
    share = [i for i, result in enumerate(results) if in_shard(result, shard)]
    states = {i: PENDING if retry_failed and table.state(i) == FAILED else table.state(i) for i in share}
    numbers = {results[i]: i for i, state in states.items() if state == PENDING}
    tally = Counter(states.values())
    counts = Counts(tally[DONE], tally[FAILED], tally[PENDING], unusable=tally[UNUSABLE])
    try:
        table.write(is_last=False)
        if changed is not None:
            changed(counts)
        for outcome in engine(jobs[i] for i in numbers.values()):
            if outcome.state == STOP:
                raise OSError(f"{outcome.reason}; the run stops here, what was measured is kept")
            table.read(numbers[outcome.result])
            counts = counts.after(outcome)
            if changed is not None:
                changed(counts)
            table.write_if_due()
    except BaseException as error:
        # The cause of the end is to be told, also where a full disk does not take the table.
        with contextlib.suppress(OSError):
            folder.sweep(out, results)
            table.write(is_last=True)
        if isinstance(error, KeyboardInterrupt):
            raise Interrupted(counts) from None
        raise
    steps.tell("writing the table of %d recordings", len(jobs))
    folder.sweep(out, results)
    table.write(is_last=True)
    return table.named(counts, share)


def in_shard(result: str, shard: tuple[int, int]) -> bool:
    """Whether a recording belongs to part k of n, by the hash of its name, so that other recordings have no effect."""
    k, n = shard
    return int.from_bytes(hashlib.sha256(result.encode()).digest()[:8], "big") % n == k - 1
