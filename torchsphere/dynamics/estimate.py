"""A number or vector with its standard deviation and unit, and its estimate from drawn motions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from torchsphere.estimation.spread import sd_of_errors
from torchsphere.runtime.arrays import Array


@dataclass(frozen=True)
class Estimate:
    """A number or vector, its standard deviation, and its unit."""

    value: Array
    sd: Array
    unit: str

    def __str__(self) -> str:
        values, sds = np.atleast_1d(self.value), np.atleast_1d(self.sd)
        texts = [f"{value:.5g} ± {sd:.2g}" for value, sd in zip(values.tolist(), sds.tolist(), strict=True)]
        number = texts[0] if len(texts) == 1 else f"({', '.join(texts)})"
        return f"{number} {self.unit}" if self.unit != "1" else number

    def summary(self) -> dict[str, Any]:
        """Value, sd and unit, for a table."""
        return {"value": self.value.tolist(), "sd": self.sd.tolist(), "unit": self.unit}


def estimated(value: Array | float, drawn: Array, unit: str) -> Estimate:
    """A value (...) with the standard deviation of its errors in drawn motions (s, ...); NaN draws are left out."""
    known = np.asarray(value, dtype=np.float64)
    return Estimate(known, sd_of_errors(np.asarray(drawn - known)), unit)
