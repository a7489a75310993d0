"""The leaderboard as Markdown, from the scores of any number of trackers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from torchsphere.benchmark.score import CAP_DEG, CAP_PX, KINDS, LIMIT_DEG, LIMIT_PX
from torchsphere.benchmark.standing import MEANS, NOT_MEASURED, Standing

#: Whose lead the table tells, and how the names of its other settings begin: they are no rivals.
OWN, VARIANTS = "torchsphere", "torchsphere-"

#: What the four errors are called in the text.
TITLES = ("translation per frame (px)", "rotation per frame (deg)", "position (px)", "orientation (deg)")

Cell = Callable[[Standing], str]


@dataclass(frozen=True)
class Board:
    """Scores by tracker and suite, trackers from the best to the worst, suites in the order they came in."""

    trackers: tuple[str, ...]
    suites: tuple[str, ...]
    rows: dict[tuple[str, str], Standing]

    def values(self, tracker: str, name: str) -> list[float]:
        """One column over the suites that the tracker was scored on, in their order."""
        return [self.rows[tracker, suite].values[name] for suite in self.suites if (tracker, suite) in self.rows]

    def points(self, tracker: str) -> float:
        """Mean over all suites, percent; a suite that it was not scored on counts as nothing measured."""
        known = self.values(tracker, "points_percent")
        return (sum(known) + 100.0 * (len(self.suites) - len(known))) / len(self.suites)


def board(rows: Sequence[Standing]) -> Board:
    """Sort scores into a board.

    Raises
    ------
    ValueError
        If there are none, a tracker is there twice on a suite, or a suite's scores are of different images.
    """
    if not rows:
        raise ValueError("there are no scores; give files that 'torchsphere benchmark score' wrote")
    found: dict[tuple[str, str], Standing] = {}
    checksums: dict[str, Standing] = {}
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
    """All tables, with what they mean, best trackers first."""
    parts = [_overall(scores)]
    if len(scores.trackers) > 1:
        parts.append(_leads(scores))
    for k, title in enumerate(TITLES):
        cap = f"{KINDS[k][2]:g} {KINDS[k][1]}"
        parts.append(
            f"## {title[0].upper()}{title[1:]}\n\nMean error over the frames in which the ball is there; a lost frame "
            f"counts {cap}, and no error counts more.\n\n{_by_suite(scores, _mean(k), k)}"
        )
    parts.append(
        "## Frames lost / frames wrong without saying so (%)\n\nLost: the ball is there and no position is stated, or "
        f"one that the tracker itself doubts. Wrong without saying so: off by more than {LIMIT_PX:g} px or "
        f"{LIMIT_DEG:g} deg since frame 0, or a ball that is not there.\n\n{_by_suite(scores, _failures)}"
    )
    parts.append(f"## Time (ms per pair)\n\n{_by_suite(scores, lambda row: _number(row.values['ms_per_pair']))}")
    return "\n\n".join(parts) + "\n"


def summary(scores: Board) -> str:
    """The table over all suites alone."""
    return _overall(scores) + "\n"


def _overall(scores: Board) -> str:
    heads = ["tracker", "score (%)", *TITLES, "lost (%)", "wrong, unsaid (%)", "rotation lost (%)"]
    heads += ["drift (px/frame)", "drift (deg/frame)", "error / stated sd, px", "deg", "within 95 %, px", "deg"]
    heads.append("ms per pair")
    lines = [_line(heads), _line(["---"] * len(heads))]
    for tracker in scores.trackers:
        cells = [tracker, _number(scores.points(tracker))]
        cells += [_mean_or_cap(scores, tracker, k) for k in range(len(KINDS))]
        cells += [
            _number(_mean_of(scores.values(tracker, name)))
            for name in ("lost_percent", "silent_percent", "lost_rotation_percent")
        ]
        cells += [_number(_mean_of(scores.values(tracker, f"drift_{unit}_per_frame"))) for unit in ("px", "deg")]
        cells += [_number(_mean_of(scores.values(tracker, f"sd_ratio_{unit}")), "not stated") for unit in ("px", "deg")]
        cells += [
            _number(_mean_of(scores.values(tracker, f"within_95_{unit}_percent")), "not stated")
            for unit in ("px", "deg")
        ]
        times = [v for v in scores.values(tracker, "ms_per_pair") if math.isfinite(v)]
        cells.append(_number(float(np.median(times)) if times else math.nan, "not stated"))
        lines.append(_line(cells))
    return (
        "## All suites\n\nMeans over the suites, time the median. The score is the mean of the four errors, each over "
        f"its cap ({CAP_PX:g} px, {CAP_DEG:g} deg): 0 is perfect, 100 nothing measured; a suite that a tracker was not "
        "scored on counts 100.\n\n" + "\n".join(lines)
    )


def _mean_or_cap(scores: Board, tracker: str, k: int) -> str:
    """A mean error over all suites, with those not scored at the cap; or that a rotation is not measured."""
    rows = [scores.rows.get((tracker, suite)) for suite in scores.suites]
    if k in (1, 3) and all(row is None or row.rotation == NOT_MEASURED for row in rows):
        return NOT_MEASURED
    return _number(_mean_of([KINDS[k][2] if row is None else row.values[MEANS[k]] for row in rows]))


def _leads(scores: Board) -> str:
    """Where torchsphere leads its rivals, and by name where it does not."""
    if OWN not in scores.trackers:
        return "## Leaders\n\n" + "\n".join(
            f"- {title}: " + ", ".join(f"{suite} {_leader(scores, suite, k)}" for suite in scores.suites)
            for k, title in enumerate(TITLES)
        )
    contests, behind = 0, []
    for suite in scores.suites:
        for k, title in enumerate(TITLES):
            own = _error(scores, OWN, suite, k)
            rivals = {t: _error(scores, t, suite, k) for t in scores.trackers if not f"{t}-".startswith(VARIANTS)}
            rivals = {t: error for t, error in rivals.items() if math.isfinite(error)}
            if not (math.isfinite(own) and rivals):
                continue
            contests += 1
            best = min(rivals, key=lambda t: rivals[t])
            if rivals[best] < own:
                behind.append(f"- {suite}, {title}: {best} {_number(rivals[best])}, {_settings(scores, suite, k)}")
    text = f"## Where torchsphere leads\n\nIt is ahead of every rival in {contests - len(behind)} of {contests} errors"
    return text + (", and not in:\n\n" + "\n".join(behind) if behind else ".")


def _settings(scores: Board, suite: str, k: int) -> str:
    """What torchsphere's own settings reach, the default first."""
    own = (OWN, *(tracker for tracker in scores.trackers if tracker.startswith(VARIANTS)))
    errors = {tracker: _error(scores, tracker, suite, k) for tracker in own}
    return ", ".join(f"{tracker} {_number(error)}" for tracker, error in errors.items() if math.isfinite(error))


def _leader(scores: Board, suite: str, k: int) -> str:
    errors = {t: _error(scores, t, suite, k) for t in scores.trackers}
    known = {t: error for t, error in errors.items() if math.isfinite(error)}
    return min(known, key=lambda t: known[t]) if known else "nobody"


def _error(scores: Board, tracker: str, suite: str, k: int) -> float:
    row = scores.rows.get((tracker, suite))
    return math.nan if row is None else row.values[MEANS[k]]


def _by_suite(scores: Board, cell: Cell, best: int | None = None) -> str:
    """A row per suite, a column per tracker; the lowest of the errors number ``best`` in bold."""
    lines = [_line(("suite", *scores.trackers)), _line(["---"] * (1 + len(scores.trackers)))]
    for suite in scores.suites:
        rows = [scores.rows.get((tracker, suite)) for tracker in scores.trackers]
        cells = ["not run" if row is None else cell(row) for row in rows]
        if best is not None and len(rows) > 1:
            errors = [math.nan if row is None else row.values[MEANS[best]] for row in rows]
            lowest = min((error for error in errors if error < KINDS[best][2]), default=None)
            cells = [f"**{text}**" if error == lowest else text for text, error in zip(cells, errors, strict=True)]
        lines.append(_line((suite, *cells)))
    return "\n".join(lines)


def _mean(k: int) -> Cell:
    def cell(row: Standing) -> str:
        error = row.values[MEANS[k]]
        # Where nobody can see the ball turn there is no error, whoever measures rotations elsewhere.
        return NOT_MEASURED if row.rotation == NOT_MEASURED and k in (1, 3) and math.isfinite(error) else _number(error)

    return cell


def _failures(row: Standing) -> str:
    return f"{row.values['lost_percent']:.0f} / {row.values['silent_percent']:.0f}"


def _mean_of(values: Sequence[float]) -> float:
    known = [v for v in values if math.isfinite(v)]
    return sum(known) / len(known) if known else math.nan


def _number(value: float, missing: str = "-") -> str:
    """Two significant digits; ``missing`` where there is none."""
    if math.isnan(value):
        return missing
    return f"{value:.0f}" if abs(value) >= 100 else f"{float(f'{value:.2g}'):g}"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
