"""The command ``torchsphere track``: options, one or several recordings, and the printed outcomes."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchsphere.cli.console import loading_libraries, progress_bar
from torchsphere.cli.exit_codes import DONE, SOME_FAILED, UNUSABLE, UsageError, sentence, usage
from torchsphere.cli.options import (
    add_command,
    add_config,
    add_out,
    add_quiet,
    add_settings,
    add_verbose,
)
from torchsphere.request import SETTINGS, Request
from torchsphere.results import atomic_output
from torchsphere.runtime.shown_text import shown
from torchsphere.settings.configuration import of_command

if TYPE_CHECKING:
    from torchsphere.measure import Measurement


def add(commands: Any) -> None:
    """Add the command to the parser."""
    text = "Measure the motion of the ball in one recording, or in several with the same settings."
    example = (
        "example:  torchsphere track shot.cihx --out result --diameter-mm 30 --mass-g 110   With several recordings "
        "each has its own folder in DIR, by its name; for many see 'torchsphere batch'."
    )
    parser = add_command(commands, "track", run, text, example)
    parser.add_argument("input", type=Path, nargs="+", metavar="INPUT", help="file or folder of images, or several")
    add_out(parser)
    add_config(parser, "track", SETTINGS, "settings from a file; options win over it")
    add_quiet(parser)
    add_verbose(parser)
    parser.add_argument("--json", action="store_true", help="print summary.json and nothing else")
    add_settings(parser, SETTINGS)


def measure_with_progress(
    request: Request, quiet: bool, extra: dict[str, Path] | None = None, name: str | None = None
) -> Measurement:
    """`torchsphere.measure.measure`, with a progress bar unless ``quiet``."""
    with loading_libraries():
        from torchsphere.measure import measure

    with progress_bar(quiet, "tracking", second_pass="on the map") as progress:
        return measure(request, progress, extra, name=name)


def run(options: dict[str, Any]) -> int:
    """Measure and print the outcome; one recording raises ValueError or OSError before anything is written."""
    with usage():
        settings = of_command(options, SETTINGS)
        inputs, out = options["input"], options["out"]
        folders = [out] if len(inputs) == 1 else _own_folders(inputs, out)
        requests = [Request(input=path, out=folder, **settings) for path, folder in zip(inputs, folders, strict=True)]
    if len(requests) == 1:
        return _run_one(requests[0], options)
    return _run_several(requests, options)


def _own_folders(inputs: Sequence[Path], out: Path) -> list[Path]:
    """A result folder for each of several recordings, by its name."""
    from torchsphere.recording.member import flat_name

    folders: dict[Path, Path] = {}
    for path in inputs:
        folder = out / (path.resolve().name if path.is_dir() else flat_name(path))
        if folder in folders:
            raise UsageError(
                f"{folders[folder]} and {path} would both be written to {folder}; rename one, or measure them with "
                "'torchsphere batch' and a manifest"
            )
        folders[folder] = path
    return list(folders)


def _run_one(request: Request, options: dict[str, Any]) -> int:
    atomic_output.recover(request.out)
    done = measure_with_progress(request, options["quiet"] or options["json"])
    code = _print_outcome(done, request.out, options)
    if options["json"]:
        print(_summary(request.out), end="")
    return code


def _run_several(requests: Sequence[Request], options: dict[str, Any]) -> int:
    """Measure one after the other: one that fails does not end the rest."""
    codes, summaries = [], []
    for number, request in enumerate(requests, 1):
        if not (options["quiet"] or options["json"]):
            print(f"{'' if number == 1 else chr(10)}{shown(str(request.input))} ({number} of {len(requests)})")
        try:
            atomic_output.recover(request.out)
            done = measure_with_progress(request, options["quiet"] or options["json"])
            codes.append(_print_outcome(done, request.out, options))
            summaries.append(json.loads(_summary(request.out)))
        except (ValueError, OSError) as error:
            print(f"torchsphere: {shown(sentence(error))}", file=sys.stderr)
            codes.append(SOME_FAILED)
    if options["json"]:
        print(json.dumps(summaries, indent=2, ensure_ascii=False))
    return SOME_FAILED if SOME_FAILED in codes else max(codes)


def _summary(out: Path) -> str:
    return (out / "summary.json").read_text(encoding="utf-8")


def _print_outcome(done: Measurement, out: Path, options: dict[str, Any]) -> int:
    """Print what was measured, and return the exit code."""
    from torchsphere.cli.outcome import in_red, outcome_lines
    from torchsphere.motion.track import why_unusable

    reason = why_unusable(done.track.status)
    if reason:
        print(in_red(shown(f"torchsphere: {reason}; summary.json in {out} says why"), sys.stderr), file=sys.stderr)
    if not (options["quiet"] or options["json"]):
        print("\n".join(map(shown, outcome_lines(json.loads(_summary(out)), out))))
    return UNUSABLE if reason else DONE
