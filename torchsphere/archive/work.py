"""The work on one recording: lock it, check whether its result is valid, measure it, write its record."""

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

from torchsphere.archive import records, summary
from torchsphere.archive.claims import claims_of
from torchsphere.archive.manifest import Item
from torchsphere.archive.records import DONE, FAILED, UNUSABLE, Key, Record
from torchsphere.request import Request
from torchsphere.runtime.setting_names import as_options
from torchsphere.runtime.shown_text import shown
from torchsphere.settings.limits import SettingError

#: Measures a recording, as `torchsphere.measure.measure`.
Measure = Callable[[Request, None, Mapping[str, Path]], Any]

#: States of an outcome beside "done" and "failed". BUSY: another process has locked the recording. STOP: the output
#: folder cannot be written to, so all further recordings would fail for the same reason.
BUSY, STOP = "busy", "stop"
_NOT_WRITABLE = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)

#: Deaths of the worker in a run after which a recording fails (docs/constants.toml).
MAX_DEATHS = 2
#: File in a result folder with the hashes of its input and settings.
KEY_FILE = "batch.json"


@dataclasses.dataclass(frozen=True, slots=True)
class Job:
    """A recording to measure."""

    item: Item
    key: Key
    out: Path  # output folder of the archive
    run: str  # name of the run
    retry_failed: bool = False  # whether to measure again what failed in an earlier run

    @property
    def folder(self) -> Path:
        """Result folder of the recording."""
        return self.out / self.item.result


@dataclasses.dataclass(frozen=True, slots=True)
class Outcome:
    """How a job ended: "done", "unusable", "failed", "busy" or "stop"; ``measured`` if this job measured it."""

    result: str
    state: str
    reason: str = ""
    measured: bool = False


def run_job(job: Job, measure: Measure, worker: int = 0) -> Outcome:
    """Measure the recording of ``job``, unless another process has locked it or its record is valid.

    An error in the recording is not raised; the record and the outcome state the reason.
    """
    return _with_lock(job, lambda: _measured(job, measure, worker))


def fail_job(job: Job, reason: str) -> Outcome:
    """Record that the recording failed, for a reason that its worker could not record."""
    return _with_lock(job, lambda: _failed(job, reason, 0.0))


def _with_lock(job: Job, finish: Callable[[], Outcome]) -> Outcome:
    """Call ``finish`` with the recording locked, unless another process has locked it or its record is valid."""
    result = job.item.result
    try:
        with claims_of(job.out).claim(result) as is_mine:
            if not is_mine:
                return Outcome(result, BUSY)
            record = _valid_record(job)
            return finish() if record is None else Outcome(result, record.state, record.reason)
    except OSError as error:
        # Errors of the recording are in its record; this error concerns the output folder.
        return Outcome(result, STOP, _sentence(error))


def is_valid(record: Record, job: Job) -> bool:
    """Whether the record is of the same input and settings, so that no measurement is needed."""
    if not records.is_current(record, job.key):
        return False
    if record.state != FAILED:
        return _has_summary(job.folder)
    return not job.retry_failed or record.run == job.run


def _has_summary(folder: Path) -> bool:
    try:
        # A power failure may leave an empty file.
        return (folder / "summary.json").stat().st_size > 0
    except OSError:
        return False


def _valid_record(job: Job) -> Record | None:
    """The valid record, written again if the result or the contents of the input prove a record valid."""
    record = records.read(job.out, job.item.result)
    if record is not None and is_valid(record, job):
        return record
    # A process may have been killed after it wrote the result and before it wrote the record.
    origin = records.read_table(job.folder / KEY_FILE)
    if origin is not None and (origin.get("stat"), origin.get("settings")) == (job.key.stat, job.key.settings):
        table = records.read_table(job.folder / "summary.json")
        if table is not None and (record is None or record.state != FAILED or not records.is_current(record, job.key)):
            # A damaged result is measured again.
            with contextlib.suppress(TypeError, ValueError, AttributeError, OverflowError):
                return _done(job, table, str(origin.get("run")))
    if record is None or record.content is None or record.settings != job.key.settings:
        return None
    # A copied file has another time of change; its contents decide.
    same = dataclasses.replace(record, stat=job.key.stat)
    if record.stat != same.stat and is_valid(same, job) and _content(job) == record.content:
        records.write(job.out, job.item.result, same)
        return same
    return None


def _content(job: Job) -> str | None:
    return records.content(job.item.input, job.item.settings.get("axes"))


def _started_file(job: Job) -> Path:
    """File that exists during the measurement; it stays if the process dies."""
    return records.file_of(job.out, job.item.result, ".started")


def _measured(job: Job, measure: Measure, worker: int) -> Outcome:
    if job.item.refusal:
        return _failed(job, job.item.refusal, 0.0)
    mark = _started_file(job)
    started = records.read_table(mark) or {}
    deaths = int(started.get("count", 0)) if started.get("run") == job.run else 0
    if deaths >= MAX_DEATHS:
        return _failed(job, f"the worker process died {deaths} times while it measured this recording", 0.0)
    records.write_table(mark, {**dataclasses.asdict(job.key), "run": job.run, "count": deaths + 1})
    began = time.perf_counter()
    try:
        measure(_request(job, worker), None, {KEY_FILE: mark})
        table = records.read_table(job.folder / "summary.json")
        if table is None:
            return _failed(job, "the measurement left no summary.json", time.perf_counter() - began)
        record = _done(job, table, job.run)
        return Outcome(job.item.result, record.state, record.reason, measured=True)
    except Exception as error:
        if isinstance(error, OSError) and error.errno in _NOT_WRITABLE:
            raise
        trace = "" if isinstance(error, (ValueError, OSError)) else traceback.format_exc()
        return _failed(job, _sentence(error), time.perf_counter() - began, trace)
    finally:
        mark.unlink(missing_ok=True)


def _request(job: Job, worker: int) -> Request:
    settings = dict(job.item.settings)
    gpus = torch.cuda.device_count() if settings.get("device") == "cuda" else 0
    if gpus > 1:
        settings["device"] = f"cuda:{worker % gpus}"
    return Request(input=job.item.input, out=job.folder, overwrite=True, **settings)


def _done(job: Job, table: Mapping[str, Any], run: str) -> Record:
    """Write the record of a result with this ``summary.json``."""
    row = {**summary.measured(table), "result": job.item.result, "finished": _now()}
    if not summary.is_row(row):
        raise ValueError(f"{job.folder / 'summary.json'}: holds values of other types than its columns")
    # Results of earlier versions do not say so.
    unusable = str(table.get("unusable") or "")
    state, content = UNUSABLE if unusable else DONE, table.get("input", {}).get("sha256")
    reason = unusable or summary.lacking(table)
    return _write_record(job, state=state, reason=reason, content=content, run=run, row=row)


def _failed(job: Job, reason: str, seconds: float, trace: str = "") -> Outcome:
    """Write the record of a failure."""
    if _has_summary(job.folder):
        reason += " (its folder still holds the result of an earlier input or of other settings)"
    content = _content(job)
    row = {"seconds": round(seconds, 3), "finished": _now()}
    _write_record(job, state=FAILED, reason=reason, content=content, run=job.run, row=row, trace=trace)
    _started_file(job).unlink(missing_ok=True)
    return Outcome(job.item.result, FAILED, reason, measured=True)


def _write_record(job: Job, **fields: Any) -> Record:
    record = Record(recording=job.item.recording, stat=job.key.stat, settings=job.key.settings, **fields)
    records.write(job.out, job.item.result, record)
    return record


def _sentence(error: Exception) -> str:
    """An error in one line; an unforeseen error with its type and place."""
    text = shown(" ".join(str(error).split()))
    if isinstance(error, OSError) and error.strerror is not None:
        return f"{shown(str(error.filename or 'file'))}: {error.strerror.lower()}"
    if isinstance(error, SettingError):
        return shown(error.as_options())
    if isinstance(error, (ValueError, OSError)) and text:
        return as_options(text)
    with contextlib.suppress(IndexError):
        frame = traceback.extract_tb(error.__traceback__)[-1]
        text = f"{text} ({Path(frame.filename).name}, line {frame.lineno})"
    return f"unforeseen {type(error).__name__}: {text}"


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
