"""The pages in docs/: commands run and print as shown, and whatever the program has stands there.

That they build without a warning, every link included, is checked by ``make docs``, which ``make test`` runs first.
"""

import argparse
import csv
import json
import re
import runpy
import shlex
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from rendering import needs_mitsuba

import render.cli
import torchsphere
import torchsphere.cli.main
from torchsphere.archive.summary import COLUMNS
from torchsphere.correlation.frame_status import STATUSES
from torchsphere.request import SETTINGS
from torchsphere.results.reader import TRACK_COLUMNS
from torchsphere.runtime.steps import COMPILATION_TIME
from torchsphere.settings.configuration import read_config

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = sorted(DOCS.glob("*.md"))


def test_the_files_that_the_recipes_name_exist() -> None:
    text = (DOCS.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    named = re.findall(r"`((?:torchsphere|tests|experiments|docs)/[\w/]+\.\w+)`", text)
    assert len(named) > 15
    assert [name for name in named if "NAME" not in name and not (DOCS.parent / name).exists()] == []


def fenced(page: Path) -> list[tuple[str, str]]:
    """Language and text of each fenced block."""
    return re.findall(r"^```(\w+)\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def shape(text: str) -> list[str]:
    """What is printed, without its numbers and blanks: these differ a little between machines."""
    return [
        re.sub(r"\s+", " ", re.sub(r"[-+]?\d+(\.\d+)?(e[-+]\d+)?", "#", line)).strip() for line in text.splitlines()
    ]


def named_in(page: str) -> set[str]:
    """Everything that a page shows as code."""
    return set(re.findall(r"`([^`\n]+)`", (DOCS / page).read_text(encoding="utf-8")))


def run(command: str) -> None:
    """Run one command as the shell would, in this process: imports then cost their time once."""
    program, *arguments = shlex.split(command)
    if program == "torchsphere":
        assert torchsphere.cli.main.main([*arguments, "--quiet"] if arguments[0] == "report" else arguments) == 0
    elif program == "torchsphere-render":
        assert render.cli.main([*arguments, "--quiet"]) == 0
    else:
        assert program == "python"
        runpy.run_path(arguments[0])


@needs_mitsuba
def test_the_tutorial_runs_prints_what_it_shows_and_makes_what_is_explained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    blocks = fenced(DOCS / "tutorial.md")
    (program,) = (text for language, text in blocks if language == "python")
    Path("compare.py").write_text(program)
    shown = 0
    for (language, text), (kind, expected) in zip(blocks, [*blocks[1:], ("", "")], strict=True):
        if language != "bash":
            continue
        run(text)
        printed = capsys.readouterr().out
        if kind == "text" and not expected.startswith("torchsphere"):
            assert shape(printed) == shape(expected)
            shown += 1
    assert shown == 3

    explained = named_in("results.md")
    made = {path.relative_to("result").as_posix() for path in Path("result").rglob("*") if path.is_file()}
    assert {"track.csv", "kinematics.csv", "summary.json", "report.html", "paraview/ball.pvd"} <= made
    for name in made:
        number = re.sub(r"_\d{6}", "_NNNNNN", name)
        known = {number, Path(number).name, re.sub(r"\.(png|pdf)$", "", name), f"{Path(name).parent.name}/{number}"}
        assert known & explained, f"{name} is on no row of results.md"
    summary = json.loads(Path("result/summary.json").read_text())
    impact = set(summary["impact"])
    with Path("result/kinematics.csv").open() as stream:
        columns = {name for name in next(csv.reader(stream)) if not name.startswith("sd_")}
    with np.load("result/frames.npz") as arrays:
        kept = set(arrays)
    assert (set(summary) | impact | columns | kept) - explained == set()


def test_every_column_of_a_track_and_of_an_archive_is_explained() -> None:
    explained = named_in("results.md")
    assert set(TRACK_COLUMNS) - explained == set()
    assert {name for name in COLUMNS if not name.startswith("sd_")} - explained == set()


def test_every_status_has_its_section_and_says_what_to_do() -> None:
    sections = re.split(r"^## ", (DOCS / "status.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    found = {section.split("\n", 1)[0]: section for section in sections}
    assert list(found)[: len(STATUSES)] == list(STATUSES)
    assert all("**Means:**" in found[name] and "**Do:**" in found[name] for name in STATUSES[1:])


def test_every_public_name_of_the_package_is_on_the_page_for_python_and_exists() -> None:
    listed = re.findall(r"^\.\. auto(?:function|class):: (\S+)", (DOCS / "api.rst").read_text(), re.MULTILINE)
    assert {f"torchsphere.{name}" for name in torchsphere.__all__} - set(listed) == set()
    assert len(set(listed)) == len(listed)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_command_that_is_shown_is_one_that_the_program_understands(page: Path) -> None:
    for language, text in fenced(page):
        for line in text.splitlines() if language in ("bash", "text") else ():
            if line.startswith("torchsphere "):
                # What is not understood ends the program.
                words = shlex.split(line, comments=True)[1:]
                assert torchsphere.cli.main._parser().parse_args(words).command == words[0]
            elif line.startswith("torchsphere-render "):
                render.cli._parser().parse_args(shlex.split(line, comments=True)[1:])


def test_the_page_of_the_command_line_has_every_command_and_every_option(
    extension: Callable[[str], ModuleType],
) -> None:
    directive = extension("command_line")
    page = (DOCS / "command-line.rst").read_text(encoding="utf-8")
    programs = directive.programs()
    assert all(f".. commands:: {name}\n" in page for name in programs)
    top = torchsphere.cli.main._parser()
    (commands,) = (action for action in top._actions if isinstance(action, argparse._SubParsersAction))
    progs = {parser.prog for parsers in programs.values() for parser in parsers}
    assert all(any(prog.startswith(f"torchsphere {name}") for prog in progs) for name in commands.choices)
    for parser in (parser for parsers in programs.values() for parser in parsers):
        text = directive.lines(parser)
        for action in parser._actions:
            if not isinstance(action, argparse._HelpAction):
                name = action.option_strings[-1] if action.option_strings else str(action.metavar)
                assert any(re.fullmatch(rf"\.\. option:: {re.escape(name)}( .*)?", line) for line in text)


def test_the_options_of_the_file_that_is_shown_are_options(tmp_path: Path) -> None:
    page = (DOCS / "command-line.rst").read_text(encoding="utf-8")
    (block,) = re.findall(r"code-block:: toml\n\n((?:   .*\n)+)", page)
    (tmp_path / "shown.toml").write_text("\n".join(line[3:] for line in block.splitlines()))
    options = read_config(tmp_path / "shown.toml", SETTINGS)
    assert options["frames"] == (10, 90)
    assert options["circle"] == (80.4, 120.7, 50.0)


def test_the_manifests_that_are_shown_are_understood(tmp_path: Path) -> None:
    from torchsphere.archive import manifest

    blocks = fenced(DOCS / "archives.md")
    (table,) = (text for language, text in blocks if language == "text" and text.startswith("recording,"))
    (toml,) = (text for language, text in blocks if language == "toml")
    (tmp_path / "list.csv").write_text(table)
    (tmp_path / "list.toml").write_text(toml)
    first, second = manifest.read(tmp_path / "list.csv", {}, tmp_path / "out").items
    assert first.settings == {"fps": 36000.0, "circle": (80.4, 120.7, 50.0), "frames": (10, 90)}
    assert second.settings == {"fps": 36000.0}
    (only,) = manifest.read(tmp_path / "list.toml", {}, tmp_path / "out").items
    assert only.result == "day1/shot1-flight"


@pytest.mark.parametrize(
    "page",
    ["../README.md", "../CHANGELOG.md", "install.md", "archives.md", "tutorial.ipynb"],
    ids=lambda page: page[-12:],
)
def test_pages_and_program_name_one_time_for_the_first_compilation(page: str) -> None:
    """Wherever a page tells how long the loops are compiled."""
    times = r"about (?:a |half a |\w+ |[\d-]+ )(?:seconds|minutes?)\b"
    words = " ".join((DOCS / page).read_text(encoding="utf-8").split())
    told = re.findall(rf"\bcompile[sd]?\b[^.|]{{0,70}}?[ .]*(?:This takes |takes |for )({times})", words)
    told += re.findall(rf"({times}) more the very first time, when the loops over pixels are compiled", words)
    assert told
    assert set(told) == {COMPILATION_TIME}


def test_the_readme_is_read_in_one_sitting() -> None:
    text = (DOCS / "../README.md").read_text(encoding="utf-8")
    assert len(text.split()) <= 1100
    assert len(text.splitlines()) <= 120


def test_the_pages_pictures_are_small() -> None:
    sizes = {path.name: path.stat().st_size for path in (DOCS / "pictures").iterdir()}
    assert len(sizes) == 7
    assert max(sizes.values()) < 200_000
