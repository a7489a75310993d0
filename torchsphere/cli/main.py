"""The command line ``torchsphere``: its commands, exit codes and refusals.

The module of a command imports its libraries when the command runs, so that ``--help`` and refusals are fast.
"""

from __future__ import annotations

import argparse
import re
import sys
import textwrap
from collections.abc import Sequence
from typing import Any, NoReturn

from torchsphere import __version__
from torchsphere.cli import batch, benchmark, completion, demo, info, instruments, pick, plan, report, track, warm_up
from torchsphere.cli.console import told_steps
from torchsphere.cli.exit_codes import BAD_COMMAND, BAD_INPUT, DONE, INTERRUPTED, UsageError, sentence
from torchsphere.runtime import signals
from torchsphere.runtime.shown_text import shown
from torchsphere.settings.suggestion import did_you_mean


class _Parser(argparse.ArgumentParser):
    """A parser that reports bad options in one sentence, with exit code 2."""

    _words: Sequence[str] = ()

    def __init__(self, **about: Any) -> None:
        super().__init__(**{"formatter_class": HelpWithExamples, **about})

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse, and keep the words for a refusal."""
        self._words = sys.argv[1:] if args is None else args
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        if message.startswith("the following arguments are required"):
            message += self._first_unknown()
        if message.endswith("expected one argument"):
            # "--frames -5:" looks like two options.
            message += ", joined by '=' where it begins with '-' (--option=-5)"
        unknown = re.search(r"invalid choice: '(.+?)' \(choose from (.+)\)", message)
        if unknown:
            message += did_you_mean(unknown[1], re.findall(r"[\w.-]+", unknown[2]))
        self.exit(BAD_COMMAND, f"torchsphere: {shown(message)}; see '{self.prog} --help'\n")

    def _first_unknown(self) -> str:
        """The end of a refusal of what is missing: an option that is misspelt is often the one that is missing."""
        known = option_names(self)
        for word in self._words:
            name = word.partition("=")[0]
            if name.startswith("--") and len(name) > 2 and name not in known:
                return f"; {name} is not an option{did_you_mean(name, known)}"
        return ""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; the exit code is 0 only where the result was written."""
    parser = _parser()
    arguments = sys.argv[1:] if arguments is None else arguments
    if not arguments:
        parser.print_help()
        return DONE
    known, unknown = parser.parse_known_args(arguments)
    options = vars(known)
    run, name = options.pop("run"), " ".join(filter(None, (options.pop("command"), options.pop("action", None))))
    if unknown:
        _refuse(parser, name, unknown)
    quiet, verbose = (bool(options.get("quiet") or options.get("json")), bool(options.get("verbose")))
    try:
        with signals.sigterm_as_exception(), told_steps(quiet, verbose):
            return int(run(options))
    except UsageError as error:
        print(f"torchsphere: {shown(' '.join(str(error).split()))}", file=sys.stderr)
        return BAD_COMMAND
    except (ValueError, OSError) as error:
        print(f"torchsphere: {shown(sentence(error))}", file=sys.stderr)
    except ModuleNotFoundError as error:
        print(f"torchsphere: the package {error.name!r} is missing; install torchsphere again", file=sys.stderr)
    except KeyboardInterrupt:
        print("torchsphere: interrupted; nothing was written", file=sys.stderr)
        return INTERRUPTED
    return BAD_INPUT


def _refuse(parser: argparse.ArgumentParser, name: str, unknown: list[str]) -> NoReturn:
    """End with a sentence on the words that the command ``name`` does not know."""
    own = command_parser(parser, name)
    options = [word for word in unknown if word.startswith("-")]
    hint = did_you_mean(options[0], option_names(own)) if options else ""
    if not options and any(action.nargs == "+" for action in own._actions if not action.option_strings):
        hint = "; name all inputs one after the other, before the options"
    # argparse itself would name the help of the whole program.
    parser.prog += f" {name}"
    parser.error(f"unrecognized arguments: {' '.join(unknown)}{hint}")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="torchsphere",
        description="Motion of a speckled ball from high-speed footage.",
        epilog="first steps:  torchsphere demo   torchsphere info shot.cihx --preview ball.png   "
        "torchsphere track shot.cihx --out result   or on a page:  torchsphere pick shot.cihx",
    )
    parser.add_argument("--version", action="version", version=f"torchsphere {__version__}")
    commands = parser.add_subparsers(required=True, dest="command", metavar="COMMAND", parser_class=_Parser)
    for command in (demo, info, pick, track, batch, benchmark, plan, instruments, report, warm_up):
        command.add(commands)
    completion.add(commands, _parser)
    return parser


class HelpWithExamples(argparse.HelpFormatter):
    """Help in which each example, set off by two spaces or more, is a command to be copied, on lines of its own."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        lines = []
        for part in re.split(r"\s{2,}", text.strip()):
            if part.startswith("torchsphere "):
                # Room for the sign that a command goes on.
                lines_of = textwrap.TextWrapper(
                    width - 2, "  ", "      ", break_on_hyphens=False, break_long_words=False
                )
                lines.append(" \\\n".join(lines_of.wrap(part)))
            elif part != "or":
                lines.append(super()._fill_text(part, width, indent))
        return "\n".join(lines)


def option_names(parser: argparse.ArgumentParser) -> list[str]:
    """All options of a parser."""
    return [name for action in parser._actions for name in action.option_strings]


def command_parser(parser: argparse.ArgumentParser, name: str) -> argparse.ArgumentParser:
    """The parser of a command by its name, such as "benchmark run"."""
    for word in name.split():
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                parser = action.choices[word]
    return parser
