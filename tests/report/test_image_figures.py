"""Figures of images: the path, residual maps on one scale, and the thumbnail."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from result_folders import in_px

from torchsphere.report import image_figures
from torchsphere.results.reader import ResultFolder


def test_the_path_is_drawn_in_the_pixels_of_the_image(result: ResultFolder) -> None:
    axis = image_figures.path_figure(result).axes[0]
    assert result.sampled is not None
    left, top, width, height = result.sampled.box
    assert axis.images[0].get_extent() == [left, left + width, top + height, top]
    drawn = labelled(axis)
    np.testing.assert_allclose(drawn["path"].get_xydata(), result.position)
    # Circles of the ball's radius at even times.
    (circles,) = axis.collections
    outlines = circles.get_segments()
    assert len(outlines) == len(np.arange(0, len(result.frame), 2)) >= image_figures.MAX_CIRCLES - 1
    assert circles.get_label() == f"ball every {1e3 * 2 / 36_000:.3g} ms"
    for outline, centre in zip(outlines, result.position[::2], strict=True):
        np.testing.assert_allclose(np.hypot(*(outline - centre).T), result.radius[0], rtol=1e-3)


def labelled(axis: Any) -> dict[str, Any]:
    return {line.get_label(): line for line in axis.lines}


def test_start_end_contact_and_direction_of_the_path_are_marked(result: ResultFolder) -> None:
    axis = image_figures.path_figure(result).axes[0]
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
    assert len(heads) == len(image_figures.ARROWS_AT)
    # The first arrow points to the right, towards the target, the second back.
    assert [np.sign(head.xy[0] - head.get_position()[0]) for head in heads] == [1, -1]
    assert axis.get_legend() is not None


@pytest.mark.parametrize(("start", "end"), [(5.2, 5.8), (5.6, 6.4)])
def test_a_contact_with_no_or_one_frame_is_a_line_on_the_path(result: ResultFolder, start: float, end: float) -> None:
    edges = [float(np.interp(row, np.arange(len(result.time_s)), result.time_s)) for row in (start, end)]
    brief = dataclasses.replace(result, summary=result.summary | {"contact_s": edges})
    drawn = labelled(image_figures.path_figure(brief).axes[0])["contact"].get_xydata()
    step = np.hypot(*np.diff(result.position[4:8], axis=0).T).mean()
    assert np.hypot(*np.diff(drawn, axis=0).T).sum() == pytest.approx((end - start) * step, rel=0.2)


def test_a_bar_of_round_length_gives_a_known_scale(result: ResultFolder) -> None:
    axis = image_figures.path_figure(result).axes[0]
    (bar,) = [text.get_text() for text in axis.texts if text.get_text()]
    assert bar.endswith(" mm")
    length_px = np.ptp(axis.lines[-1].get_xdata())
    assert length_px * 1e3 * result.summary["scale"]["m_per_px"] == pytest.approx(float(bar.removesuffix(" mm")))
    assert not any(text.get_text() for text in image_figures.path_figure(in_px(result)).axes[0].texts)


@pytest.mark.parametrize(("length", "round_one"), [(7.3, 5.0), (2.0, 2.0), (0.19, 0.1), (499.0, 200.0)])
def test_round_lengths_are_one_two_or_five_times_a_power_of_ten(length: float, round_one: float) -> None:
    assert image_figures.round_below(length) == pytest.approx(round_one)


def test_a_ball_that_stays_in_place_has_few_circles_and_no_direction(result: ResultFolder) -> None:
    still = dataclasses.replace(result, position=np.tile(result.position[:1], (len(result.frame), 1)))
    axis = image_figures.path_figure(still).axes[0]
    assert len(axis.collections[0].get_segments()) == 2
    assert not [text for text in axis.texts if getattr(text, "arrow_patch", None) is not None]


def test_residual_maps_show_start_worst_match_and_end_on_one_scale(result: ResultFolder) -> None:
    axes = image_figures.residual_figure(result).axes
    assert result.sampled is not None
    worst = int(np.nanargmin(result.zncc))
    titles = [axis.get_title() for axis in axes[:3]]
    for title, row in zip(titles, (1, worst, len(result.frame) - 1), strict=True):
        assert f"frame {result.frame[row]}\n" in title
    assert len({axis.images[0].get_clim() for axis in axes[:3]}) == 1
    # Five standard deviations of a noise of 2 grey levels in both images, reduced by the blur.
    assert 2 < axes[0].images[0].get_clim()[1] < 10
    assert axes[3].get_ylabel() == "residual (grey levels)"


def test_the_thumbnail_is_small_and_shows_the_circle(result: ResultFolder, tmp_path: Path) -> None:
    (tmp_path / "thumbnail.webp").write_bytes(image_figures.thumbnail(result))
    image = np.asarray(Image.open(tmp_path / "thumbnail.webp").convert("RGB")).astype(int)
    assert max(image.shape) <= image_figures.THUMBNAIL_PX
    assert result.sampled is not None
    scale = image.shape[1] / result.sampled.box[2]
    centre = (result.position[0] - result.sampled.box[:2]) * scale
    rows, columns = np.nonzero(image[..., 0] - image[..., 2] > 80)
    away = np.hypot(columns + 0.5 - centre[0], rows + 0.5 - centre[1])
    # The line is 2 px wide and compressed.
    np.testing.assert_allclose(away, result.radius[0] * scale, atol=4)
    assert len(away) > 50
