"""The command ``torchsphere report``: draw figures and report again from a result folder alone, or compare results."""

from __future__ import annotations

import contextlib
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from torchsphere.cli.console import progress_bar, say
from torchsphere.cli.options import add_command, add_quiet
from torchsphere.runtime import steps


def add(commands: Any) -> None:
    """Add the command to the parser."""
    text = (
        "Draw figures and report again from a result folder, or from a folder of results; of several results, compare."
    )
    example = (
        "example:  torchsphere report result   to compare:  torchsphere report shot1 shot2 shot3 --out comparison.html"
    )
    parser = add_command(commands, "report", run, text, example)
    parser.add_argument(
        "folder",
        type=Path,
        nargs="+",
        metavar="DIR",
        help="what 'track' or 'batch' wrote; of several that 'track' wrote, a page compares the shots",
    )
    parser.add_argument("--out", type=Path, metavar="FILE.html", help="page of the comparison (comparison.html)")
    parser.add_argument("--overlay", action="store_true", help="make overlay.mp4, too (extra 'video')")
    parser.add_argument("--paraview", action="store_true", help="make a series for ParaView, too")
    add_quiet(parser, "no progress bar, no word where all is well")


def run(options: dict[str, Any]) -> int:
    """Draw one result or all results of a folder, or compare several results.

    Raises ValueError at the end if results could not be drawn. Results that cannot be compared are refused before
    anything is written.
    """
    folders = options["folder"]
    if len(folders) > 1:
        return _compare(folders, options)
    if options["out"] is not None:
        raise ValueError("--out names the page of a comparison, which takes two results or more; leave it out")
    return _draw_again(folders[0], options)


def _compare(folders: list[Path], options: dict[str, Any]) -> int:
    from torchsphere.report.comparison import PAGE, write_comparison

    for name in ("overlay", "paraview"):
        if options[name]:
            raise ValueError(f"--{name} is made of one result; give it with one folder alone")
    page = Path(PAGE) if options["out"] is None else options["out"]
    with _damage_named(*folders):
        say(options["quiet"], f"comparison  {write_comparison(folders, page)}")
    return 0


def _draw_again(folder: Path, options: dict[str, Any]) -> int:
    """Draw one result or all results of a folder."""
    from torchsphere.report import pages
    from torchsphere.results.reader import read

    quiet = options["quiet"]
    if not (folder / "summary.csv").is_file():
        with _damage_named(folder):
            # A damaged result is refused before anything is said or drawn.
            pages.report_html(read(folder))
        steps.tell("drawing %s", folder)
        _draw(folder, options)
        say(quiet, f"report  {folder / 'report.html'}")
        return 0
    rows = pages.read_rows(folder)
    failures = []
    with progress_bar(quiet, "drawing", "result") as show:
        for number, row in enumerate(rows):
            if show is not None:
                show(number, len(rows))
            result = pages.result_folder(folder, row)
            if result is None:
                continue
            try:
                _draw(result, options)
            except (ValueError, OSError) as error:
                failures.append(str(error) if str(error).startswith(str(result)) else f"{result}: {error}")
    pages.write_index(folder, rows)
    say(quiet, f"report  {folder / 'index.html'}")
    if failures:
        raise ValueError(f"{len(failures)} of {len(rows)} results could not be drawn; the first: {failures[0]}")
    return 0


@contextlib.contextmanager
def _damage_named(*folders: Path) -> Iterator[None]:
    """Turn the errors of damaged numbers of results within the block into one sentence."""
    import numpy as np

    where = str(folders[0]) if len(folders) == 1 else f"one of {len(folders)} results"

    try:
        # A damaged number may overflow, which NumPy would say in two lines of its own.
        with np.errstate(over="ignore", invalid="ignore"):
            yield
    except (ValueError, TypeError, AttributeError, LookupError, ArithmeticError, RecursionError) as error:
        if isinstance(error, ValueError) and str(error).startswith(tuple(map(str, folders))):
            # A sentence of this program names the result.
            raise
        # A file of the result holds a value of another type than this program writes; the place helps if it did not.
        frame = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(frame.filename).name}, line {frame.lineno}"
        why = f"{type(error).__name__}: {' '.join(str(error).split())[:160]}; {place}"
        raise ValueError(f"{where}: the result is damaged ({why}); track the recording again") from error


def _draw(folder: Path, options: dict[str, Any]) -> None:
    from torchsphere.report.draw import draw
    from torchsphere.results.reader import read

    with _damage_named(folder):
        # The report links to overlay and series, which are made first. These take torch, which loads in 1.5 s.
        if options["overlay"]:
            from torchsphere.report import overlay

            overlay.write_overlay(read(folder))
        if options["paraview"]:
            from torchsphere.report import paraview

            paraview.write_paraview(read(folder))
        draw(folder)
