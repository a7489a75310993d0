"""Energy balance of an impact: translation, spin and their sum, before, after and lost, with standard deviations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from torchsphere.dynamics.ball import Ball, DrawnBall
from torchsphere.dynamics.estimate import Estimate, estimated
from torchsphere.dynamics.rebound import Rebound
from torchsphere.runtime.arrays import Array


@dataclass(frozen=True)
class EnergyRow:
    """A kind of energy before and after, J; its loss, J; and the loss as a share of the whole energy before."""

    before: Estimate
    after: Estimate
    lost: Estimate
    share: Estimate

    def summary(self) -> dict[str, Any]:
        """Column -> value, sd, unit."""
        return {name: item.summary() for name, item in vars(self).items()}


@dataclass(frozen=True)
class EnergyBalance:
    """Energies of an impact; ``lost`` of the total was given to the target or turned to heat, negative is a gain.

    Energies of the spin, and with them the total and all shares, are NaN without a spin.
    """

    translation: EnergyRow
    spin: EnergyRow
    total: EnergyRow

    def summary(self) -> dict[str, Any]:
        """Row -> column -> value, sd, unit."""
        return {name: row.summary() for name, row in vars(self).items()}


def energy_balance(smoothed: Rebound, drawn: Rebound, ball: Ball, balls: Ball | DrawnBall) -> EnergyBalance:
    """``m v^2 / 2`` in the image plane and ``I w^2 / 2`` before and after.

    ``smoothed`` is the smoothed motion () of the ``ball``, ``drawn`` are motions of the ``balls`` within all errors
    (s,): each loss has the standard deviation of the drawn losses, in which the errors that both energies share cancel.
    """
    own, many = _energies(smoothed, ball), _energies(drawn, balls)
    total_before, totals_before = own[..., 2, 0], many[..., 2, 0]

    def row(k: int) -> EnergyRow:
        (before, after), (befores, afters) = np.moveaxis(own[..., k, :], -1, 0), np.moveaxis(many[..., k, :], -1, 0)
        lost, losts = before - after, befores - afters
        return EnergyRow(
            estimated(before, befores, "J"),
            estimated(after, afters, "J"),
            estimated(lost, losts, "J"),
            estimated(lost / total_before, losts / totals_before, "1"),
        )

    return EnergyBalance(row(0), row(1), row(2))


def _energies(one: Rebound, ball: Ball | DrawnBall) -> Array:
    """Translation, spin and total, each before and after (..., 3, 2), J."""
    translation = [0.5 * ball.mass_kg * (v**2).sum(-1) for v in (one.velocity_before, one.velocity_after)]
    spin = [0.5 * ball.inertia_kg_m2 * (w**2).sum(-1) for w in (one.spin_before, one.spin_after)]
    both = np.stack([np.stack(translation, -1), np.stack(spin, -1)], -2)
    return np.concatenate((both, both.sum(-2, keepdims=True)), -2)
