"""The budget of an impact's uncertainty: the share of each source in the variance of each result.

Motions are drawn with the errors of one source at a time. What the errors of all shared sources leave of the drawn
motions is the noise of the images, as the smoother passes it on. The variances of all sources add up to the variance of
the result to first order, apart from the chance correlations of a few hundred draws; the shares are those of their sum.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from torchsphere.dynamics.draws import Draws
from torchsphere.dynamics.shared_errors import SHARED
from torchsphere.estimation.spread import sd_of_errors
from torchsphere.runtime.arrays import Array

#: Source of the errors that the frames do not share.
NOISE = "noise"

#: All sources, in the order of the tables.
SOURCES = (NOISE, *SHARED)

#: The result whose errors are nearly normal, so that their root mean square states them.
PEAK_FORCE = "peak_force"

#: Results of the contact alone: without a resolved contact they have no budget.
OF_CONTACT = ("duration", PEAK_FORCE, "mean_force")

#: Results with a budget.
RESULTS = (
    "speed_before",
    "speed_after",
    "restitution_normal",
    "restitution_tangential",
    *OF_CONTACT,
    "impulse_size",
    "spin_rate_before",
    "spin_rate_after",
    "energy_before",
    "energy_after",
    "spin_energy_before",
    "spin_energy_after",
    "energy_given",
)


def budget(
    values: Callable[[Draws], dict[str, Array]], draws: Draws, frames: Sequence[int]
) -> dict[str, dict[str, float]]:
    """Shares of each source of `SOURCES` in the variance of each result of `RESULTS`, which add up to 1.

    ``values`` gives the results (s,) of drawn motions by their names, from those ``frames`` of the draws alone. A
    result without a value or without an uncertainty is left out.
    """
    variances = source_variances(values, draws, frames)
    totals = {name: sum(parts.values()) for name, parts in variances.items()}
    return {
        name: {source: part / totals[name] for source, part in parts.items()}
        for name, parts in variances.items()
        if np.isfinite(totals[name]) and totals[name] > 0
    }


def source_variances(
    values: Callable[[Draws], dict[str, Array]], draws: Draws, frames: Sequence[int]
) -> dict[str, dict[str, float]]:
    """Variance of each result by each source; arguments as `budget`."""
    drawn, smoothed = values(draws.at(frames)), values(draws.by_sources((), frames))
    shared = values(draws.by_sources(SHARED, frames))
    by_source = {source: values(draws.by_sources((source,), frames)) for source in SHARED}
    variances = {}
    for name in RESULTS:
        if name in drawn:
            errors = {NOISE: drawn[name] - shared[name]}
            errors |= {source: found[name] - smoothed[name] for source, found in by_source.items()}
            # As the standard deviation of the result itself is made.
            sd = np.std if name == PEAK_FORCE else sd_of_errors
            variances[name] = {source: float(sd(error)) ** 2 for source, error in errors.items()}
    return variances
