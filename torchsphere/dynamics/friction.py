"""Coefficient of friction of an impact: tangential over normal impulse, or a lower bound of the coefficient."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from torchsphere.dynamics.estimate import Estimate, estimated
from torchsphere.dynamics.rebound import Rebound, dot, slip, tangential
from torchsphere.runtime.arrays import Array

#: Least slip, or ratio of the impulses, that differs from 0, in standard deviations (docs/constants.toml).
MIN_SLIP_SD = 2.0


@dataclass(frozen=True)
class Friction:
    """Ratio of the impulses, slip of the point of contact before and after, and the meaning of the ratio.

    Attributes
    ----------
    coefficient : Estimate
        Size of the tangential over the normal impulse.
    slip_before, slip_after : Estimate
        m/s, tangential velocity of the point of contact, spin included; NaN without a spin.
    is_lower_bound : bool or None
        Whether the coefficient may be larger, because the ball did not slide to the end; None if this is not known.
    sentence : str
        The same in words.
    """

    coefficient: Estimate
    slip_before: Estimate
    slip_after: Estimate
    is_lower_bound: bool | None
    sentence: str

    def summary(self) -> dict[str, Any]:
        """Name -> value, for a table."""
        return {name: item.summary() if isinstance(item, Estimate) else item for name, item in vars(self).items()}


def friction(smoothed: Rebound, drawn: Rebound, radius_m: float, drawn_radius_m: float | Array) -> Friction:
    """Friction from the motion before and after an impact on a target whose normal is given.

    Parameters
    ----------
    smoothed, drawn : Rebound
        Of the smoothed motion () and of motions drawn within its errors (s,).
    radius_m, drawn_radius_m : float or ndarray
        The ball's radius, m, and that of the ball of each drawn motion (s,).

    Notes
    -----
    Coulomb's law ``J_t = mu J_n`` holds while the ball slides (Johnson, Contact Mechanics, 1985, section 7.1; Stronge,
    Impact Mechanics, 2000, chapter 5). A ball that rolls or sticks at the end needs less friction than the surfaces can
    give. Only motion in the image plane counts: friction out of this plane is not seen.
    """
    ratio, ratios = (_signed_ratio(one) for one in (smoothed, drawn))
    before, after = (
        estimated(_slip(smoothed, when, radius_m), _slip(drawn, when, drawn_radius_m), "m/s")
        for when in ("before", "after")
    )
    signed = estimated(ratio, ratios, "1")
    bound, sentence = _meaning(signed, before, after)
    return Friction(Estimate(np.abs(signed.value), signed.sd, "1"), before, after, bound, sentence)


def _slip(one: Rebound, when: str, radius_m: float | Array) -> Array:
    """Slip (...) of the point of contact ``when`` "before" or "after", m/s."""
    return slip(getattr(one, f"velocity_{when}"), getattr(one, f"spin_{when}"), one.normal, radius_m)


def _signed_ratio(one: Rebound) -> Any:
    """Tangential over normal change of velocity (...); the mass cancels."""
    change = one.velocity_after - one.velocity_before
    return tangential(change, one.normal) / dot(change, one.normal)


def _meaning(ratio: Estimate, before: Estimate, after: Estimate) -> tuple[bool | None, str]:
    """Whether the ``ratio`` of the impulses, with its sign, is a lower bound of the coefficient, and why."""
    if not (np.isfinite(before.value) and np.isfinite(after.value)):
        return None, (
            "The spin was not measured, so it is not known whether the ball slid to the end: the ratio of the impulses "
            "is the coefficient of friction or a lower bound of it."
        )
    if _is_clear(ratio) and _is_clear(before) and ratio.value * before.value > 0:
        return None, (
            "The tangential impulse acts along the slip, as no friction does: check the target's normal and its "
            "motion. The ratio of the impulses is no coefficient of friction."
        )
    if not _is_clear(after):
        return True, (
            "The slip ends at 0 within its band: the ball rolls or sticks at the end, and the ratio of the impulses is "
            "a lower bound of the coefficient of friction."
        )
    if not _is_clear(before):
        return None, (
            "The slip before the impact is 0 within its band, so it is not known whether the ball slid to the end: the "
            "ratio of the impulses is the coefficient of friction or a lower bound of it."
        )
    if after.value * before.value < 0:
        return True, (
            "The slip changed its sign: the ball stuck in the contact, and the ratio of the impulses is a lower bound "
            "of the coefficient of friction."
        )
    return False, "The ball still slides at the end: the ratio of the impulses is the coefficient of friction."


def _is_clear(estimate: Estimate) -> bool:
    """Whether a number differs from 0 by more than its errors."""
    return bool(abs(estimate.value) > MIN_SLIP_SD * estimate.sd)
