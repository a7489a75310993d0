"""The directive ``commands``: a section per command, from its parser, so that no command and no option goes stale.

``.. commands:: torchsphere`` or ``.. commands:: torchsphere-render``.
"""

from __future__ import annotations

import argparse
import re
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from render import cli as render_cli
from torchsphere.cli import main

#: What a parser without groups of its own calls them.
PLAIN_GROUPS = ("positional arguments", "options")


def parsers(parser: argparse.ArgumentParser) -> list[argparse.ArgumentParser]:
    """The parser, or those of its commands, and theirs."""
    below = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    return [found for action in below for child in action.choices.values() for found in parsers(child)] or [parser]


def programs() -> dict[str, list[argparse.ArgumentParser]]:
    """The parsers of all commands, by the name that the directive takes."""
    renderer = "torchsphere-render"
    return {"torchsphere": parsers(main._parser()), renderer: parsers(render_cli._parser(renderer))}


class Commands(SphinxDirective):
    """Description, options by groups and example of each command."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """A section per command."""
        return [self._section(parser) for parser in programs()[self.arguments[0]]]

    def _section(self, parser: argparse.ArgumentParser) -> nodes.section:
        section = nodes.section(ids=[nodes.make_id(parser.prog)], names=[parser.prog])
        section += nodes.title(parser.prog, parser.prog)
        section += self.parse_text_to_nodes(StringList(lines(parser), source=f"parser of {parser.prog}"))
        return section


def lines(parser: argparse.ArgumentParser) -> list[str]:
    """The command as reStructuredText."""
    text = [_words(parser.description or ""), "", f".. program:: {parser.prog}", ""]
    for group in parser._action_groups:
        actions = [a for a in group._group_actions if not isinstance(a, argparse._HelpAction)]
        if actions and group.title not in PLAIN_GROUPS:
            text += [f".. rubric:: {_capital(group.title or '')}", "", _words(group.description or ""), ""]
        for action in actions:
            text += [f".. option:: {_signature(action)}", "", f"   {_help(action, parser.prog)}", ""]
    return [*text, *_examples(parser.epilog or "")]


def _signature(action: argparse.Action) -> str:
    value = action.metavar
    if value is None and action.choices is not None:
        value = "|".join(map(str, action.choices))
    names = [] if not action.option_strings else [action.option_strings[-1]]
    return " ".join(names if action.nargs == 0 else [*names, value or action.dest.upper()])


def _help(action: argparse.Action, program: str) -> str:
    text = _capital(_words((action.help or "") % {**vars(action), "prog": program}))
    return f"{text}. Needed." if action.required else f"{text}."


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _words(text: str) -> str:
    """Plain text as reStructuredText, with options and addresses as such."""
    escaped = re.sub(r"([\\*`|_])", r"\\\1", text)
    return re.sub(r"(?<![\w`])(--[a-z][a-z-]*|\w+://[\w.:]+\w)", r"``\1``", escaped)


def _examples(epilog: str) -> list[str]:
    """The commands of the epilog as a block, and what it says beside them as a paragraph."""
    commands, rest = [], []
    for part in re.split(r"\s{2,}", epilog.strip()):
        if part.startswith(("torchsphere ", "torchsphere-render ")):
            commands.append(f"   {part}")
        elif part not in ("", "or") and not part.endswith(":"):
            rest.append(_words(part))
    block = [".. code-block:: text", "", *commands, ""] if commands else []
    return [*block, *rest]


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directive."""
    app.add_directive("commands", Commands)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
