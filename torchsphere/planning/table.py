"""A plan as numbers and words, for ``plan.json``."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from torchsphere.planning.advice import remarks
from torchsphere.planning.camera_modes import Assessment
from torchsphere.planning.expected import MAX_BLUR_PX
from torchsphere.planning.free_flight import Flight, mean_and_sd
from torchsphere.planning.plan import Plan
from torchsphere.planning.rehearsal import Rehearsal


def as_table(plan: Plan) -> dict[str, Any]:
    """All of the plan as numbers and words, for ``plan.json``."""
    setup, rehearsal, flight = plan.setup, plan.rehearsal, plan.flight
    advice, *others = remarks(plan)
    return {
        "advice": advice,
        "remarks": others,
        "source": plan.origin,
        "setup": dataclasses.asdict(setup),
        "radius_px": setup.radius_px,
        "increment_px_rad": setup.increment,
        "turn_deg_per_frame": setup.turn_deg,
        "blur_px": setup.blur_px,
        "blur_limit_px": MAX_BLUR_PX,
        "frames_in_view": None if plan.width_px is None else setup.frames_in_view(plan.width_px),
        "increment_covariance_px_rad": plan.covariance,
        "increment_sd_px_rad": np.sqrt(np.diagonal(plan.covariance)),
        "sd_by_differences": dataclasses.asdict(plan.differences),
        "target": dataclasses.asdict(plan.target),
        "rehearsal": None if rehearsal is None else _rehearsal_table(rehearsal),
        "cost_of_blur_px": plan.cost_of_blur,
        "modes": [_mode_table(assessment) for assessment in plan.assessments],
        "free_flight": None if flight is None else _flight_table(flight),
    }


def _rehearsal_table(rehearsal: Rehearsal) -> dict[str, Any]:
    curves = ("time_s", "true_force_N", "force_along_N", "sd_force_along_N")
    numbers = {key: value for key, value in dataclasses.asdict(rehearsal).items() if key not in curves}
    return {"rows": "flight, contact; columns along and across the flight, spin x, y, z"} | numbers


def _mode_table(assessment: Assessment) -> dict[str, Any]:
    plain, rehearsal = assessment.differences, assessment.rehearsal
    return dataclasses.asdict(assessment.mode) | {
        "reason_against": assessment.reason,
        "px_per_mm": assessment.setup.px_per_mm,
        "frames_in_view": assessment.frames_in_view,
        "sd_by_differences": None if plain is None else dataclasses.asdict(plain),
        "force_error_in_contact_N": assessment.error_N,
        "sd_force_in_contact_N": None if rehearsal is None else rehearsal.force_N[1, 0],
        "sd_velocity_in_flight_m_s": None if rehearsal is None else rehearsal.velocity_m_s[0, 0],
    }


def _flight_table(flight: Flight) -> dict[str, Any]:
    values = {"velocity_m_s": flight.velocity_m_s, "force_N": flight.force_N, "spin_rad_s": flight.spin_rad_s}
    table: dict[str, Any] = {"increments": int(np.isfinite(flight.increment).all(1).sum())}
    for name, value in values.items():
        mean, sd = mean_and_sd(value)
        table[name] = {"mean": mean, "std": sd}
    return table | {"stated_sd_increment_px_rad": flight.stated}
