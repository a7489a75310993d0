"""The command ``torchsphere batch``: its options, its progress bar and its closing sentence."""

from __future__ import annotations

import argparse
import contextlib
import functools
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import torch
from tqdm import tqdm

from torchsphere.archive import dask_engine, folder, manifest, processes, settings
from torchsphere.archive.run import Counts, Engine, Interrupted, run
from torchsphere.archive.work import Measure
from torchsphere.measure import measure, measure_jointly

HELP = "Measure an archive: all recordings of a folder or a manifest, one result folder each; only what is new."
EXAMPLE = "torchsphere batch shots --out results --diameter-mm 30 --mass-g 110 --workers 8"
#: Exit code where recordings failed; their reasons are in summary.csv.
SOME_FAILED = 3


def add(commands: Any) -> None:
    """Add the command to those of ``torchsphere``."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "batch",
        help=HELP,
        description=HELP + " The exit code is 0 where all are done and 3 where some failed (summary.csv says why).",
        epilog=f"example:  {EXAMPLE}   A manifest: a CSV with the column 'recording', and one for each setting that "
        "differs; or a TOML file with a table [[recordings]] each.",
        allow_abbrev=False,
    )
    parser.set_defaults(command=command)
    parser.add_argument("source", type=Path, metavar="MANIFEST_OR_FOLDER", help="manifest .csv, .toml, or a folder")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    parser.add_argument("--workers", type=_count, metavar="N", help="processes (one per core, or per GPU)")
    parser.add_argument(
        "--together", type=_count, metavar="N", help="recordings that a GPU measures at once, in common batches (1)"
    )
    parser.add_argument("--scheduler", metavar="ADDRESS", help="or the workers of a Dask scheduler, tcp://host:8786")
    parser.add_argument("--shard", type=_shard, metavar="K/N", help="only part K of N, for job arrays")
    parser.add_argument("--retry-failed", action="store_true", help="measure again what failed in an earlier run")
    parser.add_argument("--config", type=Path, metavar="FILE.toml", help="settings for all recordings")
    parser.add_argument("--quiet", action="store_true", help="no progress bar, no notes, no closing sentence")
    common = parser.add_argument_group(
        "settings for all recordings", "As of 'torchsphere track'; they win over --config, and a recording's own win."
    )
    for name, kind in sorted(settings.NAMES.items()):
        option = f"--{name.replace('_', '-')}"
        if kind == "bool" and settings.DEFAULTS[name]:
            common.add_argument(f"--no-{option[2:]}", action="store_false", default=None, dest=name)
        elif kind == "bool":
            common.add_argument(option, action="store_true", default=None)
        else:
            common.add_argument(option, type=_setting(name), metavar=name.split("_")[-1].upper())


def _setting(name: str) -> Callable[[str], Any]:
    def read(text: str) -> Any:
        try:
            return settings.from_text(name, text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from error

    return read


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no number, 1 or more")
    return int(text)


def _shard(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)/(\d+)", text)
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        raise argparse.ArgumentTypeError(f"{text!r} is not K/N, such as 1/8 to 8/8")
    return int(match[1]), int(match[2])


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
    if options["scheduler"] is not None and options["together"] is not None:
        raise ValueError("--together and --scheduler were both given; a Dask worker has one thread, leave one out")
    archive = manifest.read(source, common, out)
    engine = _engine(options, any(item.settings.get("device") == "cuda" for item in archive.items), measurement)
    claims = folder.prepare(out)
    if not options["quiet"]:
        notes = list(archive.notes)
        if not claims.work():
            notes.append(f"{out}: its file system has no locks, so two runs at once would repeat each other's work.")
        for note in notes:
            print(f"torchsphere: {note}", file=sys.stderr)  # noqa: T201  (the command line)
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
    return SOME_FAILED if counts.failed else 0


def _told(counts: Counts) -> str:
    pending = f", {counts.pending} pending" if counts.pending else ""
    of = f"{counts.done} of {counts.total} recordings done, {counts.failed} failed{pending}"
    return f"{of} ({counts.measured} measured in this run)"


def _say(sentence: str, quiet: bool) -> None:
    if not quiet:
        print(sentence)  # noqa: T201  (the command line)


def _absolute(common: Mapping[str, Any]) -> dict[str, Any]:
    """The settings with the names of mask images as other working folders need them."""
    if "ignore" not in common:
        return dict(common)
    masks = [str(Path(text).absolute()) if Path(text).is_file() else text for text in common["ignore"]]
    return {**common, "ignore": masks}


def _engine(options: Mapping[str, Any], on_gpu: bool, measurement: Measure) -> Engine:
    if options["scheduler"] is not None:
        return functools.partial(dask_engine.run, address=options["scheduler"], measure=measurement)
    workers = options["workers"]
    if workers is None:
        # Processes that share a GPU would each hold its context and its memory.
        workers = max(1, torch.cuda.device_count()) if on_gpu else _cores()
    lanes = options["together"] or 1
    if lanes > 1 and measurement is measure:
        measurement = measure_jointly
    return functools.partial(processes.run, workers=workers, measure=measurement, lanes=lanes)


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
