"""The directive ``constants``: every constant of a file such as docs/constants.toml, with its meaning from the code."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.docutils import SphinxDirective

#: What the file says of a constant: texts, the flag ``debt`` and the list ``judged_by``.
Entry = dict[str, Any]


class Constants(SphinxDirective):
    """How many are debts, then a section per package: each constant with its meaning and where its value comes from."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The sentence on the debts and the sections, in the order of the file."""
        path = Path(self.env.srcdir) / self.arguments[0]
        self.env.note_dependency(str(path))
        found = packages(path)
        sections = [self._section(package, entries) for package, entries in found.items()]
        return [*self.parse_text_to_nodes(StringList([debts(found)], source=self.arguments[0])), *sections]

    def _section(self, package: str, entries: dict[str, Entry]) -> nodes.section:
        section = nodes.section(ids=[nodes.make_id(f"constants-{package}")], names=[f"constants-{package}"])
        section += nodes.title(package, package)
        section += self.parse_text_to_nodes(StringList(lines(package, entries), source=self.arguments[0]))
        return section


def packages(path: Path) -> dict[str, dict[str, Entry]]:
    """The entries of each package by ``module.NAME``; the head of the file says what an entry has."""
    return tomllib.loads(path.read_text(encoding="utf-8"))


def debts(found: dict[str, dict[str, Entry]]) -> str:
    """How many constants have neither a command nor a derivation, as a sentence."""
    entries = [entry for package in found.values() for entry in package.values()]
    derived, owed = (sum(key in entry for entry in entries) for key in ("derivation", "debt"))
    return (
        f"Of {len(entries)} constants {len(entries) - derived - owed} were measured and have a command, "
        f"and {derived} are derived. The other {owed} are debts."
    )


def lines(package: str, entries: dict[str, Entry]) -> list[str]:
    """The constants of a package as a list of definitions in Markdown."""
    text = []
    for name, entry in entries.items():
        unit = "" if entry["unit"] == "-" else f" {entry['unit']}"
        text += [f"`{name}` = `{entry['value']}`{unit}", f": {meaning(package, name)}"]
        text += ["", f"  {entry['evidence']}"] if "evidence" in entry else []
        text += ["", f"  Derived: {entry['derivation']}"] if "derivation" in entry else []
        text += ["", f"  Again: `{entry['command']}`"] if "command" in entry else []
        text += ["", f"  Chosen with a look at: {', '.join(entry['judged_by'])}."] if "judged_by" in entry else []
        text += ["", "  A debt."] if "debt" in entry else []
        text += [""]
    return text


def meaning(package: str, name: str) -> str:
    """What the line above a constant in the code says, without its reference to the evidence."""
    module, constant = name.rsplit(".", 1)
    found = ModuleAnalyzer.for_module(f"torchsphere.{package}.{module}").find_attr_docs()
    return re.sub(r" \(docs/constants\.toml[^)]*\)", "", " ".join(" ".join(found["", constant]).split()))


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directive."""
    app.add_directive("constants", Constants)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
