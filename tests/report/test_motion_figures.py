"""Figures over time: curves, axes and units, and the text in an empty panel."""

import dataclasses

import numpy as np
import pytest
from result_folders import in_px

from torchsphere.report import explanations, image_figures, motion_figures
from torchsphere.results.reader import ResultFolder


def test_motion_is_drawn_in_si_units_with_its_band_of_two_standard_deviations(result: ResultFolder) -> None:
    axes = motion_figures.motion_figure(result).axes
    labels = ["position (mm)", "velocity (m/s)", "force (kN)", "spin (rad/s)"]
    assert [axis.get_ylabel() for axis in axes] == [*labels, "sd", "sd", "sd", "sd"]
    assert [axis.get_xlabel() for axis in axes] == [""] * 7 + ["time (ms)"]
    assert result.motion is not None
    drawn = axes[1].lines[0].get_xydata()
    np.testing.assert_allclose(drawn, np.stack((1e3 * result.time_s, result.motion.velocity_m_s[:, 0]), 1))
    band = axes[1].collections[0].get_paths()[0].vertices[:, 1]
    widest = 2 * result.motion.sd_velocity_m_s[:, 0]
    assert band.max() == pytest.approx((result.motion.velocity_m_s[:, 0] + widest).max())
    assert band.min() == pytest.approx((result.motion.velocity_m_s[:, 0] - widest).min())


def test_a_strip_below_each_panel_shows_its_standard_deviation_in_the_same_unit(result: ResultFolder) -> None:
    axes = motion_figures.motion_figure(result).axes
    assert result.motion is not None
    assert result.motion.sd_force_N is not None
    for axis, sd in (
        (axes[4], 1e3 * result.motion.sd_position_m),
        (axes[5], result.motion.sd_velocity_m_s),
        (axes[6], 1e-3 * result.motion.sd_force_N),
        (axes[7], result.motion.sd_spin_rad_s),
    ):
        np.testing.assert_allclose(np.stack([line.get_ydata() for line in axis.lines], 1), sd)
        # The whole curve is visible, from zero.
        low, high = axis.get_ylim()
        assert low == 0
        assert np.nanmax(sd) < high < 1.5 * np.nanmax(sd)
    for above, below in zip(axes[:4], axes[4:], strict=True):
        assert above.get_xlim() == below.get_xlim()
        assert 0 < above.get_position().y0 - below.get_position().y1 < 0.02


def test_raw_differences_are_points_below_the_curves_and_leave_the_limits(result: ResultFolder) -> None:
    figure = motion_figures.motion_figure(result)
    assert result.motion is not None
    time, m_per_px = result.motion.time_s, result.summary["scale"]["m_per_px"]
    velocity = np.diff(result.position, axis=0) * m_per_px / np.diff(time)[:, None]
    curves, points = figure.axes[1].lines[:2], figure.axes[1].lines[2:]
    assert len(points) == 2
    for axis, line in enumerate(points):
        where, values = line.get_xydata().T
        assert line.get_linestyle() == "None"
        assert line.get_zorder() < curves[axis].get_zorder()
        assert len(values) > 0.8 * len(velocity)
        middle = np.searchsorted(1e3 * time, where) - 1
        np.testing.assert_allclose(values, velocity[middle, axis])
    # Wild points change no limit.
    wild = result.position.copy()
    wild[::3] += 5.0
    noisy = motion_figures.motion_figure(dataclasses.replace(result, position=wild))
    for one, other in zip(figure.axes, noisy.axes, strict=True):
        assert one.get_ylim() == other.get_ylim()
    low, high = noisy.axes[2].get_ylim()
    assert all(low <= value <= high for line in noisy.axes[2].lines[2:] for value in line.get_ydata())


def test_the_measured_contact_is_shaded(result: ResultFolder) -> None:
    assert result.contact_s is not None
    for axis in motion_figures.motion_figure(result).axes:
        low, high = axis.patches[0].get_extents().transformed(axis.transData.inverted()).intervalx
        np.testing.assert_allclose([low, high], 1e3 * np.array(result.contact_s))


def test_without_a_scale_motion_is_drawn_in_px_and_frames(result: ResultFolder) -> None:
    axes = motion_figures.motion_figure(in_px(result)).axes
    labels = ["position (px)", "step (px per frame)", "rotation (deg per frame)"]
    # Positions in px have no stated standard deviation.
    assert [axis.get_ylabel() for axis in axes] == [*labels, "sd", "sd"]
    assert axes[-1].get_xlabel() == "frame"
    # The diameter was given.
    assert axes[1].get_title(loc="left") == "for m/s and N give --fps"
    np.testing.assert_allclose(axes[2].lines[1].get_ydata(), np.degrees(result.increment[:, 3]))
    without_mass = in_px(result)
    without_mass.summary["settings"] = result.summary["settings"] | {"mass_g": None}
    assert motion_figures.motion_figure(without_mass).axes[1].get_title(loc="left") == "for m/s give --fps"


def test_one_legend_above_the_first_panel_names_lines_and_shades(result: ResultFolder) -> None:
    axes = motion_figures.motion_figure(result).axes
    legends = [axis.get_legend() for axis in axes]
    assert [legend is not None for legend in legends] == [True] + [False] * 7
    assert [text.get_text() for text in legends[0].get_texts()] == ["x", "y", "z", "raw differences", "contact"]


def test_frames_that_were_not_measured_are_shaded(result: ResultFolder) -> None:
    status = result.status.astype("<U16")
    status[[4, 5, 9]] = "lost"
    axis = motion_figures.rotation_figure(dataclasses.replace(in_px(result), status=status)).axes[0]
    extents = [patch.get_extents().transformed(axis.transData.inverted()).intervalx for patch in axis.patches]
    np.testing.assert_allclose(extents, [[3.5, 5.5], [8.5, 9.5]])


def test_axes_without_measurements_give_the_reason(result: ResultFolder) -> None:
    nothing = {
        name: np.full_like(getattr(result, name), np.nan)
        for name in ("position", "radius", "increment", "sd_increment", "zncc", "quaternion")
    }
    lost = dataclasses.replace(in_px(result), status=np.full(len(result.status), "lost"), **nothing)
    assert result.sampled is not None
    for figure in (motion_figures.motion_figure(lost), motion_figures.rotation_figure(lost)):
        for axis in figure.axes:
            (text,) = axis.texts
            # The reason, the number of frames and the option that helps, without ticks.
            assert text.get_text().startswith(f"not measured: lost in {len(lost.status)} of {len(lost.status)} frames")
            assert "check the circle that was given, choose frames" in text.get_text()
            assert len(axis.get_yticks()) == 0
            assert not axis.xaxis.get_visible()
            assert axis.get_legend() is None
    found = lost.summary | {"settings": lost.summary["settings"] | {"circle_given": False}}
    assert "give the ball with --circle" in explanations.why_empty(dataclasses.replace(lost, summary=found), "position")
    labels = ["position (px)", "step (px per frame)", "rotation (deg per frame)"]
    assert [axis.get_title(loc="left") for axis in motion_figures.motion_figure(lost).axes] == labels
    assert any("not measured" in text.get_text() for text in image_figures.path_figure(lost).texts)
    motion_figures.quality_figure(lost)


def test_an_empty_panel_among_others_gives_the_reason_and_keeps_the_time_axis(result: ResultFolder) -> None:
    assert result.motion is not None
    nothing = np.full_like(result.motion.spin_rad_s, np.nan)
    motion = dataclasses.replace(result.motion, spin_rad_s=nothing, sd_spin_rad_s=nothing)
    smooth = dataclasses.replace(result, motion=motion, status=np.full(len(result.status), "weak_texture"))
    axes = motion_figures.motion_figure(smooth).axes
    assert "too little pattern" in axes[3].texts[0].get_text()
    assert axes[3].get_xlabel() == "time (ms)"
    assert len(axes) == 7
    low, high = axes[3].get_xlim()
    assert low < 1e3 * result.time_s[0] < 1e3 * result.time_s[-1] < high


def test_names_of_statuses_are_not_cut(result: ResultFolder) -> None:
    status = result.status.astype("<U16")
    status[3:] = "low_correlation"
    figure = motion_figures.quality_figure(dataclasses.replace(result, status=status))
    figure.draw_without_rendering()
    assert min(label.get_window_extent().x0 for label in figure.axes[1].get_yticklabels()) > 0
