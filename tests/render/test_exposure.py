"""The shutter: a frame is the mean over the true motion within its exposure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rendering import needs_mitsuba, picture, steady

from render.background import Background
from render.camera import Camera
from render.exposure import Shutter
from render.frames import render_radiance
from render.pattern import Mark, Pattern
from render.scene import Quality, Setup

SETUP = Setup(pattern=Pattern(speckle_mm=3.0), camera=Camera(width=180, height=130), quality=Quality(samples=1024))
MOTION = steady(velocity_m_s=(0.9, 0.3, 0.0), spin_rad_s=(20.0, -50.0, 90.0))


def test_subframes_are_the_middles_of_equal_parts():
    np.testing.assert_allclose(Shutter(0.004, 4).times_s(1.0), [0.9985, 0.9995, 1.0005, 1.0015], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(Shutter(0.0, 4).times_s(1.0), [1.0])


def test_bad_shutters_are_refused():
    with pytest.raises(ValueError, match=r"^exposure_s = "):
        Shutter(-1.0)
    with pytest.raises(ValueError, match=r"^subframes = "):
        Shutter(1e-5, 0)


@needs_mitsuba
def test_blur_is_the_mean_of_frames_rendered_apart():
    blurred = picture(replace(SETUP, shutter=Shutter(0.002, 8)), MOTION)
    apart = replace(SETUP, quality=Quality(samples=128))
    sharp = np.mean(list(render_radiance(apart, MOTION, Shutter(0.002, 8).times_s(0.0))), axis=0)
    # The noise of two pictures of 1024 paths a pixel: 0.1 grey levels rms, mostly at the edge. The blur: 20 rms.
    assert np.sqrt(((blurred - sharp) ** 2).mean()) < 0.2
    assert abs(blurred - sharp).max() < 3
    assert np.sqrt(((blurred - picture(SETUP, MOTION)) ** 2).mean()) > 5


@needs_mitsuba
def test_a_moving_dot_is_smeared_about_the_middle_of_the_exposure_as_far_as_it_moved():
    pattern = Pattern(kind="plain", brightest=1.0, marks=(Mark(albedo=0.0),))
    setup = replace(SETUP, pattern=pattern, background=Background(level=1.0), quality=Quality(samples=512))
    moments = []
    for shutter in (Shutter(), Shutter(0.002, 32)):
        dark = 255 - picture(replace(setup, shutter=shutter), steady(velocity_m_s=(1.5, 0.0, 0.0)))
        x = np.arange(180.0)
        weight = dark.sum(axis=0) / dark.sum()
        moments.append((weight @ x, weight @ x**2 - (weight @ x) ** 2))
    # 3 mm at 10/3 px per mm: a uniform smear of 10 px adds 10^2/12 to the variance, and 32 steps 1/1024 less; the
    # noise of 16 paths per step leaves 0.03.
    assert moments[1][0] == pytest.approx(moments[0][0], abs=0.003)
    assert moments[1][1] - moments[0][1] == pytest.approx(100 / 12 * (1 - 1 / 1024), abs=0.1)
