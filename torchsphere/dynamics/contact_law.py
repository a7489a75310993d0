"""Stiffness of a contact: the law of Hertz fitted to the loading branch of force against penetration, with its misfit.

References: H. Hertz, Journal fuer die reine und angewandte Mathematik 92 (1882) 156-171; K. L. Johnson, Contact
Mechanics, Cambridge University Press (1985), section 4.2 and, for impact, 11.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from torchsphere.dynamics.estimate import Array, Estimate, estimated
from torchsphere.dynamics.force_path import ForcePath, force_path
from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.estimation.force_forms import HERTZ_POWER

#: Fewest frames of the loading branch: the law has two unknowns (docs/constants.toml).
MIN_LOADING_FRAMES = 3

#: Share of the drawn motions whose misfit by errors alone is smaller than the limit of the misfit.
CONFIDENCE = 0.95

#: Least misfit that speaks against the law, as share of the largest force (docs/constants.toml).
MIN_MISFIT = 0.01

#: Largest way from the law's onset to the start of the contact, in ways of a frame, besides two standard deviations
#: (docs/constants.toml).
MAX_ONSET_FRAMES = 0.5

#: Relative change at which a fit ends: that of rounding, as a misfit far above the errors hides them in its square.
TOLERANCE = float(np.finfo(np.float64).eps)

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
    depth, force = path.penetration.value[loading], path.force.value[loading]
    largest = float(force.max())
    stiffness, onset, residual = _fit(depth, force, (largest / depth.max() ** HERTZ_POWER, 0.0))
    each = zip(path.drawn_penetration_m[:, loading], path.drawn_force_N[:, loading], strict=True)
    drawn = [_fit(*one, (stiffness, onset)) for one in each]
    drawn_stiffness, drawn_onset, drawn_residual = (np.stack(values) for values in zip(*drawn, strict=True))
    misfit = float(_rms(residual)) / largest
    by_errors = float(np.nanquantile(_rms(drawn_residual - residual), CONFIDENCE)) / largest
    start = estimated(onset, drawn_onset, "m")
    is_near = abs(onset) < MAX_ONSET_FRAMES * path.way_per_frame_m + 2 * float(start.sd)
    fits = misfit < max(by_errors, MIN_MISFIT)
    law = ContactLaw(
        stiffness=estimated(stiffness, drawn_stiffness, f"N/m^{HERTZ_POWER}"),
        onset=start,
        misfit=misfit,
        misfit_by_errors=by_errors,
        describes=fits and is_near,
        sentence=_sentence(misfit, by_errors, onset, fits=fits, is_near=is_near),
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


def _fit(depth: Array, force: Array, start: tuple[float, float]) -> tuple[float, float, Array]:
    """Stiffness, onset and residual (m,) of ``F = K (d + d0)^1.5``, from depths and forces (m,) of one motion.

    ``start`` are a stiffness and an onset near by. All are NaN for a motion that is not known in all frames.
    """
    # Most measurements have no such law; the import takes time.
    from scipy.optimize import least_squares

    if not (np.isfinite(depth) & np.isfinite(force)).all():
        return np.nan, np.nan, np.full(force.shape, np.nan)
    scale = (abs(start[0]), np.abs(depth).max())
    ends = dict.fromkeys(("xtol", "ftol", "gtol"), TOLERANCE)
    found = least_squares(_excess, start, _slopes, method="lm", x_scale=scale, args=(depth, force), **ends)
    return float(found.x[0]), float(found.x[1]), -found.fun


def _excess(law: Array, depth: Array, force: Array) -> Array:
    """Force (m,) of a law, a stiffness and an onset, less the ``force`` (m,)."""
    return np.asarray(law[0] * np.clip(depth + law[1], 0.0, None) ** HERTZ_POWER - force)


def _slopes(law: Array, depth: Array, force: Array) -> Array:
    """Derivatives (m, 2) of `_excess` by the stiffness and the onset."""
    base = np.clip(depth + law[1], 0.0, None)
    return np.stack((base**HERTZ_POWER, law[0] * HERTZ_POWER * base ** (HERTZ_POWER - 1)), -1)


def _rms(values: Array) -> Array:
    return np.asarray(np.sqrt((values**2).mean(-1)))
