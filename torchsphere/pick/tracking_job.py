"""One measurement in the background: poses while frames are done, a way to stop, and the outcome."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.correlation.frame_status import STATUSES
from torchsphere.geometry.orientation import chain, quaternions
from torchsphere.measure import Measurement, measure
from torchsphere.motion.track import Track, why_unusable
from torchsphere.pick.refusal import sentence_of
from torchsphere.report import explanations
from torchsphere.request import Request
from torchsphere.results.reader import read
from torchsphere.runtime.arrays import Array
from torchsphere.runtime.warning_levels import CAUTION, SEVERE
from torchsphere.tracking.record import Record

#: States of a job.
RUNNING, DONE, FAILED, STOPPED = "running", "done", "failed", "stopped"

#: What a job does, as a page says it.
FINDING, FOLLOWING, ON_MAP, FINISHING = (
    "Finding the ball and its outline",
    "Following the ball",
    "Measuring all frames on the map of the ball",
    "Finishing, and writing the result",
)


class _Stopped(Exception):  # noqa: N818  (no error)
    """The measurement was asked to stop."""


@dataclass(frozen=True)
class Poses:
    """Rows of m frames as a page plots and draws them; NaN where not measured."""

    position: Array  # (m, 2), px
    radius: Array  # (m,), px
    quaternion: Array  # (m, 4) as (w, x, y, z)
    turned_deg: Array  # (m, 3), angles turned since the first frame
    zncc: Array  # (m,)
    status: NDArray[np.str_]  # (m,)

    def rows(self) -> list[list[float | int | None]]:
        """A list of numbers per frame; None for NaN, the status by its place in `STATUSES`."""
        numbers = np.column_stack((self.position, self.radius, self.quaternion, self.turned_deg, self.zncc))
        known = np.isfinite(numbers)
        return [
            [*(float(f"{v:.7g}") if is_known else None for v, is_known in zip(row, there, strict=True)), code]
            for row, there, code in zip(numbers.tolist(), known.tolist(), map(STATUSES.index, self.status), strict=True)
        ]


def poses_of(track: Track) -> Poses:
    """The poses of a finished track."""
    n = len(track.status)
    turned = np.full((n, 3), np.nan)
    known = np.isfinite(track.position[:, 0])
    first = int(known.argmax())
    turned[first], turned[first + 1 :] = 0.0, track.increment[first:, 2:].cumsum(0)
    return Poses(
        track.position, track.radius, quaternions(track.orientation), np.degrees(turned), track.zncc, track.status
    )


class LivePoses:
    """Rows of the frames that are done, from the record that is being filled; starts again where a pass does."""

    def __init__(self) -> None:
        self.rows: list[list[float | int | None]] = []
        self._begin()

    def _begin(self) -> None:
        self.rows = []
        self._matrix, self._turned = np.eye(3), np.zeros(3)
        self._seen = False

    def take(self, record: Record, done: int) -> bool:
        """Add the frames up to ``done``; True where the rows start again."""
        again = done <= len(self.rows)
        if again:
            self._begin()
        part = slice(len(self.rows), done)
        known = np.isfinite(record.position[part, 0])
        steps = np.where(known[:, None], record.rotation[part], 0.0)
        if not self._seen and known.any():
            # No rotation leads to the first frame with the ball.
            steps[: known.argmax() + 1], self._seen = 0.0, True
        matrices = chain(np.concatenate((np.zeros((1, 3)), steps)), np.ones(len(steps) + 1, dtype=bool))[1:]
        matrices = matrices @ self._matrix
        turned = self._turned + steps.cumsum(0)
        self._matrix, self._turned = matrices[-1].copy(), turned[-1].copy()
        hidden = ~known
        matrices[hidden], turned[hidden] = np.nan, np.nan
        poses = Poses(
            record.position[part],
            record.size[part],
            quaternions(matrices),
            np.degrees(turned),
            record.zncc[part],
            record.status[part],
        )
        self.rows += poses.rows()
        return again


@dataclass(frozen=True)
class Outcome:
    """How a finished measurement came out, in words."""

    verdict: str
    grade: str  # "good", "part" or "bad", as in the report
    warnings: int
    has_report: bool


class TrackingJob:
    """A measurement in a thread of its own."""

    def __init__(self, request: Request, first_frame: int, run: Callable[..., Measurement] = measure) -> None:
        """Prepare the measurement of ``request``; ``first_frame`` is its first frame in the recording."""
        self.request, self.first_frame, self._run = request, first_frame, run
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._measure, name="torchsphere-pick-track")
        self._live, self._version = LivePoses(), 0
        self._state, self._phase, self._progress, self._follows = RUNNING, FINDING, (0, 0), False
        self._sentence, self._outcome = "", Outcome("", "", 0, False)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """Ask the measurement to stop; it does so at the next frames, and nothing is written."""
        self._stop.set()

    def wait(self, timeout_s: float | None = None) -> None:
        """Wait until the measurement has ended."""
        if self._thread.ident is not None:
            self._thread.join(timeout_s)

    @property
    def is_running(self) -> bool:
        """Whether the measurement goes on."""
        with self._lock:
            return self._state == RUNNING

    @property
    def folder(self) -> Path | None:
        """The result folder, once it is written."""
        with self._lock:
            return self.request.out if self._state == DONE else None

    def snapshot(self, version: int = -1, since: int = 0) -> dict[str, Any]:
        """State and rows for a page, which has the first ``since`` rows of ``version`` already."""
        with self._lock:
            start = min(since, len(self._live.rows)) if version == self._version else 0
            done, total = self._progress
            return {
                "state": self._state,
                "phase": "Stopping" if self._stop.is_set() and self._state == RUNNING else self._phase,
                "done": done,
                "total": total,
                "version": self._version,
                "start": start,
                "rows": self._live.rows[start:],
                "firstFrame": self.first_frame,
                "sentence": self._sentence,
                "verdict": self._outcome.verdict,
                "grade": self._outcome.grade,
                "warnings": self._outcome.warnings,
                "hasReport": self._outcome.has_report,
                "folder": str(self.request.out.absolute()),
            }

    def _measure(self) -> None:
        try:
            done = self._run(self.request, self._advance, watch=self._watch)
            outcome = _outcome(done, self.request)
        except _Stopped:
            self._end(STOPPED, "The measurement was stopped; nothing was written.")
        except (ValueError, OSError) as error:
            self._end(FAILED, sentence_of(error))
        except Exception as error:
            # A page that waits for ever would hide an error of the program.
            self._end(FAILED, f"the measurement failed ({type(error).__name__}: {' '.join(str(error).split())})")
            raise
        else:
            rows = LivePoses()
            rows.rows = poses_of(done.track).rows()
            with self._lock:
                self._live, self._outcome = rows, outcome
                self._version += 1
            self._end(DONE, "")

    def _end(self, state: str, sentence: str) -> None:
        with self._lock:
            self._state, self._sentence = state, sentence

    def _watch(self, record: Record, done: int) -> None:
        self._check()
        with self._lock:
            self._version += self._live.take(record, done)
            self._phase, self._follows = FOLLOWING, True

    def _advance(self, done: int, total: int) -> None:
        self._check()
        with self._lock:
            # Each batch of frames that are followed calls `_watch` first; frames on the map do not.
            phase = FOLLOWING if self._follows else ON_MAP
            self._phase, self._follows = (phase if done < total else FINISHING), False
            self._progress = (done, total)

    def _check(self) -> None:
        if self._stop.is_set():
            raise _Stopped


def _outcome(done: Measurement, request: Request) -> Outcome:
    result = read(request.out)
    status = done.track.status
    grade = "bad" if why_unusable(status) else "good" if bool((status == "ok").all()) else "part"
    count = sum(len(explanations.warnings(result, level)) for level in (SEVERE, CAUTION))
    return Outcome(explanations.verdict(result), grade, count, request.report)
