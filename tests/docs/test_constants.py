"""docs/constants.toml and the constants of the program: the same values, and a table for each that refers to it."""

from __future__ import annotations

import ast
import importlib
import math
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

import torchsphere

DOCS = Path(__file__).resolve().parents[2] / "docs"
PACKAGE = Path(torchsphere.__file__).parent
#: By package and name (module.NAME). A constant that is there twice is no TOML.
CONSTANTS = tomllib.loads((DOCS / "constants.toml").read_text(encoding="utf-8"))
ROWS = [(package, name, row) for package, rows in CONSTANTS.items() for name, row in rows.items()]


def test_every_constant_has_its_value_unit_and_evidence() -> None:
    assert len(ROWS) > 60
    for package, name, row in ROWS:
        known = {"value", "unit", "evidence", "command"}
        assert known - {"command"} <= set(row) <= known, f"{package}.{name}"
        assert all(text and text == " ".join(text.split()) for text in row.values()), f"{package}.{name}"


@pytest.mark.parametrize(("package", "name", "row"), ROWS, ids=[f"{package}.{name}" for package, name, _ in ROWS])
def test_the_value_in_the_file_is_that_of_the_code(package: str, name: str, row: dict[str, str]) -> None:
    module, constant = name.rsplit(".", 1)
    actual = getattr(importlib.import_module(f"torchsphere.{package}.{module}"), constant)
    expected = ast.literal_eval(row["value"])
    if isinstance(expected, int | float):
        assert math.isclose(actual, expected, rel_tol=1e-9)
    else:
        assert actual == expected


def test_every_constant_that_refers_to_the_file_is_there() -> None:
    known = {
        f"{package}/{name.rsplit('.', 1)[0].replace('.', '/')}.py:{name.rsplit('.', 1)[1]}" for package, name, _ in ROWS
    }
    referring = {
        f"{path.relative_to(PACKAGE).as_posix()}:{name}"
        for path in PACKAGE.rglob("*.py")
        for names in re.findall(
            r"docs/constants\.toml.*\n(?:#.*\n)*((?:\w+, )*\w+)(?:: [^=]+)? = ", path.read_text(encoding="utf-8")
        )
        for name in names.split(", ")
    }
    assert len(referring) > 400
    assert referring - known == set()


def test_the_page_shows_every_constant_with_the_meaning_that_the_code_states(
    extension: Callable[[str], ModuleType],
) -> None:
    directive = extension("constants")
    shown = {package: "\n".join(directive.lines(package, entries)) for package, entries in CONSTANTS.items()}
    for package, name, row in ROWS:
        assert f"\n`{name}` = `{row['value']}`" in f"\n{shown[package]}"
        assert f"\n  {row['evidence']}\n" in shown[package]
    assert "docs/constants" not in "".join(shown.values())
    assert (
        "`limits.DIAMETERS_MM` = `(0.5, 2000.0)` mm\n"
        ": Plausible diameters of a ball, mm.\n\n  Chosen: from coarse shot for peening to a boulder.\n"
    ) in shown["settings"]


def test_the_page_is_made_of_the_file_and_stands_outside_the_menu() -> None:
    page = (DOCS / "constants.md").read_text(encoding="utf-8")
    assert page.startswith("---\norphan: true\n---\n")
    assert "```{constants} constants.toml\n" in page
    assert "\nconstants\n" not in (DOCS / "index.md").read_text(encoding="utf-8")
