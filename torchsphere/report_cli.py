"""The command ``torchsphere report``: draw figures and report again from a result folder alone."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from tqdm import tqdm

from torchsphere.report import index, overlay, paraview
from torchsphere.report.draw import draw
from torchsphere.report.folder import read

HELP = "Draw figures and report again from a result folder, or from a folder of results."
EXAMPLE = "torchsphere report result"


def add(commands: Any) -> None:
    """Add the command to those of ``torchsphere``."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "report", help=HELP, description=HELP, epilog=f"example:  {EXAMPLE}", allow_abbrev=False
    )
    parser.set_defaults(command=run)
    parser.add_argument("folder", type=Path, metavar="DIR", help="what 'track' or 'batch' wrote")
    parser.add_argument("--overlay", action="store_true", help="make overlay.mp4, too (extra 'video')")
    parser.add_argument("--paraview", action="store_true", help="make a series for ParaView, too")
    parser.add_argument("--quiet", action="store_true", help="no progress bar, no word where all is well")


def run(options: dict[str, Any]) -> int:
    """Run the command; a result that cannot be drawn is named, and the others are drawn all the same."""
    folder, quiet = options["folder"], options["quiet"]
    if not (folder / "summary.csv").is_file():
        _draw(folder, options)
        _say(quiet, f"report  {folder / 'report.html'}")
        return 0
    rows = index.read_rows(folder)
    wrong = []
    for row in tqdm(rows, unit="result", file=sys.stderr, leave=False, desc="drawing", disable=quiet):
        result = index.result_folder(folder, row)
        if result is None:
            continue
        try:
            _draw(result, options)
        except (ValueError, OSError) as error:
            wrong.append(f"{result}: {error}")
    index.write_index(folder, rows)
    _say(quiet, f"report  {folder / 'index.html'}")
    if wrong:
        raise ValueError(f"{len(wrong)} of {len(rows)} results could not be drawn; the first: {wrong[0]}")
    return 0


def _draw(folder: Path, options: dict[str, Any]) -> None:
    draw(folder)
    if options["overlay"]:
        overlay.write_overlay(read(folder))
    if options["paraview"]:
        paraview.write_paraview(read(folder))


def _say(quiet: bool, sentence: str) -> None:
    if not quiet:
        print(sentence)  # noqa: T201  (the command line)
