"""The commands ``torchsphere benchmark make``, ``run``, ``score`` and ``table``."""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchsphere.cli.console import loading_libraries, print_lines, progress_bar, say
from torchsphere.cli.exit_codes import SOME_FAILED
from torchsphere.cli.options import add_command, add_out, add_quiet
from torchsphere.runtime.shown_text import shown
from torchsphere.settings.choices import SIZES, TRACKERS

if TYPE_CHECKING:
    from torchsphere.benchmark.folder import Benchmark
    from torchsphere.benchmark.score_rows import ScoreRow


def add(commands: Any) -> None:
    """Add the command to the parser."""
    text = "Measure a ball tracker, torchsphere or any other, against recordings with exact truth."
    parser = add_command(commands, "benchmark", _make, text, "docs/benchmark.md says what the files and scores mean.")
    actions = parser.add_subparsers(required=True, dest="action", metavar="ACTION", parser_class=type(parser))

    text = "Render the suites: images, truth, checksums (extra 'render')."
    parser = _add_action(actions, "make", _make, text, "--out bench --size smoke")
    add_out(parser, "folder for the benchmark")
    parser.add_argument("--size", choices=SIZES, default="standard", help="how many frames (%(default)s)")
    parser.add_argument("--suite", action="append", metavar="NAME", help="only this suite, or a suite's .toml (all)")
    parser.add_argument("--seed", type=int, metavar="N", help="other patterns, noise and backdrops (the suites' own)")
    parser.add_argument("--workers", type=int, metavar="N", help="processes that render at once (one per core)")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier benchmark")
    add_quiet(parser, "no progress, no closing sentence")

    text = "Run trackers on the suites and score them; exit code 3 where a tracker failed on a suite."
    parser = _add_action(actions, "run", _run, text, "bench --tracker torchsphere --tracker ecc --out mine")
    _add_benchmark(parser)
    trackers = f"{', '.join(TRACKERS)}, 'all' of these, or module:function; may be repeated (torchsphere)"
    parser.add_argument("--tracker", action="append", metavar="NAME", help=trackers)
    add_out(parser, "folder for predictions and scores.csv")
    parser.add_argument("--keep", action="store_true", help="do not run again what was run before on these images")

    text = "Score predictions that were made elsewhere: a folder with a SUITE.csv per suite, or one file with --suite."
    parser = _add_action(actions, "score", _score, text, "bench predictions --name mine --out mine.csv")
    _add_benchmark(parser)
    parser.add_argument("predictions", type=Path, metavar="PREDICTIONS", help="folder, or the file of one suite")
    parser.add_argument("--name", metavar="TEXT", help="what the tracker is called (the folder's or file's name)")
    parser.add_argument("--out", type=Path, metavar="FILE.csv", help="write the scores, for 'table'")

    text = "Join scores into a leaderboard in Markdown."
    parser = _add_action(actions, "table", _table, text, "scores.csv mine.csv --out LEADERBOARD.md")
    parser.add_argument("scores", type=Path, nargs="+", metavar="SCORES.csv", help="what 'run' or 'score' wrote")
    parser.add_argument("--out", type=Path, metavar="FILE.md", help="write it there instead of printing it")


def _add_action(actions: Any, name: str, run: Callable[[dict[str, Any]], int], text: str, example: str) -> Any:
    return add_command(actions, name, run, text, f"example:  torchsphere benchmark {name} {example}")


def _add_benchmark(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("benchmark", type=Path, metavar="DIR", help="what 'make' made")
    parser.add_argument("--suite", action="append", metavar="NAME", help="only this suite; may be repeated (all)")
    add_quiet(parser, "no progress, no table, no notes")


def _make(options: dict[str, Any]) -> int:
    from torchsphere.benchmark.make import make

    quiet = options["quiet"]
    with progress_bar(quiet, "rendering") as progress:
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
            # This error names the package to install; `main` would ask for all of torchsphere.
            raise ValueError(str(error)) from error
    say(quiet, f"{len(made.suites)} suites of size {made.size}, {made.checksum}; in {options['out']}")
    return 0


def _run(options: dict[str, Any]) -> int:
    with loading_libraries():
        from torchsphere.benchmark import score_rows, trackers
        from torchsphere.benchmark.folder import read_benchmark, read_footage
        from torchsphere.benchmark.run import folder_of, run

    made, out, quiet = read_benchmark(options["benchmark"]), options["out"], options["quiet"]
    asked = dict.fromkeys(options["tracker"] or ["torchsphere"])
    names = trackers.names() if "all" in asked else tuple(asked)
    entries = [trackers.resolve(name) for name in names]
    suites = _suites(made, options["suite"])
    truth = {name: read_footage(made.suite(name)).truth for name in suites}
    begun, total = itertools.count(), len(entries) * len(suites)
    with progress_bar(quiet, "running", "run") as show:

        def started(tracker: str, suite: str) -> None:
            if show is not None:
                show(next(begun), total, f"{tracker} on {suite}")

        try:
            outcomes = run(made, entries, out, suites=suites, keep=options["keep"], started=started)
        except KeyboardInterrupt:
            sentence = "interrupted; finished predictions are kept, and the same command with --keep goes on"
            print(f"torchsphere: {sentence}", file=sys.stderr)
            return 130
    rows = [row for name in names for row in score_rows.score_folder(made, out / folder_of(name), name, truth)]
    score_rows.write(out / "scores.csv", [*score_rows.read_earlier(out / "scores.csv", made, rows), *rows])
    _print_scores(rows, quiet)
    kept, failed = sum(o.kept for o in outcomes), [o for o in outcomes if o.failed]
    say(quiet, f"{len(outcomes) - kept} run, {kept} kept from before, {len(failed)} failed; see {out / 'scores.csv'}")
    for outcome in failed:
        sentence = f"torchsphere: {outcome.tracker} failed on {outcome.suite}: {outcome.failed}"
        print(shown(sentence), file=sys.stderr)
    return SOME_FAILED if failed else 0


def _score(options: dict[str, Any]) -> int:
    from torchsphere.benchmark import score_rows
    from torchsphere.benchmark.folder import read_benchmark, read_footage

    made, path, quiet = read_benchmark(options["benchmark"]), options["predictions"], options["quiet"]
    if not path.exists():
        raise ValueError(f"{path}: does not exist; give a folder with SUITE.csv files, or one such file")
    name = options["name"] or (path.resolve().name if path.is_dir() else path.stem)
    if path.is_dir():
        truth = {suite: read_footage(made.suite(suite)).truth for suite in _suites(made, options["suite"])}
        rows = score_rows.score_folder(made, path, name, truth)
    else:
        asked = options["suite"] or [path.stem]
        if len(asked) != 1:
            raise ValueError(f"{path}: is the file of one suite, but {len(asked)} were given by --suite; give one")
        rows = [score_rows.score_file(made.suite(asked[0]), path, name)]
    if options["out"] is not None:
        score_rows.write(options["out"], rows)
    _print_scores(rows, quiet)
    return 0


def _table(options: dict[str, Any]) -> int:
    from torchsphere.benchmark import leaderboard, score_rows
    from torchsphere.results.atomic_output import atomic_file

    rows = [row for path in options["scores"] for row in score_rows.read(path)]
    text = "# Leaderboard\n\n" + leaderboard.markdown(leaderboard.board(rows))
    if options["out"] is None:
        print_lines(text)
    else:
        with atomic_file(options["out"]) as stream:
            stream.write(text)
    return 0


def _suites(made: Benchmark, asked: Sequence[str] | None) -> list[str]:
    """Names of the requested suites, each once; ValueError for an unknown suite."""
    return [made.suite(name).name for name in dict.fromkeys(asked)] if asked else [suite.name for suite in made]


def _print_scores(rows: Sequence[ScoreRow], quiet: bool) -> None:
    """Print the table over all suites, and notes on missing predictions to stderr."""
    from torchsphere.benchmark import leaderboard

    if quiet:
        return
    for row in rows:
        if row.notes:
            print(shown(f"torchsphere: {row.tracker} on {row.suite}: {row.notes}"), file=sys.stderr)
    print_lines(leaderboard.summary(leaderboard.board(rows)))
