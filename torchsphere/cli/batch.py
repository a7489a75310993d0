"""The command ``torchsphere batch``: its engine, its progress bar and its closing sentence."""

from __future__ import annotations

import contextlib
import functools
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import torch
from tqdm import tqdm

from torchsphere.archive import dask_engine, folder, manifest, processes, settings
from torchsphere.archive.run import Counts, Engine, Interrupted, run
from torchsphere.archive.work import Measure
from torchsphere.measure import measure

#: Exit code where recordings failed; their reasons are in summary.csv.
SOME_FAILED = 3

#: Failed recordings that are named at the end; all of them stand in summary.csv.
FAILURES_TOLD = 5


def command(options: dict[str, Any], measurement: Measure = measure) -> int:
    """Run over the archive; 0 where all recordings of its share are done, 3 where some failed, 130 on Ctrl-C.

    ``measurement`` is what measures one recording.

    Raises
    ------
    ValueError, OSError
        With one sentence on what is wrong with the manifest, the output folder or the engine.
    """
    # Workers on other machines have other working folders.
    source, out = options["source"].absolute(), options["out"].absolute()
    common = {} if options["config"] is None else settings.read_config(options["config"])
    given = {name: options[name] for name in settings.NAMES if options[name] is not None}
    common = _absolute(settings.joined(common, given))
    if options["scheduler"] is not None and options["workers"] is not None:
        raise ValueError("--workers and --scheduler were both given; a scheduler has workers of its own, leave one out")
    archive = manifest.read(source, common, out)
    engine = _engine(options, any(item.settings.get("device") == "cuda" for item in archive.items), measurement)
    claims = folder.prepare(out)
    if not options["quiet"]:
        notes = list(archive.notes)
        if not claims.are_supported():
            notes.append(f"{out}: its file system has no locks, so two runs at once would repeat each other's work.")
        for note in notes:
            print(f"torchsphere: {note}", file=sys.stderr)
    return _run(archive, out, engine, options)


def _run(archive: manifest.Archive, out: Path, engine: Engine, options: Mapping[str, Any]) -> int:
    shard, retry, quiet = options["shard"] or (1, 1), options["retry_failed"], options["quiet"]
    try:
        with _progress(quiet) as changed:
            counts = run(archive, out, engine, shard=shard, retry_failed=retry, changed=changed)
    except Interrupted as stop:
        _say(f"interrupted; {_told(stop.counts)}; the same command goes on", quiet)
        return 130
    _say(f"{_told(counts)}; see {out / folder.SUMMARIES[0]}", quiet)
    for sentence in _failures(counts, out):
        _say(sentence, quiet)
    return SOME_FAILED if counts.failed else 0


def _told(counts: Counts) -> str:
    pending = f", {counts.pending} pending" if counts.pending else ""
    of = f"{counts.done} of {counts.total} recordings done, {counts.failed} failed{pending}"
    return f"{of} ({counts.measured} measured in this run)"


def _failures(counts: Counts, out: Path) -> list[str]:
    """The first recordings that failed and why, and where the others stand."""
    told = [f"failed  {name}: {reason.removeprefix(f'{name}: ')}" for name, reason in counts.failures[:FAILURES_TOLD]]
    more = len(counts.failures) - len(told)
    return [*told, f"and {more} more; their reasons stand in {out / folder.SUMMARIES[0]}"] if more else told


def _say(sentence: str, quiet: bool) -> None:
    if not quiet:
        print(sentence)


def _absolute(common: Mapping[str, Any]) -> dict[str, Any]:
    """The settings with the names of mask images as other working folders need them."""
    if "ignore" not in common:
        return dict(common)
    masks = [str(Path(text).absolute()) if Path(text).is_file() else text for text in common["ignore"]]
    return {**common, "ignore": masks}


def _engine(options: Mapping[str, Any], on_gpu: bool, measurement: Measure) -> Engine:
    if options["scheduler"] is not None:
        return functools.partial(dask_engine.run, address=options["scheduler"], measure=measurement)
    if on_gpu and not torch.cuda.device_count():
        # Each recording would fail for it, and stand as failed on a machine that has one.
        raise ValueError(
            "--device cuda was asked for, but torch finds no CUDA device here; leave it out to use the CPU"
        )
    workers = options["workers"]
    if workers is None:
        # Processes that share a GPU would each hold its context and its memory.
        workers = max(1, torch.cuda.device_count()) if on_gpu else _cores()
    return functools.partial(processes.run, workers=workers, measure=measurement)


def _cores() -> int:
    """Cores that this process may use: a job scheduler may have given it fewer than there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def _progress(quiet: bool) -> Iterator[Callable[[Counts], None] | None]:
    """A callback that shows a bar on stderr, with failures and time left, or None."""
    if quiet:
        yield None
        return
    bar: tqdm[Any] | None = None

    def show(counts: Counts) -> None:
        nonlocal bar
        ended = counts.done + counts.failed
        if bar is None:
            # What needs no measurement is no part of the rate that the time left is told from.
            bar = tqdm(total=counts.total, initial=ended, unit="recording", file=sys.stderr, leave=False)
        bar.set_postfix_str(f"{counts.failed} failed", refresh=False)
        bar.update(ended - bar.n)

    try:
        yield show
    finally:
        if bar is not None:
            bar.close()
