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


class Constants(SphinxDirective):
    """A section per package: name, value and unit of each constant, meaning, evidence and command."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The sections, in the order of the file."""
        path = Path(self.env.srcdir) / self.arguments[0]
        self.env.note_dependency(str(path))
        return [self._section(package, entries) for package, entries in packages(path).items()]

    def _section(self, package: str, entries: dict[str, dict[str, str]]) -> nodes.section:
        section = nodes.section(ids=[nodes.make_id(f"constants-{package}")], names=[f"constants-{package}"])
        section += nodes.title(package, package)
        section += self.parse_text_to_nodes(StringList(lines(package, entries), source=self.arguments[0]))
        return section


def packages(path: Path) -> dict[str, dict[str, dict[str, str]]]:
    """The entries of each package by ``module.NAME``: value, unit, evidence and command."""
    return tomllib.loads(path.read_text(encoding="utf-8"))


def lines(package: str, entries: dict[str, dict[str, str]]) -> list[str]:
    """The constants of a package as a list of definitions in Markdown."""
    text = []
    for name, entry in entries.items():
        unit = "" if entry["unit"] == "-" else f" {entry['unit']}"
        text += [f"`{name}` = `{entry['value']}`{unit}", f": {meaning(package, name)}"]
        text += ["", f"  {entry['evidence']}"]
        text += ["", f"  Again: `{entry['command']}`"] if "command" in entry else []
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
