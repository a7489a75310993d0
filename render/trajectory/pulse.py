"""A half-sine pulse of force, with its integrals in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pulse:
    """The pulse ``p(t) = pi / (2 T) sin(pi (t - start) / T)`` of unit area, possibly cut off early.

    Attributes
    ----------
    start_s, duration_s : float
        Begin, and length ``T`` of the half sine.
    stop_s : float
        Time after which the pulse is zero; ``start_s + duration_s`` without a cut.
    """

    start_s: float
    duration_s: float
    stop_s: float

    @classmethod
    def whole(cls, start_s: float, duration_s: float) -> Pulse:
        """A pulse that is not cut."""
        return cls(start_s, duration_s, start_s + duration_s)

    def density(self, times_s: Array) -> Array:
        """The pulse at times (n,), 1/s."""
        inside = (times_s > self.start_s) & (times_s < self.stop_s)
        sine = np.sin(np.pi * (times_s - self.start_s) / self.duration_s)
        return np.asarray(np.where(inside, np.pi / (2 * self.duration_s) * sine, 0.0))

    def share(self, times_s: Array) -> Array:
        """Integral of the pulse up to times (n,): 0 before and, unless it is cut, 1 after."""
        return np.asarray(np.sin(0.5 * np.pi * self._passed(times_s) / self.duration_s) ** 2)

    def delay(self, times_s: Array) -> Array:
        """Integral of the share up to times (n,), s."""
        passed, duration = self._passed(times_s), self.duration_s
        within = 0.5 * passed - duration / (2 * np.pi) * np.sin(np.pi * passed / duration)
        return np.asarray(within + np.maximum(times_s - self.stop_s, 0.0) * self.share(times_s))

    def _passed(self, times_s: Array) -> Array:
        return np.asarray(np.clip(times_s, self.start_s, self.stop_s) - self.start_s)
