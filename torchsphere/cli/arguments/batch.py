"""Options of ``torchsphere batch``."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from torchsphere.archive import settings

HELP = "Measure an archive: all recordings of a folder or a manifest, one result folder each; only what is new."
EXAMPLE = "torchsphere batch shots --out results --diameter-mm 30 --mass-g 110 --workers 8"


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
    parser.set_defaults(command="batch")
    parser.add_argument("source", type=Path, metavar="MANIFEST_OR_FOLDER", help="manifest .csv, .toml, or a folder")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the results")
    parser.add_argument("--workers", type=_count, metavar="N", help="processes (one per core, or per GPU)")
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
        elif kind == "Sequence[str]":
            # Given twice, both hold, as of 'track'.
            common.add_argument(option, action="extend", type=_setting(name), metavar=name.upper())
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
