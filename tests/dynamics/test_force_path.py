"""Force against penetration, and the law of Hertz, against contacts with exact force, depth, stiffness and losses."""

import dataclasses
import functools

import hertz_impact
import numpy as np
import pytest
from hertz_impact import Contact

import torchsphere as ts
from experiments.validation.simulated_impacts import (
    M_PER_PX,
    MASS_KG,
    RATE,
    SPEED_M_S,
    Push,
    Simulated,
    half_sine,
    rebound,
    simulated,
)
from torchsphere.dynamics.contact_law import ContactForce, contact_force, hertz_fit
from torchsphere.dynamics.force_path import ForcePath, force_path
from torchsphere.dynamics.impact_estimate import Impact
from torchsphere.dynamics.kinematics import Kinematics, kinematics_of_many

START = 35.3
BALL = ts.ball(MASS_KG, 0.015)

#: Elastic contacts and contacts that lose energy, of 14 and 30 frames.
ELASTIC, LOSSY = hertz_impact.contact(14), hertz_impact.contact(14, unloading_power=2.5)
LONG = hertz_impact.contact(30)
SPRING, SOFT = hertz_impact.contact(14, power=1.0), hertz_impact.contact(30, power=2.0)


#: Contact, seed and noise of the shots that the smoother takes at once, which costs half the time of one after another.
TOGETHER = [
    *((contact, seed, 1.5e-6) for contact in (ELASTIC, LOSSY, LONG, SPRING, SOFT) for seed in range(3)),
    *((contact, 0, 7.5e-6) for contact in (ELASTIC, LOSSY, LONG)),
]


@functools.cache
def smoothed() -> dict[tuple[Contact, int, float], tuple[Simulated, Kinematics]]:
    """The shots of `TOGETHER` and their motions."""
    shots = [hertz_impact.impact(contact, start=START, noise_m=noise, seed=seed) for contact, seed, noise in TOGETHER]
    motions = kinematics_of_many(
        [shot.track for shot in shots], frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG, log=False
    )
    return dict(zip(TOGETHER, zip(shots, motions, strict=True), strict=True))


@functools.cache
def measured(
    contact: Contact, seed: int = 0, noise_m: float = 1.5e-6, normal_deg: float | None = 180.0, **settings: object
) -> tuple[Simulated, Kinematics, Impact]:
    if settings or (contact, seed, noise_m) not in TOGETHER:
        shot = hertz_impact.impact(contact, start=START, noise_m=noise_m, seed=seed)
        motion = ts.kinematics(shot.track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG, **settings)
    else:
        shot, motion = smoothed()[contact, seed, noise_m]
    found, reason = ts.impact(motion, BALL, normal_deg=normal_deg)
    assert found is not None, reason
    return shot, motion, found


def path_of(contact: Contact, **settings: object) -> tuple[Simulated, ForcePath]:
    shot, motion, found = measured(contact, **settings)
    path, reason = force_path(motion, found, normal_deg=settings.get("normal_deg", 180.0))
    assert path is not None, reason
    return shot, path


def true_depth(shot: Simulated, rows: np.ndarray) -> np.ndarray:
    return shot.position_m[rows, 0] - shot.position_m[0, 0] - SPEED_M_S * START / RATE


@pytest.mark.parametrize("contact", [ELASTIC, LOSSY, LONG], ids=["elastic", "lossy", "long"])
@pytest.mark.parametrize("noise_m", [1.5e-6, 7.5e-6])
def test_depth_force_and_lost_energy_are_those_of_the_contact(contact: Contact, noise_m: float) -> None:
    shot, path = path_of(contact, noise_m=noise_m)
    force, depth = -shot.force_N[path.row, 0], true_depth(shot, path.row)
    for found, true in ((path.penetration, depth), (path.force, force)):
        # Root mean square over a path whose errors are correlated.
        assert np.sqrt((((found.value - true) / found.sd) ** 2).mean()) < 2.5
    assert abs(path.largest_penetration.value - contact.penetration_m.max()) < 2.5 * path.largest_penetration.sd
    assert abs(path.energy_lost.value - contact.energy_lost) < 3 * path.energy_lost.sd
    assert path.energy_lost.sd < 0.2
    np.testing.assert_array_equal(
        path.is_loading, np.interp(path.time_s - START / RATE, contact.time_s, contact.velocity_m_s) > 0
    )


def test_the_lost_energy_is_the_area_that_the_path_encloses() -> None:
    slow = hertz_impact.contact(40, unloading_power=2.5)
    _, path = path_of(slow)
    depth, force = path.penetration.value, path.force.value
    # From first touch without a force, through the frames, to the end without a force.
    area = np.trapezoid(np.concatenate(([0.0], force, [0.0])), np.concatenate(([0.0], depth, depth[-1:])))
    assert area == pytest.approx(path.energy_lost.value, rel=0.02)


def test_a_later_start_moves_all_depths_by_the_same_length() -> None:
    _, motion, found = measured(ELASTIC)
    path, _ = force_path(motion, found, normal_deg=180.0)
    assert path is not None
    later = dataclasses.replace(
        motion.contacts[0], contact_s=motion.contacts[0].contact_s + np.array([0.1 / RATE, 0.0])
    )
    moved, _ = force_path(dataclasses.replace(motion, contacts=(later,)), found, normal_deg=180.0)
    assert moved is not None
    change = path.penetration.value - moved.penetration.value[-len(path.row) :]
    np.testing.assert_allclose(change, 0.1 * SPEED_M_S / RATE, rtol=0.02)


def test_a_found_normal_and_the_lab_frame_give_the_same_path() -> None:
    _, path = path_of(LOSSY)
    for settings in ({"normal_deg": None}, {"lab_frame": True}):
        _, other = path_of(LOSSY, **settings)
        np.testing.assert_allclose(other.penetration.value, path.penetration.value, rtol=1e-4)
        np.testing.assert_allclose(other.force.value, path.force.value, rtol=1e-3, atol=1.0)


def test_on_an_inclined_target_only_the_part_along_the_normal_counts() -> None:
    _, path = path_of(ELASTIC)
    _, motion, found = measured(ELASTIC)
    inclined, _ = force_path(motion, found, normal_deg=150.0)
    assert inclined is not None
    np.testing.assert_allclose(inclined.force.value, path.force.value * np.cos(np.radians(30)), rtol=1e-2)
    np.testing.assert_allclose(inclined.penetration.value, path.penetration.value * np.cos(np.radians(30)), rtol=1e-2)


def test_each_of_two_impacts_has_the_path_of_its_own_contact() -> None:
    first = rebound(half_sine, 30.3, 12.0)
    pushes = (first, Push(half_sine, 75.4, 10.0, -0.6 * first.peak_N))
    shot = simulated(pushes, 130, 1.5e-6, 0)
    motion = ts.kinematics(shot.track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)
    found = ts.impacts(motion, BALL)
    assert len(found) == 2
    frames = np.arange(130)
    for impact, push in zip(found, pushes, strict=True):
        path, reason = force_path(motion, impact)
        assert path is not None, reason
        np.testing.assert_array_equal(path.row, frames[(frames > push.start) & (frames < push.start + push.length)])
        before, after = shot.velocity_m_s[[int(push.start), int(push.start + push.length) + 1], 0]
        lost = 0.5 * MASS_KG * (before**2 - after**2)
        assert abs(path.energy_lost.value - lost) < 3 * path.energy_lost.sd
        assert path.force.value.min() > 0


def test_without_a_mass_or_a_resolved_force_there_is_no_path_and_a_sentence_says_why() -> None:
    _, motion, found = measured(ELASTIC)
    massless = dataclasses.replace(motion, mass_kg=None)
    assert force_path(massless, found) == (
        None,
        "Without the ball's mass there is no force, and so no force against penetration.",
    )
    unknown = dataclasses.replace(found.peak_force, value=np.asarray(np.nan))
    path, reason = force_path(motion, dataclasses.replace(found, peak_force=unknown))
    assert path is None
    assert "too short" in reason


@pytest.mark.parametrize(
    ("contact", "tolerance"), [(ELASTIC, 0.005), (LOSSY, 0.02), (LONG, 0.003)], ids=["elastic", "lossy", "long"]
)
def test_the_stiffness_is_that_of_the_contact_and_the_law_describes_it(contact: Contact, tolerance: float) -> None:
    for seed in range(3):
        shot, path = path_of(contact, seed=seed)
        law, reason = hertz_fit(path)
        assert law is not None, reason
        assert law.stiffness.unit == "N/m^1.5"
        assert law.stiffness.value == pytest.approx(contact.stiffness, rel=tolerance)
        assert abs(law.stiffness.value - contact.stiffness) < 3.5 * law.stiffness.sd
        assert law.describes
        assert law.misfit < 0.01
        assert "describes the loading branch" in law.sentence
        # The onset is the distance that the start was found late.
        late = path.penetration.value[0] - true_depth(shot, path.row)[0]
        assert law.onset.value == pytest.approx(-late, abs=0.1 * SPEED_M_S / RATE)


@pytest.mark.parametrize("contact", [SPRING, SOFT], ids=["linear", "square"])
def test_a_contact_of_another_power_is_said_not_to_follow_hertz(contact: Contact) -> None:
    for seed in range(3):
        _, path = path_of(contact, seed=seed)
        law, _ = hertz_fit(path)
        assert law is not None
        assert not law.describes
        assert law.sentence.startswith("The law of Hertz does not describe the loading branch")


def test_an_exact_law_is_found_exactly_and_an_unknown_drawn_motion_is_left_out() -> None:
    _, path = path_of(ELASTIC)
    force = 3e9 * np.clip(path.penetration.value + 2e-6, 0.0, None) ** 1.5
    drawn = path.drawn_force_N.copy()
    drawn[0] = np.nan
    exact = dataclasses.replace(path, force=dataclasses.replace(path.force, value=force), drawn_force_N=drawn)
    law, _ = hertz_fit(exact)
    assert law is not None
    assert law.stiffness.value == pytest.approx(3e9, rel=1e-9)
    assert law.onset.value == pytest.approx(2e-6, rel=1e-6)
    assert np.isfinite([law.stiffness.sd, law.onset.sd, law.misfit_by_errors]).all()


def test_too_few_frames_of_loading_give_no_stiffness() -> None:
    _, path = path_of(ELASTIC)
    few = dataclasses.replace(path, is_loading=path.is_loading & (np.cumsum(path.is_loading) <= 2))
    law, reason = hertz_fit(few)
    assert law is None
    assert "2 frames, and a contact stiffness needs at least 3" in reason


def test_the_summary_has_values_with_units_and_the_sentence() -> None:
    _, motion, found = measured(LOSSY)
    summary = contact_force(motion, found, normal_deg=180.0).summary()
    assert summary["energy_lost_normal"]["unit"] == "J"
    assert summary["largest_penetration"]["value"] == pytest.approx(LOSSY.penetration_m.max(), rel=0.05)
    assert summary["contact_law"]["stiffness"]["unit"] == "N/m^1.5"
    assert summary["contact_law"]["describes"] is True
    assert ContactForce(None, None, "No.").summary() == {"contact_law_missing": "No."}


def test_an_error_of_the_mass_reaches_force_stiffness_and_energy_but_not_the_depth() -> None:
    # Both smoothed alone: sums of a batch have another order.
    (_, exact), (_, wide) = (path_of(ELASTIC, relative_sd_mass=sd) for sd in (0.0, 0.02))
    at_peak = int(exact.force.value.argmax())
    assert wide.force.sd[at_peak] == pytest.approx(0.02 * exact.force.value[at_peak], rel=0.1)
    assert wide.penetration.sd == pytest.approx(exact.penetration.sd)
    laws = [hertz_fit(path)[0] for path in (exact, wide)]
    assert laws[0] is not None
    assert laws[1] is not None
    assert laws[1].stiffness.sd == pytest.approx(
        np.hypot(laws[0].stiffness.sd, 0.02 * laws[0].stiffness.value), rel=0.1
    )


def test_a_loading_branch_without_a_force_that_grows_has_no_law_and_says_so() -> None:
    """As where one image of a contact is a copy of the one before."""
    _, path = path_of(ELASTIC)
    flat = dataclasses.replace(
        path,
        penetration=dataclasses.replace(path.penetration, value=0.0 * path.penetration.value),
        drawn_penetration_m=0.0 * path.drawn_penetration_m,
    )
    law, missing = hertz_fit(flat)
    assert law is None
    assert "its force does not grow with the depth" in missing
