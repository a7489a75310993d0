"""Errors of mass, frame rate and length in an impact, and the budget of its uncertainty, against exact laws."""

import dataclasses

import numpy as np
import pulses
import pytest
from pulses import M_PER_PX, MASS_KG, NOISES_M, PEAK_N, RATE, pulse

import torchsphere as ts
from torchsphere.dynamics.budget import OF_CONTACT, SOURCES
from torchsphere.dynamics.impact import Estimate, Impact, impact

DIAMETER_M = 0.03

#: Chance of 400 draws: 3.5 % of a standard deviation, and three times that.
SAMPLING = 0.11


@pytest.fixture(scope="module")
def track() -> ts.Track:
    """Give a ball that a half-sine of force throws back, with positions to 1.5 um."""
    return pulse(11, NOISES_M[0]).track


def impact_of(track: ts.Track, *, normal_deg: float = 170.0, scale: float = 0.0, **relative: float) -> Impact:
    """The impact with the relative standard deviations ``mass``, ``frame_rate``, ``diameter`` and that of the scale."""
    mass = relative.get("mass", 0.0)
    motion = ts.kinematics(
        track,
        frame_rate=RATE,
        m_per_px=M_PER_PX,
        relative_sd_scale=scale,
        mass_kg=MASS_KG,
        relative_sd_mass=mass,
        relative_sd_frame_rate=relative.get("frame_rate", 0.0),
    )
    solid = ts.ball(MASS_KG, DIAMETER_M, relative_sd_mass=mass, relative_sd_diameter=relative.get("diameter", 0.0))
    found, reason = impact(motion, solid, normal_deg=normal_deg)
    assert found is not None, reason
    return found


@pytest.fixture(scope="module")
def exact(track: ts.Track) -> Impact:
    """Give the impact whose mass, frame rate and scale are exact."""
    return impact_of(track)


def added(wide: Impact, narrow: Impact, name: str) -> float:
    """Relative standard deviation that an input adds to a result."""
    one, other = getattr(wide, name), getattr(narrow, name)
    assert one.value == pytest.approx(other.value, rel=1e-12)
    return float(np.sqrt(one.sd**2 - other.sd**2) / abs(one.value))


#: Powers with which each result goes with mass, frame rate and scale.
POWERS = {
    "speed_before": (0, 1, 1),
    "impulse_size": (1, 1, 1),
    "peak_force": (1, 2, 1),
    "mean_force": (1, 2, 1),
    "energy_before": (1, 2, 2),
    "energy_given": (1, 2, 2),
    "duration": (0, -1, 0),
    "spin_rate_after": (0, 1, 0),
    "restitution_normal": (0, 0, 0),
    "angle_of_impact": (0, 0, 0),
}


@pytest.mark.parametrize("place", [0, 1, 2], ids=["mass", "frame_rate", "scale"])
def test_each_result_takes_an_error_of_an_input_with_the_power_of_its_law(
    track: ts.Track, exact: Impact, place: int
) -> None:
    source = ("mass", "frame_rate", "scale")[place]
    wide = impact_of(track, **{source: 0.03})
    for name, powers in POWERS.items():
        power = abs(powers[place])
        if power == 0:
            assert getattr(wide, name).sd == pytest.approx(getattr(exact, name).sd, rel=1e-9), name
            assert wide.budget.get(name, {source: 0.0})[source] == pytest.approx(0.0, abs=1e-9)
        else:
            # The numbers drawn for mass and frame rate have their standard deviation exactly, but correlate by chance
            # with those of the noise; those of the scale are 400 plain draws.
            tolerance = SAMPLING if source == "scale" else 0.05
            assert added(wide, exact, name) == pytest.approx(0.03 * power, rel=tolerance), name
            assert wide.budget[name][source] > 0.8


def test_a_mass_known_to_2_percent_is_the_error_of_the_force_of_a_quiet_recording(track: ts.Track) -> None:
    found = impact_of(track, mass=0.02)
    assert found.peak_force.sd / found.peak_force.value == pytest.approx(0.02, rel=0.05)
    assert found.budget["peak_force"]["mass"] > 0.95
    assert found.budget["impulse_size"]["mass"] > 0.95
    assert found.budget["restitution_normal"]["mass"] == 0


def test_a_frame_rate_known_to_1_percent_is_the_error_of_duration_and_start(track: ts.Track, exact: Impact) -> None:
    found = impact_of(track, frame_rate=0.01)
    assert added(found, exact, "duration") == pytest.approx(0.01, rel=0.05)
    assert added(found, exact, "peak_force") == pytest.approx(0.02, rel=0.05)
    # The clock of the frames errs from the first image on.
    assert added(found, exact, "contact_start") == pytest.approx(0.01, rel=0.05)
    assert added(found, exact, "peak_time") == pytest.approx(0.01, rel=0.05)


def sd_by(found: Impact, name: str, source: str) -> float:
    """Relative standard deviation of a result by one source, from its total and its budget."""
    estimate = getattr(found, name)
    return float(np.sqrt(found.budget[name][source]) * estimate.sd / abs(estimate.value))


def test_the_parts_of_the_budget_add_up_to_the_stated_standard_deviation(track: ts.Track, exact: Impact) -> None:
    # A share times the stated variance is the variance by that source alone, which the law of the result gives: only
    # if the parts add up to the total.
    circle = dataclasses.replace(track.circle, sd_radius=0.1, sd_x=0.1, sd_y=0.1)
    uncertain = dataclasses.replace(track, circle=circle, sd_steady=np.array([5e-3, 5e-3, 1e-4, 1e-4, 1e-4]))
    given = {"mass": 0.004, "frame_rate": 0.003, "scale": 0.002}
    found = impact_of(uncertain, **given)
    for name in ("speed_before", "impulse_size", "peak_force", "mean_force", "energy_before", "energy_given"):
        assert sum(found.budget[name].values()) == pytest.approx(1.0)
        assert set(found.budget[name]) == set(SOURCES)
        for source, power in zip(given, POWERS[name], strict=True):
            assert sd_by(found, name, source) == pytest.approx(power * given[source], rel=2 * SAMPLING), (name, source)
        noise = float(getattr(exact, name).sd / abs(getattr(exact, name).value))
        assert sd_by(found, name, "noise") == pytest.approx(noise, rel=2 * SAMPLING), name


def test_a_scale_from_the_outline_belongs_to_the_radius_and_one_that_was_given_to_the_scale(track: ts.Track) -> None:
    circle = dataclasses.replace(track.circle, sd_radius=0.75)
    of_track = dataclasses.replace(track, circle=circle)
    motion = ts.kinematics(of_track, frame_rate=RATE, diameter_m=DIAMETER_M, relative_sd_scale=0.02)
    found = ts.impact(motion)
    # 0.75 of 75 px are 1 %, the diameter 2 %: a fifth and four fifths of the variance.
    assert found[0].budget["speed_before"]["radius"] == pytest.approx(0.2, abs=0.04)
    assert found[0].budget["speed_before"]["scale"] == pytest.approx(0.8, abs=0.04)
    assert found[0].budget["speed_before"]["mass"] == 0
    assert "peak_force" not in found[0].budget


def test_a_ball_whose_noise_is_the_only_error_has_a_budget_of_noise_alone(exact: Impact) -> None:
    for name, shares in exact.budget.items():
        assert shares["noise"] == pytest.approx(1.0), name


def test_the_diameter_that_gives_the_scale_cancels_in_the_slip_and_not_in_the_spin_energy(
    track: ts.Track, exact: Impact
) -> None:
    found = impact_of(track, scale=0.03, diameter=0.03)
    assert found.restitution_tangential.sd == pytest.approx(exact.restitution_tangential.sd, rel=1e-9)
    alone = impact_of(track, diameter=0.03)
    # The inertia goes with the square of the diameter.
    for one in (found, alone):
        assert added(one, exact, "spin_energy_after") == pytest.approx(0.06, rel=SAMPLING)
        assert one.budget["spin_energy_after"]["scale"] > 0.8
    assert alone.restitution_tangential.sd > 1.5 * exact.restitution_tangential.sd


def test_a_given_inertia_is_exact(track: ts.Track) -> None:
    motion = ts.kinematics(track, frame_rate=RATE, m_per_px=M_PER_PX)
    both = {"relative_sd_mass": 0.05, "relative_sd_diameter": 0.05}
    found = [ts.impact(motion, ts.ball(MASS_KG, DIAMETER_M, inertia_kg_m2=1e-5, **sd))[0] for sd in ({}, both)]
    assert found[0].spin_energy_after.sd == found[1].spin_energy_after.sd
    assert found[1].energy_after.sd > 5 * found[0].energy_after.sd


def test_a_contact_too_short_for_its_force_has_no_budget_of_force_and_duration(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pulses, "LENGTH", 1.5)
    monkeypatch.setattr(pulses, "PEAK_N", PEAK_N * 14 / 1.5)
    found = impact_of(pulse(1, NOISES_M[0]).track, normal_deg=180.0, mass=0.01)
    assert not set(OF_CONTACT) & set(found.budget)
    assert found.budget["impulse_size"]["mass"] > 0.9
    assert found.summary()["budget"]["impulse_size"] == found.budget["impulse_size"]


def test_without_a_spin_there_is_no_budget_of_it(track: ts.Track) -> None:
    blind = track.increment.copy()
    blind[:, 2:] = np.nan
    found = impact_of(dataclasses.replace(track, increment=blind), normal_deg=180.0)
    assert not {"spin_rate_after", "spin_energy_after", "energy_given"} & set(found.budget)
    assert isinstance(found.spin_rate_after, Estimate)
    assert "impulse_size" in found.budget


@pytest.mark.parametrize("wrong", [-0.1, float("nan"), 1.0, "0.1", None])
@pytest.mark.parametrize("name", ["relative_sd_mass", "relative_sd_diameter"])
def test_a_share_of_a_ball_out_of_its_range_is_refused(name: str, wrong: object) -> None:
    with pytest.raises(ValueError, match=rf"{name} = {wrong!r}: expected a share from 0 to below 1"):
        ts.ball(MASS_KG, DIAMETER_M, **{name: wrong})  # type: ignore[arg-type]
