"""The command ``torchsphere track``: options and printed outcome."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchsphere.cli.console import progress_bar
from torchsphere.cli.options import add_command, add_out, add_quiet, add_settings, given_settings
from torchsphere.request import SETTINGS, Request, merged, read_config
from torchsphere.runtime.imports import without_collections

if TYPE_CHECKING:
    from torchsphere.measure import Measurement
    from torchsphere.tracking.track import Track


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
    done = measure_with_progress(Request(input=options["input"], out=options["out"], **settings), options["quiet"])
    if not options["quiet"]:
        _print_outcome(done, options["out"])
    return 0


def status_text(tracked: Track) -> str:
    """Numbers of all frames and of frames per status."""
    from torchsphere.tracking.result import status_counts

    counts = ", ".join(f"{count} {name}" for name, count in status_counts(tracked).items())
    return f"{len(tracked.status)} frames: {counts}"


def _print_outcome(done: Measurement, out: Path) -> None:
    circle = done.track.circle
    print(status_text(done.track))
    print(f"circle  {circle.text()} px in frame {done.first_frame + circle.frame}")
    for sentence in done.warnings:
        print(f"note    {sentence}")
    print(f"result  {out}")
