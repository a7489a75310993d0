"""Scores of all trackers on the benchmark: ``python -m experiments.validation.leaderboard``.

Claim: torchsphere has the smallest error of translation and rotation, per frame and since the first frame, on every
suite of the benchmark; LEADERBOARD.md lists the exceptions. All trackers of the package run with the best settings
that were found for them (`torchsphere.benchmark.baselines`). muDIC (`field_method`) is scored if its predictions exist:
it needs an environment of its own.

    python -m experiments.validation.leaderboard [--benchmark DIR] [--field DIR] [--own]

writes LEADERBOARD.md, a CSV, and a figure. A missing benchmark of the standard size is made in ``experiments/cache``
(five minutes on two cores). The trackers take about half an hour on one core. Predictions are kept in the cache by the
images' checksum; delete them after a change to the package. ``--own`` runs torchsphere alone: the scores of the others
on the same images stay as they are in the CSV.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

import torchsphere
from experiments.experiment import CACHE, DOCS, HERE, publish, saved_figure
from torchsphere.benchmark import leaderboard, score_rows, trackers
from torchsphere.benchmark.folder import Benchmark, read_benchmark, read_footage
from torchsphere.benchmark.leaderboard import Board
from torchsphere.benchmark.make import make
from torchsphere.benchmark.run import run
from torchsphere.benchmark.score import KINDS

PAGE, SCORES, FIGURE = HERE / "LEADERBOARD.md", HERE / "leaderboard.csv", DOCS / "leaderboard.png"
FIELD = "mudic"
FIELD_SETTINGS = (
    "muDIC 0.2.1 (a displacement field of linear elements of 10 px), then the motion of a sphere: "
    "experiments/validation/field_method.py"
)
COMMANDS = """torchsphere benchmark make --out experiments/cache/benchmark-standard --size standard
python experiments/validation/field_method.py experiments/cache/benchmark-standard experiments/cache/mudic  # with muDIC
python -m experiments.validation.leaderboard"""

#: Other field methods, and the reasons to leave them out.
NOT_HERE = """Of the field methods muDIC stands for the others: it installs with numpy, numba and scikit-image, and
runs. sun-dic and al-dic come with a graphical toolkit each (PyQt6 and ray, PySide6), pyvale with both that and a mesh
viewer, OpenCorr is on no package index; they were not tried."""


def benchmark(folder: Path) -> Benchmark:
    """The benchmark in the folder, made if it is missing."""
    if not folder.exists():
        print(f"rendering {folder}", file=sys.stderr, flush=True)
        make(None, "standard", folder)
    return read_benchmark(folder)


def compute(made: Benchmark, field: Path, own: bool) -> list[score_rows.ScoreRow]:
    """Scores of every tracker on every suite; predictions are kept in the cache.

    Of all but our ``own`` trackers, if these alone are to run, the scores of the CSV on the same images.
    """
    # Predictions hold the checksum of their images, so that those of other images do not count.
    out = CACHE / f"predictions-{torchsphere.__version__}-{made.size}"
    names = [name for name in trackers.names() if not own or name.startswith(leaderboard.OWN)]
    entries = [trackers.resolve(name) for name in names]

    def started(tracker: str, suite: str) -> None:
        print(f"{suite}: {tracker}", file=sys.stderr, flush=True)

    for outcome in run(made, entries, out, keep=True, started=started):
        if outcome.failed:
            print(f"{outcome.tracker} failed on {outcome.suite}: {outcome.failed}", file=sys.stderr, flush=True)
    truth = {suite.name: read_footage(suite).truth for suite in made}
    rows = [row for entry in entries for row in score_rows.score_folder(made, out / entry.name, entry.name, truth)]
    rows += score_rows.score_folder(made, field, FIELD, truth) if field.is_dir() else []
    return score_rows.read_earlier(SCORES, made, rows) + rows if own else rows


def page(made: Benchmark, scores: Board) -> str:
    """The text of LEADERBOARD.md."""
    settings = {entry.name: entry.settings for entry in map(trackers.resolve, trackers.names())}
    settings[FIELD] = FIELD_SETTINGS
    suites = "\n".join(
        f"| {suite.name} | {suite.title} | {suite.frames} | {suite.width} x {suite.height} |" for suite in made
    )
    notes = [f"- {row.tracker}, {row.suite}: {row.notes}" for row in scores.rows.values() if row.notes]
    unsaid = [note for note in notes if "has no line" not in note]
    frames, lines = sum(suite.frames for suite in made), [f"- **{name}**: {settings[name]}" for name in scores.trackers]
    parts = (
        f"""# Leaderboard

The benchmark's size `{made.size}`, {frames} frames in {len(made.suites)} suites, checksum
`{made.checksum}`.
What the scores mean and how to enter a tracker: [docs/benchmark.md](../docs/benchmark.md). All numbers:
[{SCORES.name}]({SCORES.name}). Made by:

```
{COMMANDS}
```

![errors by suite](../docs/{FIGURE.name})

Some constants of torchsphere were chosen with a look at these suites, whose seeds are published. `torchsphere benchmark
make --seed N` makes the same suites with patterns that no constant has seen.
""",
        leaderboard.markdown(scores),
        f"""## Suites

| suite | what is hard | frames | size (px) |
| --- | --- | --- | --- |
{suites}

## Trackers and their settings

All were given the true outline in frame 0. The baselines' settings are the best of those tried on a ball of 50 px with
speckle of 4 px (their modules in `benchmark/baselines` tell which), and the same on every suite. A camera, where a
suite has one, can be told to torchsphere alone.
""",
        "\n".join(lines) + "\n",
        NOT_HERE + "\n\nTimes are wall times on one core of a shared machine, to compare and not to quote.\n",
        *(["## Notes\n\n" + "\n".join(unsaid) + "\n"] if unsaid else []),
    )
    return "\n".join(parts)


def plot(scores: Board) -> None:
    """The four errors by suite, a mark for each tracker that measures the quantity."""
    with saved_figure(FIGURE, (14, 9.5)) as figure:
        axes = figure.subplots(2, 2, sharex=True)
        rivals = scores.rivals()
        shown = [name for name in (leaderboard.OWN, "torchsphere-map") if name in scores.trackers] + rivals
        place = np.arange(len(scores.suites))
        for k, (axis, title, mean) in enumerate(zip(axes.T.flat, leaderboard.TITLES, score_rows.MEANS, strict=True)):
            for at, name in enumerate(shown):
                rows = [scores.rows.get((name, suite)) for suite in scores.suites]
                hidden = [row is None or (k in (1, 3) and row.rotation != score_rows.MEASURED) for row in rows]
                values = [np.nan if hide else row.values[mean] for hide, row in zip(hidden, rows, strict=True)]
                # torchsphere in the middle of its suite, the rivals beside it.
                own = name not in rivals
                offset = 0.0 if own else 0.8 * (rivals.index(name) / max(len(rivals) - 1, 1) - 0.5)
                style = {"marker": "o", "ms": 7} if own else {"marker": "sD^v<>PX*h"[at % 10], "ms": 5}
                axis.plot(
                    place + offset,
                    values,
                    ls="",
                    color=f"C{at}" if at < 10 else "k",
                    label=name,
                    zorder=3 if own else 2,
                    **style,
                )
            axis.axhline(KINDS[k][2], color="0.6", lw=0.8)
            for left in place[::2]:
                axis.axvspan(left - 0.5, left + 0.5, color="0.95", lw=0, zorder=0)
            axis.set(
                yscale="log", title=f"{title}: mean error, lost frames at the cap (line)", xlim=(-0.5, len(place) - 0.5)
            )
            axis.set_xticks(place, scores.suites, rotation=60, ha="right", fontsize=8)
            axis.grid(visible=False, axis="x")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=6, fontsize=9)


def main() -> None:
    """Run, score, and write page, CSV and figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--benchmark", type=Path, default=CACHE / "benchmark-standard", help="what 'make' made")
    parser.add_argument(
        "--field", type=Path, default=CACHE / FIELD, help="predictions of experiments/validation/field_method.py"
    )
    parser.add_argument("--own", action="store_true", help="torchsphere alone, the others as they are in the CSV")
    options = parser.parse_args()
    made = benchmark(options.benchmark)
    rows = compute(made, options.field, options.own)
    scores = leaderboard.board(rows)
    score_rows.write(SCORES, rows)
    plot(scores)
    PAGE.write_text(page(made, scores), encoding="utf-8")
    publish("leaderboard", "validation.leaderboard", leaderboard.summary(scores))


if __name__ == "__main__":
    main()
