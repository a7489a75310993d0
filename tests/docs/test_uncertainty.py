"""docs/uncertainty.md: its first section is short, and its figures are those of the table and of the tutorial."""

import re
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"
SECTION = re.split(r"^## ", (DOCS / "uncertainty.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1]
WORDS = " ".join(SECTION.split())


def test_the_page_begins_with_a_short_section_on_what_is_stated() -> None:
    assert SECTION.startswith("What ± means\n")
    assert len(SECTION.split()) <= 400


def test_the_shares_within_two_standard_deviations_are_those_of_the_table() -> None:
    lines = (DOCS / "tables" / "flights.md").read_text(encoding="utf-8").splitlines()
    names, *rows = ([cell.strip() for cell in line.split("|")[1:-1]] for line in lines if re.match(r"\|(?! ---)", line))
    shares = {row[0]: dict(zip(names, row, strict=True)) for row in rows}
    everywhere, lamp = shares["all"], shares["by the renderer, a lamp"]
    assert f"In [{everywhere['number']} simulated films]" in WORDS
    told = "for {velocity} of the velocities, {force} of the forces and {spin} of the spins."
    assert told.format(**everywhere) in WORDS
    place = "place in image"
    assert f"The place in the image has {everywhere[place]}, and the least under a lamp: {lamp[place]}." in WORDS
    percents = [int(cell.removesuffix(" %")) for row in rows for cell in row if cell.endswith(" %")]
    assert min(percents) == int(lamp[place].removesuffix(" %"))


def test_the_example_is_that_of_the_tutorial() -> None:
    printed = " ".join((DOCS / "tutorial.md").read_text(encoding="utf-8").split())
    speed, spin = re.findall(r"`([\d.]+ ± [\d.]+ \S+)`", WORDS)
    assert f"speed before {speed}" in printed
    assert f"spin before {spin}" in printed
    radius_sd = float(re.search(r"radius ± ([\d.]+) px", printed)[1])
    radius = float(re.search(r"circle [\d.]+,[\d.]+,([\d.]+) px", printed)[1])
    relative = radius_sd / radius
    share = f"{100 * relative:.2f} %"
    assert f"the radius is known to {share}" in WORDS
    value, _, sd, _ = speed.split()
    assert f"{share} of {float(value):.0f} m/s is {relative * float(value):.2f} m/s, most of the ±" in WORDS
    assert relative * float(value) > 0.5**0.5 * float(sd)
