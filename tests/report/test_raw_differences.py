"""Raw differences in the units and the axes of the smoothed motion."""

import dataclasses

import numpy as np
import pytest
from result_folders import in_px

from torchsphere.report.time_series import raw_differences, time_series
from torchsphere.results.reader import ResultFolder


def test_raw_values_scatter_about_the_smoothed_ones(result: ResultFolder) -> None:
    motion = result.motion
    assert motion is not None
    assert motion.force_N is not None
    raw = raw_differences(result)
    np.testing.assert_allclose(raw["velocity"].time_s, 0.5 * (motion.time_s[1:] + motion.time_s[:-1]))
    between = 0.5 * (motion.velocity_m_s[1:] + motion.velocity_m_s[:-1])
    # A step errs by 0.005 px, 0.07 m/s; the mean of two smoothed velocities misses that of the interval by 0.5 m/s.
    np.testing.assert_allclose(raw["velocity"].values, between, atol=1.0)
    turn = 0.5 * (motion.spin_rad_s[1:] + motion.spin_rad_s[:-1])
    sd_step = result.sd_increment[1:, 2:] / np.diff(motion.time_s)[:, None]
    # The largest of 75 errors of a normal distribution.
    assert np.abs((raw["spin"].values - turn) / sd_step).max() < 3.5
    np.testing.assert_allclose(raw["force"].time_s, motion.time_s[1:-1])
    np.testing.assert_allclose(raw["force"].values, motion.force_N[1:-1], atol=5e3)
    np.testing.assert_allclose(raw["force"].values, 0.11 * raw["acceleration"].values)


def test_in_the_lab_frame_y_and_z_change_their_signs(result: ResultFolder) -> None:
    settings = result.summary["settings"] | {"lab_frame": True}
    lab = raw_differences(dataclasses.replace(result, summary=result.summary | {"settings": settings}))
    camera = raw_differences(result)
    np.testing.assert_array_equal(lab["velocity"].values, camera["velocity"].values * [1, -1])
    np.testing.assert_array_equal(lab["spin"].values, camera["spin"].values * [1, -1, -1])


def test_frames_that_were_not_measured_have_no_raw_value(result: ResultFolder) -> None:
    position = result.position.copy()
    position[5] = np.nan
    raw = raw_differences(dataclasses.replace(result, position=position))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(raw["velocity"].values[:, 0])), [4, 5])
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(raw["force"].values[:, 0])), [3, 4, 5])


def test_without_si_units_there_are_none(result: ResultFolder) -> None:
    assert raw_differences(in_px(result)) == {}


def test_a_force_in_kilonewtons_has_its_points_in_kilonewtons(result: ResultFolder) -> None:
    (force,) = (series for series in time_series(result) if series.key == "force")
    assert force.unit == "kN"
    assert force.raw is not None
    assert np.nanmax(np.abs(force.raw.values)) == pytest.approx(np.nanmax(np.abs(force.values)), rel=0.1)
