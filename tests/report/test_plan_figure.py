"""The figure of a plan: comparable axes, units, and legends beside the curves."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from torchsphere.planning.expected import Setup, differences
from torchsphere.planning.free_flight import Flight
from torchsphere.planning.plan import Plan
from torchsphere.planning.presentation import text
from torchsphere.planning.rehearsal import Target, rehearse
from torchsphere.report import plan_figure

pytestmark = pytest.mark.usefixtures("few_recordings")

SETUP = Setup(speed_m_s=72, frame_rate=36_000, shutter_s=1e-6, px_per_mm=3.6, diameter_mm=30, mass_g=110, noise=2)
TARGET = Target(2.3e-4, 0.3, "given")


@cache
def made() -> Plan:
    """A plan from a flight, with a rehearsal."""
    covariance = np.diag([0.005, 0.005, 2e-4, 2e-4, 1e-4]) ** 2
    increment = np.random.default_rng(0).multivariate_normal(SETUP.increment, covariance, 20)
    flight = Flight(increment, np.sqrt(np.diagonal(covariance)), SETUP, "flight")
    plain = differences(covariance, SETUP.frame_rate, SETUP.m_per_px, SETUP.mass_kg)
    found = rehearse(covariance, SETUP, TARGET, recordings=4)
    return Plan(SETUP, "flight", TARGET, covariance, plain, found, None, np.zeros((0, 2)), None, (), flight)


def test_both_panels_of_a_flight_have_one_time() -> None:
    upper, lower = plan_figure.plan_figure(made()).axes[:2]
    assert upper.get_xlabel() == lower.get_xlabel() == "time (ms)"
    assert upper.get_xlim() == lower.get_xlim() == (0, pytest.approx(21e3 / SETUP.frame_rate))


def test_curves_that_should_be_zero_are_drawn_about_zero_below_their_legend() -> None:
    for axis, unit in zip(plan_figure.plan_figure(made()).axes[:2], ("m/s", "kN"), strict=True):
        most = max(float(np.abs(line.get_ydata()).max()) for line in axis.lines)
        low, high = axis.get_ylim()
        assert low == pytest.approx(-1.1 * most)
        assert high == pytest.approx((1 + plan_figure.LEGEND_ROOM) * 1.1 * most)
        legend = axis.get_legend()
        assert all(text.get_text().endswith(f" {unit}") for text in legend.get_texts())


def test_the_error_of_the_force_has_a_panel_of_its_own_with_the_stated_band() -> None:
    plan = made()
    axis = plan_figure.plan_figure(plan).axes[3]
    found = plan.rehearsal
    assert found is not None
    error = -1e-3 * (found.force_along_N - found.true_force_N)
    np.testing.assert_allclose(axis.lines[0].get_ydata(), error)
    assert np.abs(error).max() < 0.02 * 1e-3 * found.peak_N
    band = axis.collections[0].get_paths()[0].vertices[:, 1]
    assert band.max() == pytest.approx(2e-3 * found.sd_force_along_N.max())
    assert axis.get_xlabel() == "time from first touch (µs)"


def test_a_decade_has_the_same_height_in_velocity_and_force() -> None:
    left, right = plan_figure.plan_figure(made()).axes[4:6]
    assert [axis.get_ylabel() for axis in (left, right)] == ["sd of velocity (m/s)", "sd of force (kN)"]
    spans = [math.log(axis.get_ylim()[1] / axis.get_ylim()[0]) for axis in (left, right)]
    assert spans[0] == pytest.approx(spans[1])
    for axis in (left, right):
        low, high = axis.get_ylim()
        heights = [patch.get_height() for patch in axis.patches]
        assert all(2 * low < height < high / 1.5 for height in heights)
        assert [float(text.get_text()) for text in axis.texts] == pytest.approx(heights, rel=0.06)


def test_without_a_rehearsal_a_sentence_replaces_the_axes() -> None:
    axis = plan_figure.plan_figure(replace(made(), rehearsal=None)).axes[2]
    assert axis.texts[0].get_text().startswith("not rehearsed: more than 60 frames in contact")
    assert len(axis.get_xticks()) == len(axis.get_yticks()) == 0


@pytest.mark.parametrize("frames", [0.2, 0.6])
def test_a_contact_between_two_frames_is_drawn_with_the_frames_next_to_it(frames: float) -> None:
    plan = made()
    target = Target(frames / SETUP.frame_rate, 0.3, "given")
    brief = replace(plan, target=target, rehearsal=rehearse(plan.covariance, SETUP, target, recordings=4))
    axis = plan_figure.plan_figure(brief).axes[3]
    low, high = axis.get_xlim()
    assert ((axis.lines[0].get_xdata() > low) & (axis.lines[0].get_xdata() < high)).sum() == 2
    assert np.isfinite(axis.get_ylim()).all()


def test_a_contact_between_two_frames_gives_words_and_no_nan() -> None:
    plan = made()
    target = Target(0.2 / SETUP.frame_rate, 0.3, "given")
    brief = replace(plan, target=target, rehearsal=rehearse(plan.covariance, SETUP, target, recordings=4))
    figure = plan_figure.plan_figure(brief)
    assert figure.axes[2].get_title().endswith("the contact falls between two frames")
    for axis in figure.axes[4:6]:
        assert [text.get_text() for text in axis.texts][-1] == "no frame\nin contact"
        low, high = axis.get_xlim()
        assert low < 0 < 2 < high
    words = text(brief)
    assert "nan" not in words
    # Five frames in 5.56 us.
    assert "Film at 900000 frames/s or more" in words
    assert "falls between two frames, 27.8 us apart" in words
    assert "nan" not in text(replace(plan, rehearsal=None))
