"""Options of ``torchsphere benchmark``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from torchsphere.settings import choices

HELP = "Measure a ball tracker, torchsphere or any other, against recordings with exact truth."


def add(commands: Any) -> None:
    """Add the command to those of ``torchsphere``."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "benchmark", help=HELP, description=HELP, epilog="docs/benchmark.md says what the files and scores mean."
    )
    actions = parser.add_subparsers(required=True, metavar="ACTION", parser_class=type(parser))
    _add_make(actions)
    _add_run(actions)
    _add_score(actions)
    _add_table(actions)


def _action(actions: Any, name: str, text: str, example: str) -> Any:
    parser = actions.add_parser(
        name, help=text, description=text, epilog=f"example:  torchsphere benchmark {example}", allow_abbrev=False
    )
    parser.set_defaults(command=f"benchmark {name}")
    return parser


def _add_make(actions: Any) -> None:
    text = "Render the suites: images, truth, checksums (extra 'render')."
    parser = _action(actions, "make", text, "make --out bench --size smoke")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the benchmark")
    parser.add_argument("--size", choices=choices.SIZES, default="standard", help="how many frames (%(default)s)")
    parser.add_argument("--suite", action="append", metavar="NAME", help="only this suite, or a suite's .toml (all)")
    parser.add_argument("--seed", type=int, metavar="N", help="other patterns, noise and backdrops (the suites' own)")
    parser.add_argument("--workers", type=int, metavar="N", help="processes that render at once (one per core)")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier benchmark")
    parser.add_argument("--quiet", action="store_true", help="no progress, no closing sentence")


def _add_run(actions: Any) -> None:
    text = "Run trackers on the suites and score them; exit code 3 where a tracker failed on a suite."
    parser = _action(actions, "run", text, "run bench --tracker torchsphere --tracker ecc --out mine")
    _add_folder(parser)
    parser.add_argument(
        "--tracker",
        action="append",
        metavar="NAME",
        help=f"{', '.join(choices.TRACKERS)}, 'all' of these, or module:function; may be repeated (torchsphere)",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for predictions and scores.csv")
    parser.add_argument("--keep", action="store_true", help="do not run again what was run before on these images")


def _add_score(actions: Any) -> None:
    text = "Score predictions that were made elsewhere: a folder with a SUITE.csv per suite, or one file with --suite."
    parser = _action(actions, "score", text, "score bench predictions --name mine --out mine.csv")
    _add_folder(parser)
    parser.add_argument("predictions", type=Path, metavar="PREDICTIONS", help="folder, or the file of one suite")
    parser.add_argument("--name", metavar="TEXT", help="what the tracker is called (the folder's or file's name)")
    parser.add_argument("--out", type=Path, metavar="FILE.csv", help="write the scores, for 'table'")


def _add_table(actions: Any) -> None:
    text = "Join scores into a leaderboard in Markdown."
    parser = _action(actions, "table", text, "table scores.csv mine.csv --out LEADERBOARD.md")
    parser.add_argument("scores", type=Path, nargs="+", metavar="SCORES.csv", help="what 'run' or 'score' wrote")
    parser.add_argument("--out", type=Path, metavar="FILE.md", help="write it there instead of printing it")


def _add_folder(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("benchmark", type=Path, metavar="DIR", help="what 'make' made")
    parser.add_argument("--suite", action="append", metavar="NAME", help="only this suite; may be repeated (all)")
    parser.add_argument("--quiet", action="store_true", help="no progress, no table, no notes")
