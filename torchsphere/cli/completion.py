"""The command ``torchsphere completion``: a script by which a shell completes commands, options and names of files."""

from __future__ import annotations

import argparse
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from torchsphere.cli.options import add_command

#: Shells that have a script, each with the file from which it reads completions at its start.
SHELLS = {
    "bash": "~/.local/share/bash-completion/completions/torchsphere",
    "zsh": "~/.zfunc/_torchsphere",
    "fish": "~/.config/fish/completions/torchsphere.fish",
}


def add(commands: Any, make_parser: Callable[[], argparse.ArgumentParser]) -> None:
    """Add the command to the parser; ``make_parser`` makes the whole parser that is to be completed."""
    text = "Print the script by which a shell completes commands, options and names of files."
    example = f"example:  torchsphere completion bash > {SHELLS['bash']}"
    parser = add_command(commands, "completion", functools.partial(run, make_parser=make_parser), text, example)
    parser.add_argument("shell", choices=tuple(SHELLS), metavar="SHELL", help=" or ".join(SHELLS))


def run(options: dict[str, Any], make_parser: Callable[[], argparse.ArgumentParser]) -> int:
    """Print the script."""
    print(script(make_parser(), options["shell"]))
    return 0


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """The script for a shell; arguments that are paths are completed by files."""
    import shtab

    _mark_paths(parser, shtab.FILE)
    return str(shtab.complete(parser, shell))


def _mark_paths(parser: argparse.ArgumentParser, files: Any) -> None:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in set(action.choices.values()):
                _mark_paths(below, files)
        elif action.type is Path:
            action.complete = files  # type: ignore[attr-defined]  # what shtab reads
