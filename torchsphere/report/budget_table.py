"""The table of an impact's budget: the share of each source in the variance of each result, in per cent."""

from __future__ import annotations

from torchsphere.report.summary_tables import IMPACT, Table
from torchsphere.results.reader import ResultFolder

#: Names of the sources of `dynamics.budget` in the report.
SOURCES = {
    "noise": "noise of the images",
    "radius": "radius of the outline",
    "scale": "diameter or size of a pixel",
    "centre": "centre of the outline",
    "steady_error": "steady error",
    "frame_rate": "frame rate",
    "mass": "mass",
}

#: Names of results that no other table has.
_NAMES = {name: text for name, text, _, _ in IMPACT} | {
    "energy_before": "Energy of translation before",
    "energy_after": "Energy of translation after",
    "spin_energy_before": "Energy of rotation before",
    "spin_energy_after": "Energy of rotation after",
}


def budget_table(result: ResultFolder) -> Table | None:
    """The table of the strongest impact; None without an impact, or for a result of an earlier version."""
    budget = (result.summary.get("impact") or {}).get("budget")
    if not budget:
        return None
    # A source without an effect on any result, as the mass where it was given as exact, has no column.
    sources = [name for name in SOURCES if any(shares.get(name) for shares in budget.values())]
    rows = tuple(
        (_NAMES.get(name, name), *(_per_cent(shares.get(source, 0.0)) for source in sources))
        for name, shares in budget.items()
    )
    return Table("Result", tuple(SOURCES[name] for name in sources), rows)


def _per_cent(share: float) -> str:
    """A share as whole per cent; "< 1" for less, "-" for none."""
    if share == 0:
        return "-"
    return "< 1" if share < 0.005 else f"{100 * share:.0f}"
