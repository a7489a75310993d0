"""Figures of a result: what is drawn on which axis, with which unit."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

from torchsphere.measure import Request, measure
from torchsphere.report import explanations, image_figures, motion_figures, path_figure
from torchsphere.results.reader import ResultFolder, read
from torchsphere.synthetic import demo_shot


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> ResultFolder:
    """The demo's impact, frames 20 to 45, in SI units."""
    folder = tmp_path_factory.mktemp("figures")
    tifffile.imwrite(folder / "shot.tif", demo_shot.make_shot().images[20:46], photometric="minisblack")
    measure(
        Request(
            input=folder / "shot.tif",
            out=folder / "result",
            fps=36_000.0,
            diameter_mm=30.0,
            mass_g=110.0,
            circle=(170.3, 98.6, 40.0),
            map="off",
        )
    )
    return read(folder / "result")


def in_px(result: ResultFolder) -> ResultFolder:
    """The same without frame rate and scale."""
    summary = result.summary | {"frame_rate": None, "scale": None, "contact_s": None, "differentiation": None}
    nothing = np.full_like(result.time_s, np.nan)
    return dataclasses.replace(result, motion=None, time_s=nothing, summary=summary)


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


def test_below_each_panel_stands_its_standard_deviation_in_the_same_unit(result: ResultFolder) -> None:
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
        # All of it can be seen, from zero.
        low, high = axis.get_ylim()
        assert low == 0
        assert np.nanmax(sd) < high < 1.5 * np.nanmax(sd)
    for above, below in zip(axes[:4], axes[4:], strict=True):
        assert above.get_xlim() == below.get_xlim()
        assert 0 < above.get_position().y0 - below.get_position().y1 < 0.02


def test_the_contact_is_shaded_where_it_was_measured(result: ResultFolder) -> None:
    assert result.contact_s is not None
    for axis in motion_figures.motion_figure(result).axes:
        low, high = axis.patches[0].get_extents().transformed(axis.transData.inverted()).intervalx
        np.testing.assert_allclose([low, high], 1e3 * np.array(result.contact_s))


def test_without_a_scale_motion_is_drawn_in_px_and_frames(result: ResultFolder) -> None:
    axes = motion_figures.motion_figure(in_px(result)).axes
    labels = ["position (px)", "step (px per frame)", "rotation (deg per frame)"]
    # No standard deviation is stated of positions in px.
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
    assert [text.get_text() for text in legends[0].get_texts()] == ["x", "y", "z", "contact"]


def test_frames_that_were_not_measured_are_shaded(result: ResultFolder) -> None:
    status = result.status.astype("<U16")
    status[[4, 5, 9]] = "lost"
    axis = motion_figures.rotation_figure(dataclasses.replace(in_px(result), status=status)).axes[0]
    extents = [patch.get_extents().transformed(axis.transData.inverted()).intervalx for patch in axis.patches]
    np.testing.assert_allclose(extents, [[3.5, 5.5], [8.5, 9.5]])


def test_the_path_is_drawn_in_the_image_s_own_pixels(result: ResultFolder) -> None:
    axis = path_figure.path_figure(result).axes[0]
    assert result.sampled is not None
    left, top, width, height = result.sampled.box
    assert axis.images[0].get_extent() == [left, left + width, top + height, top]
    drawn = labelled(axis)
    np.testing.assert_allclose(drawn["path"].get_xydata(), result.position)
    # Circles of the ball's radius at even times.
    (circles,) = axis.collections
    outlines = circles.get_segments()
    assert len(outlines) == len(np.arange(0, len(result.frame), 2)) >= path_figure.CIRCLES - 1
    assert circles.get_label() == f"ball every {1e3 * 2 / 36_000:.3g} ms"
    for outline, centre in zip(outlines, result.position[::2], strict=True):
        np.testing.assert_allclose(np.hypot(*(outline - centre).T), result.radius[0], rtol=1e-3)


def labelled(axis: Any) -> dict[str, Any]:
    return {line.get_label(): line for line in axis.lines}


def test_start_end_contact_and_direction_of_the_path_are_marked(result: ResultFolder) -> None:
    axis = path_figure.path_figure(result).axes[0]
    drawn = labelled(axis)
    np.testing.assert_allclose(drawn["start"].get_xydata(), result.position[:1])
    np.testing.assert_allclose(drawn["end"].get_xydata(), result.position[-1:])
    assert result.contact_s is not None
    inside = (result.time_s >= result.contact_s[0]) & (result.time_s <= result.contact_s[1])
    assert 2 < inside.sum() < len(inside)
    contact = drawn["contact"].get_xydata()
    np.testing.assert_allclose(contact[1:-1], result.position[inside])
    ends = [np.interp(result.contact_s, result.time_s, column) for column in result.position.T]
    np.testing.assert_allclose(contact[[0, -1]], np.transpose(ends))
    heads = [text for text in axis.texts if text.arrow_patch is not None]
    assert len(heads) == len(path_figure.ARROWS_AT)
    # The first arrow points to the right, towards the target, the second back.
    assert [np.sign(head.xy[0] - head.get_position()[0]) for head in heads] == [1, -1]
    assert axis.get_legend() is not None


@pytest.mark.parametrize(("start", "end"), [(5.2, 5.8), (5.6, 6.4)])
def test_a_contact_with_no_or_one_frame_is_a_line_on_the_path(result: ResultFolder, start: float, end: float) -> None:
    edges = [float(np.interp(row, np.arange(len(result.time_s)), result.time_s)) for row in (start, end)]
    brief = dataclasses.replace(result, summary=result.summary | {"contact_s": edges})
    drawn = labelled(path_figure.path_figure(brief).axes[0])["contact"].get_xydata()
    step = np.hypot(*np.diff(result.position[4:8], axis=0).T).mean()
    assert np.hypot(*np.diff(drawn, axis=0).T).sum() == pytest.approx((end - start) * step, rel=0.2)


def test_a_bar_of_round_length_gives_the_scale_of_the_path_where_it_is_known(result: ResultFolder) -> None:
    axis = path_figure.path_figure(result).axes[0]
    (bar,) = [text.get_text() for text in axis.texts if text.get_text()]
    assert bar.endswith(" mm")
    length_px = np.ptp(axis.lines[-1].get_xdata())
    assert length_px * 1e3 * result.summary["scale"]["m_per_px"] == pytest.approx(float(bar.removesuffix(" mm")))
    assert not any(text.get_text() for text in path_figure.path_figure(in_px(result)).axes[0].texts)


@pytest.mark.parametrize(("length", "round_one"), [(7.3, 5.0), (2.0, 2.0), (0.19, 0.1), (499.0, 200.0)])
def test_round_lengths_are_one_two_or_five_times_a_power_of_ten(length: float, round_one: float) -> None:
    assert path_figure.round_below(length) == pytest.approx(round_one)


def test_a_ball_that_stays_in_place_has_few_circles_and_no_direction(result: ResultFolder) -> None:
    still = dataclasses.replace(result, position=np.tile(result.position[:1], (len(result.frame), 1)))
    axis = path_figure.path_figure(still).axes[0]
    assert len(axis.collections[0].get_segments()) == 2
    assert not [text for text in axis.texts if getattr(text, "arrow_patch", None) is not None]


def test_residual_maps_show_the_start_the_worst_and_the_end_on_one_scale(result: ResultFolder) -> None:
    axes = image_figures.residual_figure(result).axes
    assert result.sampled is not None
    worst = int(np.nanargmin(result.zncc))
    titles = [axis.get_title() for axis in axes[:3]]
    for title, row in zip(titles, (1, worst, len(result.frame) - 1), strict=True):
        assert f"frame {result.frame[row]}\n" in title
    assert len({axis.images[0].get_clim() for axis in axes[:3]}) == 1
    # Five standard deviations of a noise of 2 grey levels in both images, less what the blur takes.
    assert 2 < axes[0].images[0].get_clim()[1] < 10
    assert axes[3].get_ylabel() == "residual (grey levels)"


def test_nothing_measured_is_said_on_the_axes_instead_of_left_blank(result: ResultFolder) -> None:
    nothing = {
        name: np.full_like(getattr(result, name), np.nan)
        for name in ("position", "radius", "increment", "sd_increment", "zncc", "quaternion")
    }
    lost = dataclasses.replace(in_px(result), status=np.full(len(result.status), "lost"), **nothing)
    assert result.sampled is not None
    for figure in (motion_figures.motion_figure(lost), motion_figures.rotation_figure(lost)):
        for axis in figure.axes:
            (text,) = axis.texts
            # Why, in how many frames, and which option helps; nothing that looks like a measurement.
            assert text.get_text().startswith(f"not measured: lost in {len(lost.status)} of {len(lost.status)} frames")
            assert "check the circle that was given, choose frames" in text.get_text()
            assert len(axis.get_yticks()) == 0
            assert not axis.xaxis.get_visible()
            assert axis.get_legend() is None
    found = lost.summary | {"settings": lost.summary["settings"] | {"circle_given": False}}
    assert "give the ball with --circle" in explanations.why_empty(dataclasses.replace(lost, summary=found), "position")
    labels = ["position (px)", "step (px per frame)", "rotation (deg per frame)"]
    assert [axis.get_title(loc="left") for axis in motion_figures.motion_figure(lost).axes] == labels
    assert any("not measured" in text.get_text() for text in path_figure.path_figure(lost).texts)
    motion_figures.quality_figure(lost)


def test_the_small_picture_is_small_and_shows_the_circle(result: ResultFolder, tmp_path: Path) -> None:
    (tmp_path / "small.webp").write_bytes(image_figures.thumbnail(result))
    image = np.asarray(Image.open(tmp_path / "small.webp").convert("RGB")).astype(int)
    assert max(image.shape) <= image_figures.THUMBNAIL_PX
    assert result.sampled is not None
    scale = image.shape[1] / result.sampled.box[2]
    centre = (result.position[0] - result.sampled.box[:2]) * scale
    rows, columns = np.nonzero(image[..., 0] - image[..., 2] > 80)
    away = np.hypot(columns + 0.5 - centre[0], rows + 0.5 - centre[1])
    # The line is 2 px wide and compressed.
    np.testing.assert_allclose(away, result.radius[0] * scale, atol=4)
    assert len(away) > 50


def test_an_empty_panel_among_others_says_why_and_keeps_the_time(result: ResultFolder) -> None:
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
