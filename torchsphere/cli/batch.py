"""The command ``torchsphere batch``: options, engine, and closing sentences."""

from __future__ import annotations

import argparse
import functools
import os
import re
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchsphere.cli.console import loading_libraries, progress_bar, say
from torchsphere.cli.exit_codes import DONE, INTERRUPTED, SOME_FAILED, UNUSABLE, UsageError, usage
from torchsphere.cli.options import (
    add_command,
    add_config,
    add_out,
    add_quiet,
    add_settings,
    add_verbose,
)
from torchsphere.request import PER_RECORDING, check_settings
from torchsphere.runtime.shown_text import shown
from torchsphere.settings.configuration import of_command

if TYPE_CHECKING:
    from torchsphere.archive.manifest import Archive
    from torchsphere.archive.run import Counts, Engine
    from torchsphere.archive.work import Measure

#: Largest number of recordings of a kind that the closing sentences name; summary.csv has all.
FAILURES_NAMED = 5


def add(commands: Any) -> None:
    """Add the command to the parser."""
    text = "Measure an archive: all recordings of a folder or a manifest, one result folder each; only what is new."
    example = "torchsphere batch shots --out results --diameter-mm 30 --mass-g 110 --workers 8"
    epilog = (
        f"example:  {example}   A manifest: a CSV with the column 'recording', and one for each setting that differs; "
        "or a TOML file with a table [[recordings]] each."
    )
    parser = add_command(commands, "batch", run, text, epilog)
    parser.description += (
        " The settings below hold for all recordings; they win over --config, and a recording's own win over both. "
        "The exit code is 0 where all are done, 3 where some failed, and 4 where none failed and some are unusable: "
        "their results are written, and nothing usable was measured (summary.csv says why)."
    )
    parser.add_argument(
        "source",
        type=Path,
        nargs="+",
        metavar="MANIFEST_OR_FOLDER",
        help="manifest .csv, .toml, folder, or recording; or several of these",
    )
    add_out(parser, "folder for the results")
    parser.add_argument("--workers", type=_count, metavar="N", help="processes (one per core, or per GPU)")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="or the workers of a Dask scheduler, tcp://host:8786")
    parser.add_argument("--shard", type=_shard, metavar="K/N", help="only part K of N, for job arrays")
    parser.add_argument("--retry-failed", action="store_true", help="measure again what failed in an earlier run")
    add_config(parser, "batch", PER_RECORDING, "settings for all recordings")
    add_quiet(parser, "no progress bar, no notes, no closing sentence")
    add_verbose(parser)
    add_settings(parser, PER_RECORDING)


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no number, 1 or more")
    return int(text)


def _shard(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)/(\d+)", text)
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        raise argparse.ArgumentTypeError(f"{text!r} is not K/N, such as 1/8 to 8/8")
    return int(match[1]), int(match[2])


def run(options: dict[str, Any], measure: Measure | None = None) -> int:
    """Run over the archive; 0 where all recordings of the share are done, 3 where some failed, 4 where some have no
    usable result and none failed, 130 on Ctrl-C.

    ``measure`` measures one recording, by default as `torchsphere.measure.measure`. Raises ValueError or OSError for an
    invalid manifest, output folder or engine.
    """
    with loading_libraries():
        from torchsphere.archive import folder, manifest

    # Workers on other machines have other working folders, hence absolute paths.
    sources, out = [source.absolute() for source in options["source"]], options["out"].absolute()
    if options["scheduler"] is not None and options["workers"] is not None:
        raise UsageError("--workers and --scheduler were both given; a scheduler has workers of its own, leave one out")
    with usage():
        common = _absolute(of_command(options, PER_RECORDING))
        check_settings(common)
    archive = manifest.read_all(sources, common, out)
    engine = _engine(options, any(item.settings.get("device") == "cuda" for item in archive.items), measure)
    claims = folder.prepare(out)
    if not options["quiet"]:
        notes = list(archive.notes)
        if not claims.are_supported():
            notes.append(f"{out}: its file system has no locks, so two runs at once would measure recordings twice.")
        for note in notes:
            print(f"torchsphere: {shown(note)}", file=sys.stderr)
    return _run(archive, out, engine, options)


def _run(archive: Archive, out: Path, engine: Engine, options: Mapping[str, Any]) -> int:
    from torchsphere.archive import run as archive_run
    from torchsphere.archive.folder import SUMMARIES

    shard, retry, quiet = options["shard"] or (1, 1), options["retry_failed"], options["quiet"]
    try:
        with progress_bar(quiet, "", "recording") as show:

            def changed(counts: Counts) -> None:
                if show is not None:
                    show(counts.total - counts.pending, counts.total, f"{counts.failed} failed")

            counts = archive_run.run(archive, out, engine, shard=shard, retry_failed=retry, changed=changed)
    except archive_run.Interrupted as stop:
        say(quiet, f"interrupted; {_counts_text(stop.counts)}; the same command goes on")
        return INTERRUPTED
    table = out / SUMMARIES[0]
    say(quiet, f"{_counts_text(counts)}; see {table}")
    for sentence in (
        *_named("failed", counts.failures, table),
        *_named("unusable", counts.without_motion, table),
        *_severe(counts, out, table),
        *_incomplete(counts),
    ):
        say(quiet, sentence)
    return SOME_FAILED if counts.failed else UNUSABLE if counts.unusable else DONE


def _counts_text(counts: Counts) -> str:
    pending = f", {counts.pending} pending" if counts.pending else ""
    unusable = f", {counts.unusable} unusable" if counts.unusable else ""
    severe = f" ({len(counts.severe)} of them with severe warnings)" if counts.severe else ""
    of = f"{counts.done} of {counts.total} recordings done{severe}{unusable}, {counts.failed} failed{pending}"
    return f"{of} ({counts.measured} measured in this run)"


def _named(state: str, reasons: Sequence[tuple[str, str]], table: Path) -> list[str]:
    """Sentences on the first recordings of a state with their reasons, and on the number of the others."""
    named = [f"{state}  {name}: {reason.removeprefix(f'{name}: ')}" for name, reason in reasons[:FAILURES_NAMED]]
    more = len(reasons) - len(named)
    return [*named, f"and {more} more; their reasons stand in {table}"] if more else named


def _severe(counts: Counts, out: Path, table: Path) -> list[str]:
    """Sentences on the first results in which numbers are wrong, and on the number of the others."""
    said = (
        f"done, {count} severe  {name}: numbers of it may be wrong; see the report in {out / result}"
        for name, result, count in counts.severe[:FAILURES_NAMED]
    )
    more = len(counts.severe) - FAILURES_NAMED
    return [*said, *([f"and {more} more; see the column severe_warnings of {table}"] if more > 0 else [])]


def _incomplete(counts: Counts) -> list[str]:
    """A sentence for each thing that results lack as nobody gave it."""
    reasons = Counter(reason for _, reason in counts.incomplete)
    return [f"{number} of those that are done: {reason}" for reason, number in reasons.items()]


def _absolute(common: Mapping[str, Any]) -> dict[str, Any]:
    """The settings with absolute paths of mask images."""
    from torchsphere.recording.ignore_mask import located

    if "ignore" not in common:
        return dict(common)
    return {**common, "ignore": located(common["ignore"], Path.cwd())}


def _engine(options: Mapping[str, Any], on_gpu: bool, measure: Measure | None) -> Engine:
    import torch

    from torchsphere.archive import dask_engine, processes

    if measure is None:
        from torchsphere.measure import measure as measure_one

        measure = measure_one
    if options["scheduler"] is not None:
        return functools.partial(dask_engine.run, address=options["scheduler"], measure=measure)
    if on_gpu and not torch.cuda.device_count():
        # Otherwise each recording would fail, and stay failed on a machine with a GPU.
        raise ValueError(
            "--device cuda was asked for, but torch finds no CUDA device here; leave it out to use the CPU"
        )
    workers = options["workers"]
    if workers is None:
        # Each process on a GPU takes memory of its own. A job scheduler may give fewer cores than there are.
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        workers = max(1, torch.cuda.device_count()) if on_gpu else cores
    return functools.partial(processes.run, workers=workers, measure=measure)
