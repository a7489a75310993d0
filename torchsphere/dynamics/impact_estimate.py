"""Quantities of an impact: numbers and vectors, each with its standard deviation and unit."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.ball import Ball

Array = NDArray[np.float64]


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


@dataclass(frozen=True, kw_only=True)
class Impact:
    """An impact of a recording; a quantity that the data do not give is None, and ``missing`` says why.

    Attributes
    ----------
    contact_start, contact_end, duration : Estimate
    velocity_before, velocity_after, speed_before, speed_after : Estimate
    direction_before, direction_after : Estimate
        Angle from the x axis towards the y axis of the results' frame.
    normal_direction : Estimate
        Likewise the target's normal, from the target to the ball: as given, or that of the change of velocity.
    angle_of_impact, angle_of_exit : Estimate
        Between path and target's surface: 90 deg is frontal.
    restitution_normal : Estimate
        Normal speed after over before.
    restitution_tangential : Estimate or None
        Minus the tangential velocity of the point of contact after over before, spin included: -1 for sliding without
        friction, 0 for rolling.
    tangential_velocity_ratio : Estimate or None
        Tangential velocity of the centre after over before.
    spin_before, spin_after : Estimate
        Vectors (3,), rev/s.
    spin_rate_before, spin_rate_after : Estimate
        Their lengths.
    peak_force, peak_time, impulse, impulse_size, mean_force : Estimate or None
    energy_before, energy_after : Estimate or None
        Of the translation.
    spin_energy_before, spin_energy_after : Estimate or None
    energy_given : Estimate or None
        Energy given to the target and lost: the difference of translation and spin together.
    ball : Ball or None
    missing : tuple of str
    count : int
        Impacts of the recording.
    """

    contact_start: Estimate
    contact_end: Estimate
    duration: Estimate
    velocity_before: Estimate
    velocity_after: Estimate
    speed_before: Estimate
    speed_after: Estimate
    direction_before: Estimate
    direction_after: Estimate
    normal_direction: Estimate
    angle_of_impact: Estimate
    angle_of_exit: Estimate
    restitution_normal: Estimate
    restitution_tangential: Estimate | None = None
    tangential_velocity_ratio: Estimate | None = None
    spin_before: Estimate
    spin_after: Estimate
    spin_rate_before: Estimate
    spin_rate_after: Estimate
    peak_force: Estimate | None = None
    peak_time: Estimate | None = None
    impulse: Estimate | None = None
    impulse_size: Estimate | None = None
    mean_force: Estimate | None = None
    energy_before: Estimate | None = None
    energy_after: Estimate | None = None
    spin_energy_before: Estimate | None = None
    spin_energy_after: Estimate | None = None
    energy_given: Estimate | None = None
    ball: Ball | None = None
    missing: tuple[str, ...] = ()
    count: int = 1

    def __repr__(self) -> str:
        force = "" if self.peak_force is None else f", largest force {self.peak_force}"
        speeds = f"speed {self.speed_before} before, {self.speed_after} after"
        among = "" if self.count == 1 else f" (of {self.count})"
        return f"<Impact{among} at {self.contact_start} for {self.duration}: {speeds}{force}>"

    def summary(self) -> dict[str, Any]:
        """Name -> value, sd, unit, for a table; quantities that are None are left out."""
        result: dict[str, Any] = {}
        for field in fields(self):
            item = getattr(self, field.name)
            if isinstance(item, Estimate):
                result[field.name] = {"value": item.value.tolist(), "sd": item.sd.tolist(), "unit": item.unit}
        if self.ball is not None:
            result["ball"] = vars(self.ball)
        return result | {"missing": list(self.missing)}
