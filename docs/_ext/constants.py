"""The page of the constants, made from ``constants.toml`` before the pages are read. It stands outside the menu."""

from __future__ import annotations

import tomllib
from itertools import chain
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

START = """\
---
orphan: true
---

# Constants

The thresholds and fitted numbers of the program, one row each. In the code a constant has one line: its meaning and its
unit. The column "evidence" says what the value was measured on, or that it was chosen. The column "command" names the
command that measures it again, if there is one. This page is made from `docs/constants.toml`. A test compares its
values with the code, and finds constants of the code that refer to this file and are not in it.
"""


def page(packages: dict[str, dict[str, dict[str, str]]]) -> str:
    """The page as Markdown: a section per package, a row per constant."""
    sections = (_section(package, constants) for package, constants in packages.items())
    return START + "".join(f"{line}\n" for line in chain.from_iterable(sections))


def _section(package: str, constants: dict[str, dict[str, str]]) -> list[str]:
    heading = ["", f"## {package}", "", "| constant | value | unit | evidence | command |", "|---|---|---|---|---|"]
    return heading + [_row(name, constant) for name, constant in constants.items()]


def _row(name: str, constant: dict[str, str]) -> str:
    command = f"`{constant['command']}`" if "command" in constant else "-"
    cells = [name, constant["value"], constant["unit"], constant["evidence"], command]
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"


def write(app: Sphinx) -> None:
    """Write the page, if it has changed: Sphinx reads again what is newer."""
    source = Path(app.srcdir)
    text = page(tomllib.loads((source / "constants.toml").read_text(encoding="utf-8")))
    place = source / "constants.md"
    if not place.exists() or place.read_text(encoding="utf-8") != text:
        place.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, Any]:
    """Write the page before Sphinx looks for pages."""
    app.connect("builder-inited", write)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
