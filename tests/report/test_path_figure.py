"""The figure of the path: position, direction, contact and scale."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from result_folders import in_px

from torchsphere.report import path_figure
from torchsphere.results.reader import ResultFolder


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
    assert len(outlines) == len(np.arange(0, len(result.frame), 2)) >= path_figure.MAX_CIRCLES - 1
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
