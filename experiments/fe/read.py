"""CalculiX's output: the ball's velocity, and the force from its momentum."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from experiments.paper.bar.history import Peak, peaks

Array = NDArray[np.float64]

#: Beginning of the line above each table of velocities; the time is its last word.
TITLE = "velocities"


@dataclass(frozen=True)
class Motion:
    """The ball's velocity (n, 3) in m/s over time (n,) in s, in the deck's axes, and its mass in kg."""

    time_s: Array
    velocity_m_s: Array
    mass_kg: float

    def force(self) -> tuple[Array, Array]:
        """Middles (n - 1,) of the intervals in s, and the mean force (n - 1, 3) on the ball in N in each.

        Mass times difference of velocity is exactly the contact's force, since nothing else acts on the ball.
        """
        lapse = np.diff(self.time_s)
        force = self.mass_kg * np.diff(self.velocity_m_s, axis=0) / lapse[:, None]
        return (self.time_s[1:] + self.time_s[:-1]) / 2, force

    def seen(self, interval_s: float, step_s: float = 1e-6) -> tuple[Array, Array]:
        """Times (m,) in s and the force (m, 3) in N as a camera with this interval sees it, at every ``step_s``.

        Second differences of exact positions; before the first touch at 0 the velocity is the first one, and times end
        one interval before what was integrated.

        Raises
        ------
        ValueError
            Where less than two intervals were integrated.
        """
        end = float(self.time_s[-1])
        if not 0 < 2 * interval_s <= end:
            raise ValueError(
                f"interval_s = {interval_s!r}: expected at most half of the {end:g} s that were integrated"
            )
        place = cumulative_trapezoid(self.velocity_m_s, self.time_s, axis=0, initial=0.0)
        times = np.arange(-interval_s, end - interval_s, step_s)

        def at(moments: Array) -> Array:
            inside = np.clip(moments, 0, None)
            columns = [np.interp(inside, self.time_s, column) for column in place.T]
            return np.column_stack(columns) + np.minimum(moments, 0)[:, None] * self.velocity_m_s[0]

        second = at(times + interval_s) - 2 * at(times) + at(times - interval_s)
        return times, self.mass_kg * second / interval_s**2


def velocities(path: Path, shares: Array) -> tuple[Array, Array]:
    """Times (t,) in s and the velocity (t, 3) in mm/s of the centre of mass, from CalculiX's ``.dat``.

    ``shares`` (n,) is the share of the mass of each node, in the order of the nodes' numbers, from 1. Raises if the
    file has no table of velocities, a table with other nodes, or times that do not grow.
    """
    lines = path.read_text(encoding="ascii").splitlines()
    heads = [i for i, line in enumerate(lines) if line.lstrip().startswith(TITLE)]
    if not heads:
        raise ValueError(
            f"{path.name}: no table of {TITLE!r}; expected one at each time, so print V of the ball's nodes"
        )
    times, means, labels = [], [], [[str(i + 1)] for i in range(len(shares))]
    for head in heads:
        words = [line.split() for line in lines[head + 2 : head + 2 + len(shares)]]
        whole = [row[:1] for row in words] == labels and all(len(row) == 4 for row in words)
        if not whole:
            raise ValueError(
                f"{path.name}, line {head + 1}: expected the nodes 1 to {len(shares)} with three components; "
                "was the file cut off, or made with another mesh?"
            )
        times.append(float(lines[head].split()[-1]))
        means.append(shares @ np.array(words, dtype=float)[:, 1:])
    if (np.diff(times) <= 0).any():
        raise ValueError(f"{path.name}: the times do not grow; print less often than every increment")
    return np.array(times), np.array(means)


def force_peaks(time_s: Array, force_N: Array) -> tuple[Peak, ...]:  # noqa: N803  (N is newton)
    """The peaks of a force (n,), by `experiments.paper.bar.history.peaks`; none without a push."""
    return peaks(time_s, force_N) if force_N.max(initial=0.0) > 0 else ()
