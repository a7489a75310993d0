"""The commands ``torchsphere benchmark make``, ``run``, ``score`` and ``table``."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

from tqdm import tqdm

from torchsphere.benchmark import folder, standing, table, trackers
from torchsphere.benchmark.folder import Benchmark
from torchsphere.benchmark.make import make
from torchsphere.benchmark.run import Outcome, folder_of, run
from torchsphere.benchmark.standing import Standing
from torchsphere.results.atomic_output import atomic_file

#: Exit code where a tracker failed on a suite; its other results are written.
SOME_FAILED = 3


def _make(options: dict[str, Any]) -> int:
    quiet = options["quiet"]
    with tqdm(unit="frame", file=sys.stderr, leave=False, desc="rendering", disable=quiet) as bar:

        def progress(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        try:
            made = make(
                options["suite"],
                options["size"],
                options["out"],
                overwrite=options["overwrite"],
                seed=options["seed"],
                progress=progress,
                workers=options["workers"],
            )
        except ModuleNotFoundError as error:
            # It says what to install; the command line would tell to install all of torchsphere again.
            raise ValueError(str(error)) from error
    _say(quiet, f"{len(made.suites)} suites of size {made.size}, {made.checksum}; in {options['out']}")
    return 0


def _run(options: dict[str, Any]) -> int:
    made, out, quiet = folder.read_benchmark(options["benchmark"]), options["out"], options["quiet"]
    asked = dict.fromkeys(options["tracker"] or ["torchsphere"])
    names = trackers.names() if "all" in asked else tuple(asked)
    entries = [trackers.resolve(name) for name in names]
    suites = _suites(made, options["suite"])
    truth = standing.truths(made.suite(name) for name in suites)
    with tqdm(total=len(entries) * len(suites), unit="run", file=sys.stderr, leave=False, disable=quiet) as bar:

        def started(tracker: str, suite: str) -> None:
            bar.set_description(f"{tracker} on {suite}")
            bar.update()

        try:
            outcomes = run(made, entries, out, suites=suites, keep=options["keep"], started=started)
        except KeyboardInterrupt:
            sentence = "interrupted; predictions that were made are kept, and the same command with --keep goes on"
            print(f"torchsphere: {sentence}", file=sys.stderr)
            return 130
    rows = [row for name in names for row in standing.standings(made, out / folder_of(name), name, truth)]
    standing.write(out / "scores.csv", [*standing.earlier(out / "scores.csv", made, rows), *rows])
    _tell(rows, quiet)
    kept, failed = sum(o.kept for o in outcomes), [o for o in outcomes if o.failed]
    _say(quiet, f"{len(outcomes) - kept} run, {kept} kept from before, {len(failed)} failed; see {out / 'scores.csv'}")
    return _failures(failed)


def _failures(failed: Sequence[Outcome]) -> int:
    """Exit code, and a sentence on stderr for each failure."""
    for outcome in failed:
        sentence = f"{outcome.tracker} failed on {outcome.suite}: {outcome.failed}"
        print(f"torchsphere: {sentence}", file=sys.stderr)
    return SOME_FAILED if failed else 0


def _score(options: dict[str, Any]) -> int:
    made, path, quiet = folder.read_benchmark(options["benchmark"]), options["predictions"], options["quiet"]
    if not path.exists():
        raise ValueError(f"{path}: does not exist; give a folder with SUITE.csv files, or one such file")
    name = options["name"] or (path.resolve().name if path.is_dir() else path.stem)
    if path.is_dir():
        truth = standing.truths(made.suite(suite) for suite in _suites(made, options["suite"]))
        rows = standing.standings(made, path, name, truth)
    else:
        asked = options["suite"] or [path.stem]
        if len(asked) != 1:
            raise ValueError(f"{path}: is the file of one suite, but {len(asked)} were given by --suite; give one")
        rows = [standing.of_file(made.suite(asked[0]), path, name)]
    if options["out"] is not None:
        standing.write(options["out"], rows)
    _tell(rows, quiet)
    return 0


def _table(options: dict[str, Any]) -> int:
    rows = [row for path in options["scores"] for row in standing.read(path)]
    text = "# Leaderboard\n\n" + table.markdown(table.board(rows))
    if options["out"] is None:
        print(text, end="")
    else:
        with atomic_file(options["out"]) as stream:
            stream.write(text)
    return 0


def _suites(made: Benchmark, asked: Sequence[str] | None) -> list[str]:
    """Names of the suites that were asked for, each once; ValueError for one that is not there."""
    return [made.suite(name).name for name in dict.fromkeys(asked)] if asked else [suite.name for suite in made]


def _tell(rows: Sequence[Standing], quiet: bool) -> None:
    """Print the table over all suites, and the notes on what was missing to stderr."""
    if quiet:
        return
    for row in rows:
        if row.notes:
            print(f"torchsphere: {row.tracker} on {row.suite}: {row.notes}", file=sys.stderr)
    print(table.summary(table.board(rows)), end="")


def _say(quiet: bool, sentence: str) -> None:
    if not quiet:
        print(sentence)


#: What ``torchsphere benchmark ACTION`` runs.
ACTIONS: dict[str, Callable[[dict[str, Any]], int]] = {
    "make": _make,
    "run": _run,
    "score": _score,
    "table": _table,
}
