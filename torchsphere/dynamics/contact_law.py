"""Stiffness of a contact: the law of Hertz fitted to the loading branch of force against penetration, with its misfit.

References: H. Hertz, Journal fuer die reine und angewandte Mathematik 92 (1882) 156-171; K. L. Johnson, Contact
Mechanics, Cambridge University Press (1985), section 4.2 and, for impact, 11.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.estimate import Estimate, estimated
from torchsphere.dynamics.force_path import ForcePath, force_path
from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.estimation.force_forms import HERTZ_POWER
from torchsphere.runtime.arrays import Array

#: Fewest frames of the loading branch: the law has two unknowns (docs/constants.toml).
MIN_LOADING_FRAMES = 3

#: Share of the drawn motions whose misfit by errors alone is smaller than the limit of the misfit.
CONFIDENCE = 0.95

#: Least misfit that speaks against the law, as share of the largest force (docs/constants.toml).
MIN_MISFIT = 0.01

#: Largest way from the law's onset to the start of the contact, in ways of a frame, besides two standard deviations
#: (docs/constants.toml).
MAX_ONSET_FRAMES = 0.5

#: Steps of Gauss and Newton (docs/constants.toml).
STEPS = 30

#: Longest step of the onset, as share of the largest penetration (docs/constants.toml).
LARGEST_STEP = 0.05


_NOT_ELASTIC = "Do not take the stiffness for that of an elastic contact."


@dataclass(frozen=True)
class ContactLaw:
    """The law ``F = K (d + d0)^1.5`` of the loading branch.

    Attributes
    ----------
    stiffness : Estimate
        K, N/m^1.5.
    onset : Estimate
        d0, m: how far before the start that the smoother found the force of the law begins.
    misfit : float
        Root mean square of the force's residuals over the largest fitted force.
    misfit_by_errors : float
        The misfit that errors alone exceed in one of twenty cases.
    describes : bool
        Whether the law describes the loading branch within its errors.
    sentence : str
        The same in words.
    frames : int
        Frames of the loading branch.
    """

    stiffness: Estimate
    onset: Estimate
    misfit: float
    misfit_by_errors: float
    describes: bool
    sentence: str
    frames: int

    def summary(self) -> dict[str, Any]:
        """Name -> value, for a table."""
        return {name: item.summary() if isinstance(item, Estimate) else item for name, item in vars(self).items()}


@dataclass(frozen=True)
class ContactForce:
    """Force against penetration of an impact and its law; None where the data do not give it: ``missing`` says why."""

    path: ForcePath | None
    law: ContactLaw | None
    missing: str = ""

    def summary(self) -> dict[str, Any]:
        """Quantities to be added to `Impact.summary`."""
        found: dict[str, Any] = {}
        if self.path is not None:
            found["largest_penetration"] = self.path.largest_penetration.summary()
            found["energy_lost_normal"] = self.path.energy_lost.summary()
        if self.law is not None:
            found["contact_law"] = self.law.summary()
        return found | ({"contact_law_missing": self.missing} if self.missing else {})


def contact_force(motion: Kinematics, impact: Impact, *, normal_deg: float | None = None) -> ContactForce:
    """Force against penetration of an impact, and the law of Hertz fitted to it; arguments as `force_path`."""
    path, missing = force_path(motion, impact, normal_deg=normal_deg)
    if path is None:
        return ContactForce(None, None, missing)
    return ContactForce(path, *hertz_fit(path))


def hertz_fit(path: ForcePath) -> tuple[ContactLaw | None, str]:
    """Fit of the law of Hertz to the loading branch, or None and the reason in one sentence.

    Notes
    -----
    Least squares of the force with two unknowns, ``K`` and the onset ``d0``. The onset is free, because the start of a
    force that rises as the power 1.5 of time is found late: with ``d0 = 0`` K is 3 to 7 % too large. The standard
    deviations are those of the fits to the drawn motions.
    """
    loading = path.is_loading
    count = int(loading.sum())
    if count < MIN_LOADING_FRAMES:
        return None, (
            f"The loading branch has {count} frames, and a contact stiffness needs at least {MIN_LOADING_FRAMES}: "
            "raise the frame rate."
        )
    # A branch without a force that grows with the depth leaves nothing to divide by.
    with np.errstate(divide="ignore", invalid="ignore"):
        stiffness, onset, residual = _fit(path.penetration.value[loading], path.force.value[loading])
        drawn = _fit(path.drawn_penetration_m[:, loading], path.drawn_force_N[:, loading])
    if not (np.isfinite(stiffness) and np.isfinite(drawn[0]).any()):
        return None, "The law of Hertz cannot be fitted to the loading branch: its force does not grow with the depth."
    largest = float(path.force.value[loading].max())
    misfit = float(_rms(residual)) / largest
    by_errors = float(np.nanquantile(_rms(drawn[2] - residual), CONFIDENCE)) / largest
    start = estimated(onset, drawn[1], "m")
    is_near = abs(float(onset)) < MAX_ONSET_FRAMES * path.way_per_frame_m + 2 * float(start.sd)
    fits = misfit < max(by_errors, MIN_MISFIT)
    law = ContactLaw(
        stiffness=estimated(stiffness, drawn[0], f"N/m^{HERTZ_POWER}"),
        onset=start,
        misfit=misfit,
        misfit_by_errors=by_errors,
        describes=fits and is_near,
        sentence=_sentence(misfit, by_errors, float(onset), fits=fits, is_near=is_near),
        frames=count,
    )
    return law, ""


def _sentence(misfit: float, by_errors: float, onset: float, *, fits: bool, is_near: bool) -> str:
    share = f"{100 * misfit:.2g} % of the largest force"
    if not fits:
        return (
            f"The law of Hertz does not describe the loading branch: its misfit is {share}, and errors explain "
            f"{100 * max(by_errors, MIN_MISFIT):.2g} % at most. {_NOT_ELASTIC}"
        )
    if not is_near:
        return (
            f"The law of Hertz does not describe the loading branch: it would begin {1e3 * abs(onset):.2g} mm "
            f"{'before' if onset > 0 else 'after'} the start of the contact. {_NOT_ELASTIC}"
        )
    return f"The law of Hertz describes the loading branch: its misfit is {share}, which the errors explain."


def _fit(depth: Array, force: Array) -> tuple[Array, Array, Array]:
    """Stiffness (...), onset (...) and residual (..., m) of ``F = K (d + d0)^1.5``, from depths and forces (..., m).

    All drawn motions are fitted at once: one by one, `scipy.optimize.least_squares` takes 24 times as long.
    """
    onset = np.zeros(depth.shape[:-1])
    limit = LARGEST_STEP * depth.max(-1)
    for _ in range(STEPS):
        stiffness, base, residual = _stiffness(depth + onset[..., None], force)
        # Columns of the Jacobian; that of K is what the residual is already free of.
        by_k, by_onset = base**HERTZ_POWER, HERTZ_POWER * stiffness[..., None] * base ** (HERTZ_POWER - 1)
        own = by_onset - by_k * ((by_k * by_onset).sum(-1) / (by_k**2).sum(-1))[..., None]
        onset = onset + np.clip((own * residual).sum(-1) / (own**2).sum(-1), -limit, limit)
    stiffness, _, residual = _stiffness(depth + onset[..., None], force)
    return stiffness, onset, residual


def _stiffness(depth: Array, force: Array) -> tuple[Array, Array, Array]:
    """Best stiffness (...) of given depths since the onset, the depths without negative ones, and the residual."""
    base = np.clip(depth, 0.0, None)
    stiffness = (force * base**HERTZ_POWER).sum(-1) / (base ** (2 * HERTZ_POWER)).sum(-1)
    return stiffness, base, force - stiffness[..., None] * base**HERTZ_POWER


def _rms(values: Array) -> NDArray[np.float64]:
    return np.asarray(np.sqrt((values**2).mean(-1)))
