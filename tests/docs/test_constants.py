"""docs/constants.md and the constants of the program: the same values, and a row for each that refers to the page."""

from __future__ import annotations

import ast
import importlib
import math
import re
from pathlib import Path

import pytest

import torchsphere

PAGE = Path(__file__).resolve().parents[2] / "docs" / "constants.md"
PACKAGE = Path(torchsphere.__file__).parent


def rows() -> list[tuple[str, str, str]]:
    """Package, name (module.NAME) and value of each row."""
    found = []
    package = ""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            package = line.removeprefix("## ").strip()
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if package and len(cells) == 5 and cells[0] not in ("constant", "---"):
            found.append((package, cells[0].strip("`"), cells[1].strip("`")))
    return found


ROWS = rows()


def test_the_page_has_rows_and_none_is_there_twice() -> None:
    names = [(package, name) for package, name, _ in ROWS]
    assert len(names) > 60
    assert sorted(set(names)) == sorted(names)


@pytest.mark.parametrize(("package", "name", "value"), ROWS, ids=[f"{package}.{name}" for package, name, _ in ROWS])
def test_the_value_on_the_page_is_that_of_the_code(package: str, name: str, value: str) -> None:
    module, constant = name.rsplit(".", 1)
    actual = getattr(importlib.import_module(f"torchsphere.{package}.{module}"), constant)
    expected = ast.literal_eval(value)
    if isinstance(expected, int | float):
        assert math.isclose(actual, expected, rel_tol=1e-9)
    else:
        assert actual == expected


def test_every_constant_that_refers_to_the_page_has_a_row() -> None:
    known = {
        f"{package}/{name.rsplit('.', 1)[0].replace('.', '/')}.py:{name.rsplit('.', 1)[1]}" for package, name, _ in ROWS
    }
    referring = {
        f"{path.relative_to(PACKAGE).as_posix()}:{name}"
        for path in PACKAGE.rglob("*.py")
        for name in re.findall(
            r"docs/constants\.md.*\n(?:#.*\n)*(\w+)(?:: [^=]+)? = ", path.read_text(encoding="utf-8")
        )
    }
    assert referring - known == set()
