"""What a worker does with one recording: claim it, see whether it is still to do, measure, record how it ended."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import errno
import time
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch

from torchsphere.archive import key, records, summary
from torchsphere.archive.claims import claims_of
from torchsphere.archive.key import Key
from torchsphere.archive.manifest import Item
from torchsphere.archive.records import DONE, FAILED, Record
from torchsphere.request import Request

#: What measures a recording: `torchsphere.measure.measure`.
Measure = Callable[[Request, None, Mapping[str, Path]], Any]

#: What an outcome may be beside "done" and "failed": another process has the recording; nothing can be written any
#: more, so that the other recordings would fail for the same reason.
BUSY, STOP = "busy", "stop"
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)

#: Deaths of its worker after which a recording is given up: a process may be killed for reasons of its own once.
DEATHS = 2
#: File in a result folder that says which input and settings it is of.
KEY_FILE = "batch.json"


@dataclasses.dataclass(frozen=True, slots=True)
class Job:
    """A recording to measure.

    Attributes
    ----------
    item : Item
    key : Key
    out : Path
        The archive's output folder.
    run : str
        Name of this run.
    retry_failed : bool
        Whether what failed in an earlier run is to be measured again.
    """

    item: Item
    key: Key
    out: Path
    run: str
    retry_failed: bool = False

    @property
    def folder(self) -> Path:
        """The recording's result folder."""
        return self.out / self.item.result


@dataclasses.dataclass(frozen=True, slots=True)
class Outcome:
    """How a job ended: ``state`` is "done", "failed", "busy" or "stop"; ``measured`` if it was measured just now."""

    result: str
    state: str
    reason: str = ""
    measured: bool = False


def settle(job: Job, measure: Measure, worker: int = 0) -> Outcome:
    """Measure the recording of ``job`` unless another process has it or it is not to be measured again.

    Nothing that is wrong with the recording is raised: it is recorded, and the outcome says so.
    """
    result = job.item.result
    try:
        with claims_of(job.out).claim(result) as mine:
            if not mine:
                return Outcome(result, BUSY)
            known = _known(job)
            if known is not None:
                return Outcome(result, known.state, known.reason)
            return _measured(job, measure, worker)
    except OSError as error:
        # The recording's own errors have been recorded; these are of the output folder.
        return Outcome(result, STOP, sentence(error))


def give_up(job: Job, reason: str) -> Outcome:
    """Record that the recording failed for a reason that its worker could not record."""
    with claims_of(job.out).claim(job.item.result) as mine:
        if not mine:
            return Outcome(job.item.result, BUSY)
        known = _known(job)
        if known is not None:
            return Outcome(job.item.result, known.state, known.reason)
        _mark(job).unlink(missing_ok=True)
        return _failed(job, reason, 0.0)


def is_settled(record: Record, job: Job) -> bool:
    """Whether a record of this very input and these settings spares the measurement."""
    if not records.is_current(record, job.key):
        return False
    if record.state == DONE:
        return _has_summary(job.folder)
    return not job.retry_failed or record.run == job.run


def _has_summary(folder: Path) -> bool:
    try:
        # After a power failure a file may be there and empty.
        return (folder / "summary.json").stat().st_size > 0
    except OSError:
        return False


def _known(job: Job) -> Record | None:
    """The record that spares the measurement, if there is one."""
    record = records.read(job.out, job.item.result)
    if record is not None and is_settled(record, job):
        return record
    # Its process was killed between the result and the record.
    told = records.read_table(job.folder / KEY_FILE)
    if told is not None and (told.get("stat"), told.get("settings")) == (job.key.stat, job.key.settings):
        table = records.read_table(job.folder / "summary.json")
        if table is not None and (record is None or record.state == DONE or not records.is_current(record, job.key)):
            return _done(job, table, str(told.get("run")))
    if record is None or record.content is None or record.settings != job.key.settings:
        return None
    # Files that were copied or touched have another time; their contents decide.
    same = dataclasses.replace(record, stat=job.key.stat)
    if record.stat != same.stat and is_settled(same, job) and key.content(job.item.input) == record.content:
        records.write(job.out, job.item.result, same)
        return same
    return None


def _mark(job: Job) -> Path:
    return records.file_of(job.out, job.item.result, ".started")


def _measured(job: Job, measure: Measure, worker: int) -> Outcome:
    mark = _mark(job)
    started = records.read_table(mark) or {}
    deaths = int(started.get("count", 0)) if started.get("run") == job.run else 0
    if deaths >= DEATHS:
        mark.unlink(missing_ok=True)
        return _failed(job, f"the worker process died {deaths} times while it measured this recording", 0.0)
    # A mark that is still there when the recording is taken up again tells of a process that died.
    records.write_table(mark, {**dataclasses.asdict(job.key), "run": job.run, "count": deaths + 1})
    began = time.perf_counter()
    try:
        measure(_request(job, worker), None, {KEY_FILE: mark})
        table = records.read_table(job.folder / "summary.json")
        if table is None:
            return _failed(job, "the measurement left no summary.json", time.perf_counter() - began)
        _done(job, table, job.run)
        return Outcome(job.item.result, DONE, measured=True)
    except Exception as error:
        if isinstance(error, OSError) and error.errno in _FULL:
            raise
        trace = "" if isinstance(error, (ValueError, OSError)) else traceback.format_exc()
        return _failed(job, sentence(error), time.perf_counter() - began, trace)
    finally:
        mark.unlink(missing_ok=True)


def _request(job: Job, worker: int) -> Request:
    settings = dict(job.item.settings)
    count = torch.cuda.device_count() if settings.get("device") == "cuda" else 0
    if count > 1:
        settings["device"] = f"cuda:{worker % count}"
    return Request(input=job.item.input, out=job.folder, overwrite=True, **settings)


def _done(job: Job, table: Mapping[str, Any], run: str) -> Record:
    content = table.get("input", {}).get("sha256")
    row = {**summary.measured(table), "result": job.item.result, "finished": _now()}
    return _record(job, DONE, "", content, row, run)


def _failed(job: Job, reason: str, seconds: float, trace: str = "") -> Outcome:
    if (job.folder / "summary.json").is_file():
        reason += " (its folder still holds the result of an earlier input or of other settings)"
    row = {"seconds": round(seconds, 3), "finished": _now()}
    _record(job, FAILED, reason, key.content(job.item.input), row, job.run, trace)
    return Outcome(job.item.result, FAILED, reason, measured=True)


def _record(
    job: Job, state: str, reason: str, content: str | None, row: Mapping[str, Any], run: str, trace: str = ""
) -> Record:
    record = Record(
        recording=job.item.recording,
        state=state,
        reason=reason,
        stat=job.key.stat,
        settings=job.key.settings,
        content=content,
        run=run,
        row=row,
        trace=trace,
    )
    records.write(job.out, job.item.result, record)
    return record


def sentence(error: Exception) -> str:
    """An error in one line, with its kind where its words were not written for a user."""
    text = " ".join(str(error).split())
    if isinstance(error, OSError) and error.strerror is not None:
        return f"{error.filename or 'file'}: {error.strerror.lower()}"
    if isinstance(error, (ValueError, OSError)) and text:
        return text
    with contextlib.suppress(IndexError):
        frame = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{text} ({Path(frame.filename).name}, line {frame.lineno})"
    return f"unforeseen {type(error).__name__}: {text}"


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
