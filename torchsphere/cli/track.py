"""The command ``torchsphere track``: options and printed outcome."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchsphere.cli.console import progress_bar
from torchsphere.cli.options import add_command, add_out, add_quiet, add_settings, given_settings
from torchsphere.request import SETTINGS, Request, merged, read_config
from torchsphere.results import atomic_output
from torchsphere.runtime.imports import without_collections

if TYPE_CHECKING:
    from torchsphere.measure import Measurement

#: Exit code where the result was written, and too few frames were measured to use it.
UNUSABLE = 4


def add(commands: Any) -> None:
    """Add the command to the parser."""
    text = "Measure the motion of the ball in one recording."
    example = "example:  torchsphere track shot.cihx --out result --diameter-mm 30 --mass-g 110"
    parser = add_command(commands, "track", run, text, example)
    parser.add_argument("input", type=Path, metavar="INPUT", help="file or folder of images")
    add_out(parser)
    parser.add_argument(
        "--config", type=Path, metavar="FILE.toml", help="settings from a file, by the names of the options; these win"
    )
    add_quiet(parser)
    parser.add_argument("--json", action="store_true", help="print summary.json and nothing else")
    add_settings(parser, SETTINGS)


def measure_with_progress(
    request: Request, quiet: bool, extra: dict[str, Path] | None = None, name: str | None = None
) -> Measurement:
    """`torchsphere.measure.measure`, with a progress bar unless ``quiet``."""
    with without_collections():
        from torchsphere.measure import measure

    with progress_bar(quiet, "tracking", second_pass="on the map") as progress:
        return measure(request, progress, extra, name=name)


def run(options: dict[str, Any]) -> int:
    """Measure one recording and print the outcome; raises ValueError or OSError before anything is written."""
    from_file = {} if options["config"] is None else read_config(options["config"])
    settings = merged(from_file, given_settings(options, SETTINGS))
    quiet, out = options["quiet"] or options["json"], options["out"]
    atomic_output.recover(out)
    done = measure_with_progress(Request(input=options["input"], out=out, **settings), quiet)
    return _print_outcome(done, out, options)


def _print_outcome(done: Measurement, out: Path, options: dict[str, Any]) -> int:
    """Print what was asked for, and return the exit code."""
    from torchsphere.cli.outcome import in_red, outcome_lines
    from torchsphere.tracking.result import why_unusable

    reason = why_unusable(done.track.status)
    if reason:
        print(in_red(f"torchsphere: {reason}; the report in {out} says why"), file=sys.stderr)
    text = (out / "summary.json").read_text(encoding="utf-8")
    if options["json"]:
        print(text, end="")
    elif not options["quiet"]:
        print("\n".join(outcome_lines(json.loads(text), out)))
    return UNUSABLE if reason else 0
