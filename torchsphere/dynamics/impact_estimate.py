"""Quantities of an impact: numbers and vectors, each with its standard deviation and unit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

from torchsphere.dynamics.ball import Ball
from torchsphere.dynamics.energy_balance import EnergyBalance
from torchsphere.dynamics.estimate import Estimate
from torchsphere.dynamics.friction import Friction
from torchsphere.dynamics.si_units import Kinematics
from torchsphere.runtime.presentation import Presented, present

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Estimate", "Impact"]


@dataclass(frozen=True, kw_only=True)
class Impact(Presented):
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
    energy_balance : EnergyBalance or None
        Translation, spin and total: before, after, lost, and share of the energy before.
    friction : Friction or None
        Ratio of tangential to normal impulse, and whether it is a lower bound.
    ball : Ball or None
    missing : tuple of str
    count : int
        Impacts of the recording.
    budget : mapping
        Name of a quantity -> source -> share of the quantity's variance. The shares of a quantity add up to 1; see
        `budget`.
    warnings : tuple of str
        Sentences on contradictions between the ball and the motion.
    motion : Kinematics or None
        The motion that had the impact.
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
    energy_balance: EnergyBalance | None = None
    friction: Friction | None = None
    ball: Ball | None = None
    missing: tuple[str, ...] = ()
    count: int = 1
    budget: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    motion: Kinematics | None = field(default=None, repr=False, compare=False)

    def __repr__(self) -> str:
        force = "" if self.peak_force is None else f", largest force {self.peak_force}"
        speeds = f"speed {self.speed_before} before, {self.speed_after} after"
        among = "" if self.count == 1 else f" (of {self.count})"
        return f"<Impact{among} at {self.contact_start} for {self.duration}: {speeds}{force}>"

    def plot(self) -> Figure:
        """Force against penetration, as in the report, as a matplotlib figure.

        Raises
        ------
        ValueError
            If the force is not known.
        """
        figure: Figure = present("plot", self, "force_path")
        return figure

    def summary(self) -> dict[str, Any]:
        """Name -> value, sd, unit, for a table; quantities that are None are left out."""
        result: dict[str, Any] = {}
        for one in fields(self):
            item = getattr(self, one.name)
            if isinstance(item, Estimate | EnergyBalance | Friction):
                result[one.name] = item.summary()
        if self.ball is not None:
            result["ball"] = vars(self.ball)
        budget = {name: dict(shares) for name, shares in self.budget.items()}
        return result | {"missing": list(self.missing), "budget": budget}
