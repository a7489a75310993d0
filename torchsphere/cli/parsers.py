"""The parsers of the commands, and their options."""

from __future__ import annotations

import argparse
import re
import textwrap


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
