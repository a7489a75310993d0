"""The leaderboard as Markdown, from the scores of any number of trackers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from torchsphere.benchmark.score import CAP_DEG, CAP_PX, KINDS, LIMIT_DEG, LIMIT_PX
from torchsphere.benchmark.score_rows import MEANS, NOT_MEASURED, ScoreRow

#: torchsphere's own tracker, and the prefix of its other settings, which do not count as rivals.
OWN, VARIANTS = "torchsphere", "torchsphere-"

#: Titles of the four kinds of error.
TITLES = ("translation per frame (px)", "rotation per frame (deg)", "position (px)", "orientation (deg)")

#: Columns of the means over all suites after the errors; the columns of the second tuple may be "not stated".
_RATES = ("lost_percent", "silent_percent", "lost_rotation_percent", "drift_px_per_frame", "drift_deg_per_frame")
_SD_COLUMNS = ("sd_ratio_px", "sd_ratio_deg", "within_95_px_percent", "within_95_deg_percent")


@dataclass(frozen=True)
class Board:
    """Scores by tracker and suite: trackers from the best to the worst, suites in the order of the scores."""

    trackers: tuple[str, ...]
    suites: tuple[str, ...]
    rows: dict[tuple[str, str], ScoreRow]

    def values(self, tracker: str, name: str) -> list[float]:
        """One column over the suites with a score of the tracker."""
        return [self.rows[tracker, suite].values[name] for suite in self.suites if (tracker, suite) in self.rows]

    def points(self, tracker: str) -> float:
        """Mean over all suites, percent; a suite without a score counts 100."""
        known = self.values(tracker, "points_percent")
        return (sum(known) + 100.0 * (len(self.suites) - len(known))) / len(self.suites)

    def known_errors(self, trackers: Sequence[str], suite: str, k: int) -> dict[str, float]:
        """Mean errors of kind ``k`` by tracker, without NaN."""
        rows = {tracker: self.rows[tracker, suite] for tracker in trackers if (tracker, suite) in self.rows}
        errors = {tracker: row.values[MEANS[k]] for tracker, row in rows.items()}
        return {tracker: error for tracker, error in errors.items() if math.isfinite(error)}

    def rivals(self) -> list[str]:
        """The trackers without torchsphere and its variants."""
        return [tracker for tracker in self.trackers if not f"{tracker}-".startswith(VARIANTS)]


def board(rows: Sequence[ScoreRow]) -> Board:
    """Sort scores; ValueError for none, for a tracker twice on a suite, or for scores on different images."""
    if not rows:
        raise ValueError("there are no scores; give files that 'torchsphere benchmark score' wrote")
    found: dict[tuple[str, str], ScoreRow] = {}
    checksums: dict[str, ScoreRow] = {}
    for row in rows:
        first = checksums.setdefault(row.suite, row)
        if first.checksum != row.checksum:
            raise ValueError(
                f"suite {row.suite!r}: {first.tracker!r} and {row.tracker!r} were scored on different images; "
                "score both on one benchmark"
            )
        if (row.tracker, row.suite) in found:
            raise ValueError(f"suite {row.suite!r}: {row.tracker!r} is there twice; leave one out or rename it")
        found[row.tracker, row.suite] = row
    unsorted = Board(tuple(dict.fromkeys(row.tracker for row in rows)), tuple(checksums), found)
    return Board(tuple(sorted(unsorted.trackers, key=unsorted.points)), unsorted.suites, found)


def markdown(scores: Board) -> str:
    """All tables with their explanations."""
    parts = [_overall(scores)]
    if len(scores.trackers) > 1:
        parts.append(_leaders(scores))
    for k, title in enumerate(TITLES):
        cap = f"{KINDS[k][2]:g} {KINDS[k][1]}"
        parts.append(
            f"## {title[0].upper()}{title[1:]}\n\nMean error over the frames in which the ball is there; a lost frame "
            f"counts {cap}, and no error counts more.\n\n{_error_table(scores, k)}"
        )
    failures = _by_suite(scores, lambda row: f"{row.values['lost_percent']:.0f} / {row.values['silent_percent']:.0f}")
    parts.append(
        "## Frames lost / frames wrong without saying so (%)\n\nLost: the ball is there and no position is stated, or "
        f"one that the tracker itself doubts. Wrong without saying so: off by more than {LIMIT_PX:g} px or "
        f"{LIMIT_DEG:g} deg since frame 0, or a ball that is not there.\n\n{failures}"
    )
    parts.append(f"## Time (ms per pair)\n\n{_by_suite(scores, lambda row: _number(row.values['ms_per_pair']))}")
    return "\n\n".join(parts) + "\n"


def summary(scores: Board) -> str:
    """The table over all suites."""
    return _overall(scores) + "\n"


def _overall(scores: Board) -> str:
    heads = ["tracker", "score (%)", *TITLES, "lost (%)", "wrong, unsaid (%)", "rotation lost (%)"]
    heads += ["drift (px/frame)", "drift (deg/frame)", "error / stated sd, px", "deg", "within 95 %, px", "deg"]
    rows = []
    for tracker in scores.trackers:
        cells = [tracker, _number(scores.points(tracker))]
        cells += [_mean_error(scores, tracker, k) for k in range(len(KINDS))]
        cells += [_number(_mean(scores.values(tracker, name))) for name in _RATES]
        cells += [_number(_mean(scores.values(tracker, name)), "not stated") for name in _SD_COLUMNS]
        times = [v for v in scores.values(tracker, "ms_per_pair") if math.isfinite(v)]
        cells.append(_number(float(np.median(times)) if times else math.nan, "not stated"))
        rows.append(cells)
    return (
        "## All suites\n\nMeans over the suites, time the median. The score is the mean of the four errors, each over "
        f"its cap ({CAP_PX:g} px, {CAP_DEG:g} deg): 0 is perfect, 100 nothing measured; a suite that a tracker was not "
        "scored on counts 100.\n\n" + _table([*heads, "ms per pair"], rows)
    )


def _mean_error(scores: Board, tracker: str, k: int) -> str:
    """Mean error of kind ``k`` over all suites, the cap for suites without a score; or "not measured"."""
    rows = [scores.rows.get((tracker, suite)) for suite in scores.suites]
    if k in (1, 3) and all(row is None or row.rotation == NOT_MEASURED for row in rows):
        return NOT_MEASURED
    return _number(_mean([KINDS[k][2] if row is None else row.values[MEANS[k]] for row in rows]))


def _leaders(scores: Board) -> str:
    """The suites on which torchsphere does not lead its rivals; without torchsphere, the leader of each suite."""
    if OWN not in scores.trackers:
        lines = []
        for k, title in enumerate(TITLES):
            errors = {suite: scores.known_errors(scores.trackers, suite, k) for suite in scores.suites}
            leaders = (
                f"{suite} {min(found, key=found.__getitem__, default='nobody')}" for suite, found in errors.items()
            )
            lines.append(f"- {title}: " + ", ".join(leaders))
        return "## Leaders\n\n" + "\n".join(lines)
    variants = [OWN, *(tracker for tracker in scores.trackers if tracker.startswith(VARIANTS))]
    contests, behind = 0, []
    for suite in scores.suites:
        for k, title in enumerate(TITLES):
            own, rivals = (scores.known_errors(trackers, suite, k) for trackers in (variants, scores.rivals()))
            if not (OWN in own and rivals):
                continue
            contests += 1
            best = min(rivals, key=rivals.__getitem__)
            if rivals[best] < own[OWN]:
                settings = ", ".join(f"{tracker} {_number(error)}" for tracker, error in own.items())
                behind.append(f"- {suite}, {title}: {best} {_number(rivals[best])}, {settings}")
    text = f"## Where torchsphere leads\n\nIt is ahead of every rival in {contests - len(behind)} of {contests} errors"
    return text + (", and not in:\n\n" + "\n".join(behind) if behind else ".")


def _error_table(scores: Board, k: int) -> str:
    """The errors of kind ``k`` by suite, the lowest in bold."""

    def cell(row: ScoreRow) -> str:
        error = row.values[MEANS[k]]
        # A suite without a visible rotation has no rotation error, whatever the tracker measures.
        return NOT_MEASURED if row.rotation == NOT_MEASURED and k in (1, 3) and math.isfinite(error) else _number(error)

    return _by_suite(scores, cell, k)


def _by_suite(scores: Board, cell: Callable[[ScoreRow], str], best: int | None = None) -> str:
    """A row per suite, a column per tracker; the lowest error of kind ``best`` in bold."""
    lines = []
    for suite in scores.suites:
        rows = [scores.rows.get((tracker, suite)) for tracker in scores.trackers]
        cells = ["not run" if row is None else cell(row) for row in rows]
        if best is not None and len(rows) > 1:
            errors = [math.nan if row is None else row.values[MEANS[best]] for row in rows]
            lowest = min((error for error in errors if error < KINDS[best][2]), default=None)
            cells = [f"**{text}**" if error == lowest else text for text, error in zip(cells, errors, strict=True)]
        lines.append((suite, *cells))
    return _table(("suite", *scores.trackers), lines)


def _mean(values: Sequence[float]) -> float:
    known = [v for v in values if math.isfinite(v)]
    return sum(known) / len(known) if known else math.nan


def _number(value: float, missing: str = "-") -> str:
    """Two significant digits; ``missing`` for NaN."""
    if math.isnan(value):
        return missing
    return f"{value:.0f}" if abs(value) >= 100 else f"{float(f'{value:.2g}'):g}"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (heads, ["---"] * len(heads), *rows))
