"""The command line ``torchsphere``: its commands, exit codes and refusals.

The module of a command imports its libraries when the command runs, so that ``--help`` and refusals are fast.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import NoReturn

from torchsphere import __version__
from torchsphere.cli import batch, benchmark, demo, info, instruments, plan, report, track, warm_up
from torchsphere.runtime import signals
from torchsphere.runtime.shown_text import shown
from torchsphere.settings.limits import SettingError


class _Parser(argparse.ArgumentParser):
    """A parser that reports bad options in one sentence, with exit code 2."""

    def error(self, message: str) -> NoReturn:
        if message.endswith("expected one argument"):
            # "--frames -5:" looks like two options.
            message += ", joined by '=' where it begins with '-' (--option=-5)"
        self.exit(2, f"torchsphere: {shown(message)}; see '{self.prog} --help'\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; the exit code is 0 only where the result was written."""
    parser = _parser()
    known, unknown = parser.parse_known_args(arguments)
    options = vars(known)
    run, name = options.pop("run"), " ".join(filter(None, (options.pop("command"), options.pop("action", None))))
    if unknown:
        # argparse itself would name the help of the whole program.
        parser.prog += f" {name}"
        parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    try:
        with signals.sigterm_as_exception():
            return int(run(options))
    except (ValueError, OSError) as error:
        print(f"torchsphere: {shown(_sentence(error))}", file=sys.stderr)
    except ModuleNotFoundError as error:
        print(f"torchsphere: the package {error.name!r} is missing; install torchsphere again", file=sys.stderr)
    except KeyboardInterrupt:
        print("torchsphere: interrupted; nothing was written", file=sys.stderr)
        return 130
    return 1


def _sentence(error: Exception) -> str:
    """The error in one line, with settings named as options, and with advice on errors of the system."""
    if isinstance(error, SettingError):
        return error.as_options()
    if isinstance(error, OSError) and error.strerror is not None:
        return f"{error.filename or 'file'}: {error.strerror.lower()}; check the name and the permissions"
    return " ".join(str(error).split())


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="torchsphere", description="Motion of a speckled ball from high-speed footage.")
    parser.add_argument("--version", action="version", version=f"torchsphere {__version__}")
    commands = parser.add_subparsers(required=True, dest="command", metavar="COMMAND", parser_class=_Parser)
    for command in (demo, info, track, batch, benchmark, plan, instruments, report, warm_up):
        command.add(commands)
    return parser
