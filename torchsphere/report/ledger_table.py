"""The table of the ledger: the standard deviation that each source of error added to the motion and the outline."""

from __future__ import annotations

import math
from dataclasses import dataclass

from torchsphere.motion.ledger import INCREMENTS, read
from torchsphere.results.reader import ResultFolder

#: Heads of the columns.
COLUMNS = ("dx, px", "dy, px", "wx, deg", "wy, deg", "wz, deg", "x, px", "y, px", "radius, px", "scale, %")


@dataclass(frozen=True)
class LedgerTable:
    """Heads of the columns, and rows of a source's name and a text per column."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[str, ...]], ...]


def ledger_table(result: ResultFolder) -> LedgerTable | None:
    """The table of a result; None for a result of an earlier version."""
    entries = read(result.summary.get("ledger") or ())
    of_steps = [(entry.source, (*_in_deg(entry.step), *entry.circle, 100 * entry.scale)) for entry in entries]
    shared = [(f"{entry.source}: all steps alike", (*_in_deg(entry.steady), *4 * (0.0,))) for entry in entries]
    rows = tuple((name, _texts(values)) for name, values in (*of_steps, *shared) if any(values))
    return LedgerTable(COLUMNS, rows) if rows else None


def _in_deg(motion: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(
        math.degrees(value) if name.endswith("_rad") else value for name, value in zip(INCREMENTS, motion, strict=True)
    )


def _texts(values: tuple[float, ...]) -> tuple[str, ...]:
    """Two digits; "-" for what the source does not add to."""
    return tuple(f"{value:.2g}" if value else "-" for value in values)
