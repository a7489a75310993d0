"""Filtered raw differences against the filtered exact acceleration, and their standard deviations."""

import dataclasses

import hertz_impact
import numpy as np
import pytest

import torchsphere as ts
from experiments.validation.simulated_impacts import M_PER_PX, MASS_KG, RATE, Simulated
from torchsphere.dynamics.channel_filter import channel_filter
from torchsphere.dynamics.filtered_motion import FilteredMotion, filtered_motion

#: A contact that class 1000 passes nearly whole: 2 ms.
CONTACT = hertz_impact.contact(100)


def made(seed: int, noise_m: float = 5e-6) -> Simulated:
    return hertz_impact.impact(CONTACT, frames=260, start=80.3, noise_m=noise_m, seed=seed)


def filtered(shot: Simulated, cfc: int = 1000, **settings: object) -> FilteredMotion:
    # Fast: of the smoother, only its contacts reach the raw differences, and only their errors.
    known = {"frame_rate": RATE, "m_per_px": M_PER_PX, "mass_kg": MASS_KG, "method": "differences"}
    motion = ts.kinematics(shot.track, **known | settings)
    return filtered_motion(shot.track, motion, cfc)


def test_without_noise_the_filtered_force_is_that_of_the_pulse() -> None:
    shot = made(0, 1e-12)
    found = filtered(shot)
    assert found.force_N is not None
    peak = np.abs(shot.force_N).max()
    # Differences over three frames of a pulse of 100 frames lose 1e-3 of its peak.
    inside = slice(1, -1)
    expected = channel_filter(shot.force_N[inside], RATE, 1000)
    np.testing.assert_allclose(found.force_N[inside], expected, atol=1e-3 * peak)
    np.testing.assert_array_equal(np.isnan(found.force_N[:, 0]), np.arange(260) % 259 == 0)
    np.testing.assert_allclose(found.force_N, MASS_KG * found.acceleration_m_s2)


def test_errors_are_those_that_are_stated() -> None:
    quiet = filtered(made(0, 1e-12)).acceleration_m_s2
    found = [filtered(made(seed)) for seed in range(6)]
    errors = np.stack([(one.acceleration_m_s2 - quiet) / one.sd_acceleration_m_s2 for one in found])[:, 1:-1]
    # 6 recordings of 258 frames and 2 axes; a filtered value shares its error with about 30 neighbours: 100 values,
    # whose root mean square scatters by 7 %.
    assert np.sqrt((errors**2).mean()) == pytest.approx(1.0, abs=0.2)


def test_a_frame_that_was_not_measured_leaves_a_gap_of_three() -> None:
    shot = made(1)
    position = shot.track.position.copy()
    position[150] = np.nan
    increment = shot.track.increment.copy()
    increment[149:151] = np.nan
    status = shot.track.status.astype("<U16")
    status[150] = "lost"
    track = dataclasses.replace(shot.track, position=position, increment=increment, status=status)
    found = filtered(dataclasses.replace(shot, track=track), method="smoother")
    for values in (found.acceleration_m_s2, found.sd_acceleration_m_s2):
        np.testing.assert_array_equal(np.flatnonzero(np.isnan(values[:, 0])), [0, 149, 150, 151, 259])


def test_the_lab_frame_turns_y_and_the_scale_reaches_the_standard_deviation() -> None:
    shot = made(2)
    camera, lab = filtered(shot), filtered(shot, lab_frame=True)
    np.testing.assert_allclose(lab.acceleration_m_s2, camera.acceleration_m_s2 * [1, -1], rtol=1e-9)
    wide = filtered(shot, relative_sd_scale=0.1)
    at_peak = np.nanargmax(np.abs(camera.acceleration_m_s2[:, 0]))
    share = wide.sd_acceleration_m_s2[at_peak, 0] / np.abs(camera.acceleration_m_s2[at_peak, 0])
    assert share == pytest.approx(0.1, rel=0.01)


def test_uneven_times_are_refused() -> None:
    shot = made(3)
    times = np.arange(260.0)
    times[100:] += 0.5
    motion = ts.kinematics(shot.track, frame_rate=RATE, m_per_px=M_PER_PX, times_s=times / RATE, method="differences")
    with pytest.raises(ValueError, match="uneven times"):
        filtered_motion(shot.track, motion, 1000)


def test_an_error_of_the_mass_reaches_the_force_but_not_the_acceleration() -> None:
    shot = made(0)
    exact, wide = filtered(shot), filtered(shot, relative_sd_mass=0.02)
    assert exact.force_N is not None
    assert exact.sd_force_N is not None
    assert wide.sd_force_N is not None
    np.testing.assert_allclose(wide.sd_force_N, np.hypot(exact.sd_force_N, 0.02 * exact.force_N))
    np.testing.assert_array_equal(wide.sd_acceleration_m_s2, exact.sd_acceleration_m_s2)
