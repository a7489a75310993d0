"""docs/constants.toml and the constants of the program: the same values, and a table for each that refers to it."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import math
import re
import tomllib
from pathlib import Path

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


def test_the_page_has_a_row_for_each_and_stands_outside_the_menu() -> None:
    pytest.importorskip("sphinx", reason="the pages need Sphinx (extra 'docs')")
    spec = importlib.util.spec_from_file_location("constants", DOCS / "_ext" / "constants.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    page = module.page({**CONSTANTS, "last": {"a.B": {"value": "1", "unit": "px", "evidence": "|x|", "command": "c"}}})
    assert page.startswith("---\norphan: true\n---\n")
    found = []
    for line in page.splitlines():
        if line.startswith("## "):
            package = line.removeprefix("## ")
        elif line.startswith("|") and not line.startswith(("| constant |", "|---|")):
            cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
            assert len(cells) == 5
            found.append((package, cells[0], cells[1]))
    assert found == [*((package, name, row["value"]) for package, name, row in ROWS), ("last", "a.B", "1")]
    assert page.endswith("| a.B | 1 | px | \\|x\\| | `c` |\n")
