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
from typing import Any

import pytest

import torchsphere

REPOSITORY = Path(__file__).resolve().parents[2]
DOCS = REPOSITORY / "docs"
PACKAGE = Path(torchsphere.__file__).parent
#: By package and name (module.NAME). A constant that is there twice is no TOML.
CONSTANTS = tomllib.loads((DOCS / "constants.toml").read_text(encoding="utf-8"))
ROWS = [(package, name, row) for package, rows in CONSTANTS.items() for name, row in rows.items()]


#: Constants with neither a command that measures them nor a derivation. The number only falls: a new constant is
#: measured or derived, and whoever pays a debt lowers it.
DEBTS = 31
#: Sets of recordings that test the program: a constant that was chosen with a look at one of them is marked.
JUDGES = {"attack", "flights", "leaderboard", "model_precision"}
#: Options of these that measure a constant on seeds that judge no more; the suites of the leaderboard keep theirs.
SPENT = {"attack": "--spent", "flights": "--spent", "model_precision": "--pattern 10"}


def wrong(row: dict[str, Any]) -> str:
    """What is wrong with a row of the file, or nothing."""
    texts = {key: row[key] for key in row.keys() - {"debt", "judged_by"}}
    if not {"value", "unit"} <= set(texts) <= {"value", "unit", "evidence", "command", "derivation"}:
        return "it needs a value and a unit, and has no other key than those in the head of the file"
    if not all(isinstance(text, str) and text and text == " ".join(text.split()) for text in texts.values()):
        return "a text is empty, or has spaces beside those between words"
    if not set(row.get("judged_by", ())) <= JUDGES or row.get("judged_by") == []:
        return f"judged_by names sets of {sorted(JUDGES)}"
    judge = re.match(rf"python -m experiments\.validation\.({'|'.join(JUDGES)})\b", row.get("command", ""))
    if judge and judge[1] not in row.get("judged_by", ()):
        return f"its command is a set that judges: judged_by names {judge[1]}"
    if judge and judge[1] in SPENT and SPENT[judge[1]] not in row["command"]:
        return f"its command would spend the seeds that judge: add {SPENT[judge[1]]}, for those that are spent"
    if row.get("debt", True) is not True:
        return "a debt is true, or left out"
    measured, derived, owed = {"evidence", "command"} <= set(row), "derivation" in row, "debt" in row
    if owed and (measured or derived or "evidence" not in row):
        return "a debt has evidence, and neither a command nor a derivation"
    if not owed and row.get("evidence", "").startswith("Chosen"):
        return "what was chosen is a debt"
    if not (measured or derived or owed):
        return "it has neither evidence with a command nor a derivation: measure it, derive it, or remove it"
    return ""


def test_every_constant_is_measured_by_a_command_or_derived_or_listed_as_a_debt() -> None:
    assert len(ROWS) > 60
    assert {f"{package}.{name}": wrong(row) for package, name, row in ROWS if wrong(row)} == {}


def test_a_new_constant_with_neither_a_command_nor_a_derivation_is_refused() -> None:
    chosen = {"value": "1", "unit": "-", "evidence": "Chosen."}
    assert "what was chosen is a debt" in wrong(chosen)
    assert "neither evidence with a command nor a derivation" in wrong(chosen | {"evidence": "Errors of 1 px."})
    assert wrong(chosen | {"debt": True}) == ""
    assert wrong(chosen | {"evidence": "Errors of 1 px.", "command": "make test"}) == ""
    assert wrong({"value": "1", "unit": "-", "derivation": "One."}) == ""
    assert "a debt has evidence" in wrong(chosen | {"debt": True, "derivation": "One."})
    assert "what was chosen is a debt" in wrong(chosen | {"derivation": "One."})
    seen = {"evidence": "Errors of 1 px.", "command": "python -m experiments.validation.attack"}
    assert "judged_by names attack" in wrong(chosen | seen)
    assert "add --spent" in wrong(chosen | seen | {"judged_by": ["attack"]})
    seen["command"] += " --spent"
    assert wrong(chosen | seen | {"judged_by": ["attack"]}) == ""
    assert "judged_by" in wrong(chosen | {"debt": True, "judged_by": ["demo"]})


def test_what_half_and_twice_a_value_do_stands_in_the_table_of_each_constant_that_says_so() -> None:
    table = (DOCS / "tables" / "sensitivity.md").read_text(encoding="utf-8")
    told = dict(re.findall(r"^\| `(\S+)` \| (.+?) \| \d+ \| (?!open)", table, re.MULTILINE))
    named = {
        f"{package}.{name}": row["value"]
        for package, name, row in ROWS
        if row.get("command") == "python -m experiments.validation.sensitivity"
    }
    assert len(named) > 50
    assert told == named


def test_the_number_of_debts_does_not_grow() -> None:
    assert sum("debt" in row for _, _, row in ROWS) == DEBTS, "a debt more is refused; one less lowers DEBTS"


def test_every_command_names_an_experiment_or_a_test_that_exists() -> None:
    tests = "\n".join(path.read_text(encoding="utf-8") for path in (REPOSITORY / "tests").rglob("test_*.py"))
    missing = []
    for command in {row["command"] for _, _, row in ROWS if "command" in row}:
        module = re.match(r"python -m (experiments[.\w]+)", command)
        file = re.match(r"python -m pytest (\S+)", command)
        exists = (
            (REPOSITORY / f"{module[1].replace('.', '/')}.py").exists()
            if module
            else (REPOSITORY / file[1]).exists()
            if file
            else f"def {command}(" in tests or command.startswith("torchsphere ")
        )
        missing += [] if exists else [command]
    assert missing == []


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
        assert "evidence" not in row or f"\n  {row['evidence']}\n" in shown[package]
        assert "derivation" not in row or f"\n  Derived: {row['derivation']}\n" in shown[package]
    assert "docs/constants" not in "".join(shown.values())
    text = directive.debts(CONSTANTS)
    assert text.startswith(f"Of {len(ROWS)} constants ")
    assert text.endswith(f" The other {DEBTS} are debts.")
    assert (
        "`limits.DIAMETERS_MM` = `(0.5, 2000.0)` mm\n"
        ": Plausible diameters of a ball, mm.\n\n  Derived: From coarse shot for peening to a boulder. A diameter "
    ) in shown["settings"]


def test_the_page_is_made_of_the_file_and_stands_outside_the_menu() -> None:
    page = (DOCS / "constants.md").read_text(encoding="utf-8")
    assert page.startswith("---\norphan: true\n---\n")
    assert "```{constants} constants.toml\n" in page
    assert "\nconstants\n" not in (DOCS / "index.md").read_text(encoding="utf-8")
