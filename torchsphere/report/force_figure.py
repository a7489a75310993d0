"""The figure of an impact's force against penetration: loading, unloading, bands, and the law of Hertz."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from torchsphere.estimation.force_forms import HERTZ_POWER
from torchsphere.report.figure_style import COLOURS, DPI, LEGEND, new_figure
from torchsphere.report.summary_tables import STIFFNESS_FACTOR, with_sd
from torchsphere.results.reader import ForcePathTable, ResultFolder
from torchsphere.runtime.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Points of the curve of the law.
LAW_POINTS = 100


def force_figure(result: ResultFolder) -> Figure:
    """Normal force against penetration of the strongest impact, whose result has a ``force_path``."""
    path, impact = result.force_path, result.summary["impact"]
    assert path is not None
    figure = new_figure(figsize=(7.0, 4.2), dpi=DPI)
    axis = figure.add_subplot()
    axis.grid(alpha=0.3)
    axis.tick_params(labelsize=9)
    unit, factor = force_unit(path)
    _branches(axis, path, factor)
    law = law_curve(path, impact)
    if law is not None:
        name = "law of Hertz" if impact["contact_law"]["describes"] else "law of Hertz, does not describe the branch"
        axis.plot(1e3 * law[0], factor * law[1], color="0.25", ls=":", lw=1.3, zorder=2.5, label=name)
    axis.set_xlabel("penetration: way of the centre towards the target since first touch (mm)", fontsize=9)
    axis.set_ylabel(f"normal force ({unit})", fontsize=9)
    axis.set_xlim(left=min(0.0, 1.05e3 * float(path.penetration_m.min())))
    axis.set_ylim(bottom=min(0.0, 1.05 * factor * float(path.force_N.min())))
    axis.legend(loc="upper left", **LEGEND)
    figure.suptitle("\n".join(_titles(path, impact)), fontsize=9, x=0.02, ha="left")
    return figure


def force_unit(path: ForcePathTable) -> tuple[str, float]:
    """Unit of the force, and its factor from N."""
    return ("kN", 1e-3) if float(np.abs(path.force_N).max()) >= 1000 else ("N", 1.0)


def law_curve(path: ForcePathTable, impact: dict[str, Any]) -> tuple[Array, Array] | None:
    """Penetration (m) and force (N) of the fitted law along the loading branch; None without a law."""
    law = impact.get("contact_law")
    if not law or law["stiffness"]["value"] is None:
        return None
    onset, deepest = law["onset"]["value"], float(path.penetration_m[path.is_loading].max())
    depth = np.linspace(-onset, deepest, LAW_POINTS)
    return depth, law["stiffness"]["value"] * (depth + onset).clip(0) ** HERTZ_POWER


def _branches(axis: Axes, path: ForcePathTable, factor: float) -> None:
    """Both branches as lines of points with bands of two standard deviations; they meet in the deepest frame."""
    last_loading = np.flatnonzero(path.is_loading)[-1:]
    unloading = np.concatenate((last_loading, np.flatnonzero(~path.is_loading)))
    for rows, name, style, colour in (
        (np.flatnonzero(path.is_loading), "loading", "o-", COLOURS[0]),
        (unloading, "unloading", "s--", COLOURS[1]),
    ):
        depth, force = 1e3 * path.penetration_m[rows], factor * path.force_N[rows]
        sd = 2 * factor * path.sd_force_N[rows]
        axis.plot(depth, force, style, color=colour, lw=1.2, ms=3.5, label=name)
        axis.fill_between(depth, force - sd, force + sd, color=colour, alpha=0.25, lw=0)
    # An error of the start moves all points by one length, so that one bar shows it.
    deepest = int(path.penetration_m.argmax())
    axis.errorbar(
        1e3 * path.penetration_m[deepest],
        factor * path.force_N[deepest],
        xerr=2e3 * path.sd_penetration_m[deepest],
        fmt="none",
        ecolor="0.45",
        elinewidth=1.0,
        capsize=3,
        label="2 sd of the start: moves all points together",
    )


def _titles(path: ForcePathTable, impact: dict[str, Any]) -> list[str]:
    """Two lines: the energy that the loop encloses, and the stiffness."""
    lost = impact["energy_lost_normal"]
    lines = [f"Force against penetration; enclosed: {with_sd(lost['value'], lost['sd'], 'J')} lost along the normal"]
    law = impact.get("contact_law")
    if law:
        k = law["stiffness"]
        stiffness = with_sd(k["value"], k["sd"], f"MN/m$^{{{HERTZ_POWER:g}}}$", STIFFNESS_FACTOR)
        lines.append(f"Hertz, loading branch: K = {stiffness}, misfit {100 * law['misfit']:.2g} % of the largest force")
    return lines
