"""Options of ``torchsphere report``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

HELP = "Draw figures and report again from a result folder, or from a folder of results."
EXAMPLE = "torchsphere report result"


def add(commands: Any) -> None:
    """Add the command to those of ``torchsphere``."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "report", help=HELP, description=HELP, epilog=f"example:  {EXAMPLE}", allow_abbrev=False
    )
    parser.set_defaults(command="report")
    parser.add_argument("folder", type=Path, metavar="DIR", help="what 'track' or 'batch' wrote")
    parser.add_argument("--overlay", action="store_true", help="make overlay.mp4, too (extra 'video')")
    parser.add_argument("--paraview", action="store_true", help="make a series for ParaView, too")
    parser.add_argument("--quiet", action="store_true", help="no progress bar, no word where all is well")
