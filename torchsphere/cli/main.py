"""The command line: which commands there are; what each takes is in ``arguments``, what it does in its own module."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from torchsphere import __version__
from torchsphere.cli.arguments import batch, benchmark, plan, report, track
from torchsphere.runtime import signals
from torchsphere.settings.limits import SettingError


class _Parser(argparse.ArgumentParser):
    """A parser that reports bad options as every other bad input: one sentence, exit code 2."""

    def error(self, message: str) -> NoReturn:
        if message.endswith("expected one argument"):
            # "--frames -5:" looks like two options.
            message += ", joined by '=' where it begins with '-' (--option=-5)"
        self.exit(2, f"torchsphere: {message}; see '{self.prog} --help'\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; the exit code is 0 only where the result was written."""
    parser = _parser()
    known, unknown = parser.parse_known_args(arguments)
    options = vars(known)
    name = options.pop("command")
    if unknown:
        # argparse itself would send the user to the list of commands.
        parser.prog += f" {name}"
        parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    try:
        with signals.in_order():
            return _command(name)(options)
    except (ValueError, OSError) as error:
        print(f"torchsphere: {_sentence(error)}", file=sys.stderr)
    except ModuleNotFoundError as error:
        print(f"torchsphere: the package {error.name!r} is missing; install torchsphere again", file=sys.stderr)
    except KeyboardInterrupt:
        print("torchsphere: interrupted; nothing was written", file=sys.stderr)
        return 130
    return 1


def _sentence(error: Exception) -> str:
    """The error in one line; the system's own errors lack the words for what to do, and settings are options here."""
    if isinstance(error, SettingError):
        return error.as_options()
    if isinstance(error, OSError) and error.strerror is not None:
        return f"{error.filename or 'file'}: {error.strerror.lower()}; check the name and the permissions"
    return " ".join(str(error).split())


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="torchsphere", description="Motion of a speckled ball from high-speed footage.")
    parser.add_argument("--version", action="version", version=f"torchsphere {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Parser)
    for of_commands in (track, batch, benchmark, plan, report):
        of_commands.add(commands)
    return parser


def _command(name: str) -> Callable[[dict[str, Any]], int]:
    """What runs the command, imported only now: ``--help`` waits for no library, and no command for another's."""
    match name.split():
        case ["track"]:
            from torchsphere.cli.track import run
        case ["demo"]:
            from torchsphere.cli.demo import run
        case ["info"]:
            from torchsphere.cli.info import run
        case ["batch"]:
            from torchsphere.cli.batch import command as run
        case ["plan"]:
            from torchsphere.cli.plan import run
        case ["report"]:
            from torchsphere.cli.report import run
        case ["benchmark", action]:
            from torchsphere.cli.benchmark import ACTIONS

            return ACTIONS[action]
    return run
