"""The table of the ledger: the standard deviation that each source of error added to the motion and the outline."""

from __future__ import annotations

import math

from torchsphere.motion.ledger import INCREMENTS, read
from torchsphere.report.summary_tables import Table
from torchsphere.results.reader import ResultFolder

#: Heads of the columns.
COLUMNS = ("dx, px", "dy, px", "wx, deg", "wy, deg", "wz, deg", "x, px", "y, px", "radius, px", "scale, %")


def ledger_table(result: ResultFolder) -> Table | None:
    """The table of a result; None for a result of an earlier version."""
    entries = read(result.summary.get("ledger") or ())
    of_steps = [(entry.source, (*_in_deg(entry.step), *entry.circle, 100 * entry.scale)) for entry in entries]
    shared = [(f"{entry.source}: all steps alike", (*_in_deg(entry.steady), *4 * (0.0,))) for entry in entries]
    # Two digits; "-" for what a source does not add to.
    rows = tuple(
        (name, *(f"{value:.2g}" if value else "-" for value in values))
        for name, values in (*of_steps, *shared)
        if any(values)
    )
    return Table("Source", COLUMNS, rows) if rows else None


def _in_deg(motion: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(
        math.degrees(value) if name.endswith("_rad") else value for name, value in zip(INCREMENTS, motion, strict=True)
    )
