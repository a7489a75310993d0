"""Every experiment of the paper, and what became of each claim: ``python -m experiments.paper.all [name ...]``.

Runs the experiments one after the other, shows which, and writes ``experiments/RESULTS.md``: a row for each claim, the
paper's number beside ours, and whether the claim holds. What was measured stays in ``experiments/cache``, so that a
second run takes seconds; the times in RESULTS.md are those of the run that measured. With names, only these are run and
only their rows are printed.

An experiment that fails does not stop the others: it gets a row that says why, and the exit status is 1.
"""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from experiments.experiment import CACHE, FIGURES, HERE, Row, claims, table

OUT = HERE / "RESULTS.md"

#: In the paper's order.
NAMES = (
    *("fig02", "fig03", "table1", "fig04", "fig05", "table2", "fig06"),
    *("table3", "fig08", "fig09", "fig11", "table4", "fig10", "fig12", "rigid_ball", "flattening"),
    *("table5", "fig13", "fig14", "fig15", "run_time"),
)

#: Figures of the paper that claim nothing that could be measured.
WITHOUT = {
    "fig01": "a drawing of the five printed modes; `experiments.validation.basis` measures them",
    "fig07": "a photograph of the test on the bar; its geometry is that of the preset `paper-bar`",
}

HEAD = """# The paper's figures and tables, reproduced

Written by `python -m experiments.paper.all`; do not edit. Each claim of J.-C. Passieux, P. Navarro and J.-N. Périé, "A
digital image correlation method for tracking planar motions of rigid spheres: application to medium velocity impacts",
with its number and ours. Where the paper used a real shot, a rendered one of the same geometry takes its place, whose
motion is known exactly: "true" and "off" refer to that. How each was done is at the top of
`experiments/paper/<name>.py`.

"""


def run(name: str) -> list[Row]:
    """Measure and draw one experiment, and return its rows; a failed one returns a single row that says why."""
    try:
        module = importlib.import_module(f"experiments.paper.{name}")
        found = module.compute()
        if hasattr(module, "plot"):
            module.plot(found)
        return list(module.rows(found))
    except Exception as error:  # the others still run; the row and the exit status tell
        return [failed(name, error)]


def failed(name: str, error: Exception) -> Row:
    """The row of an experiment that could not be run."""
    return Row(name, "The experiment runs.", "-", f"failed: {type(error).__name__}: {error}", False)


def gallery(names: Iterable[str], folder: Path) -> str:
    """The existing figures as Markdown, with paths from the parent of their folder."""
    shown = [name for name in names if (folder / f"{name}.png").exists()]
    return "".join(f"\n## {name}\n\n![{name}]({folder.name}/{name}.png)\n" for name in shown)


def count(rows: Sequence[Row]) -> str:
    """How many claims hold, in one sentence."""
    of_paper = [row for row in rows if not row.other_condition]
    verdicts = [row.verdict for row in of_paper]
    parts = [f"{verdicts.count('yes')} of {len(of_paper)} claims hold"]
    if undecided := verdicts.count("undecided"):
        parts.append(f"too close to the limit to say: {undecided}")
    if remarks := len(rows) - len(of_paper):
        parts.append(f"rows of another condition than the paper's: {remarks}")
    return "; ".join(parts) + "."


def kept_times(seconds: Mapping[str, float]) -> dict[str, float]:
    """The longest time of each experiment, s, of these and of the runs whose results are in the cache."""
    path = CACHE / "times.json"
    before = json.loads(path.read_text()) if path.exists() else {}
    longest = {name: max(now, before.get(name, 0.0)) for name, now in seconds.items()}
    CACHE.mkdir(exist_ok=True)
    path.write_text(json.dumps(before | longest))
    return longest


def times_table(seconds: Mapping[str, float]) -> str:
    """The times as Markdown."""
    rows = [(name, f"{one:.0f}") for name, one in {**seconds, "all": sum(seconds.values())}.items()]
    return "\n## Time to make\n\nFrom an empty cache, on two cores.\n\n" + table(("experiment", "s"), rows)


def page(rows: Sequence[Row], folder: Path, seconds: Mapping[str, float]) -> str:
    """The text of RESULTS.md."""
    without = "".join(f"\n`{name}` has no row: {reason}.\n" for name, reason in WITHOUT.items())
    shown = gallery(dict.fromkeys(row.experiment for row in rows), folder)
    return HEAD + f"{count(rows)}\n\n" + claims(rows) + without + times_table(seconds) + shown


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the experiments; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m experiments.paper.all", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("names", nargs="*", metavar="name", help=f"of {', '.join(NAMES)}; all by default")
    names = parser.parse_args(arguments).names
    if unknown := [name for name in names if name not in NAMES]:
        parser.error(f"{unknown[0]!r} is no experiment of the paper; expected one of {', '.join(NAMES)}")
    rows, seconds, chosen = [], {}, tuple(names) or NAMES
    for i, name in enumerate(chosen):
        print(f"[{i + 1}/{len(chosen)}] {name} ...", file=sys.stderr, flush=True)
        start = time.perf_counter()
        rows += run(name)
        seconds[name] = time.perf_counter() - start
        print(f"[{i + 1}/{len(chosen)}] {name}: {seconds[name]:.0f} s", file=sys.stderr, flush=True)
    print(f"{sum(seconds.values()):.0f} s in all", file=sys.stderr)
    if names:
        print(claims(rows), end="")
    else:
        OUT.write_text(page(rows, FIGURES, kept_times(seconds)), encoding="utf-8")
        print(f"{OUT}: {count(rows)}")
    return int(any(row.ours.startswith("failed: ") for row in rows))


if __name__ == "__main__":
    sys.exit(main())
