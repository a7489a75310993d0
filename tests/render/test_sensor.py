"""The sensor: grey levels, noise, depth, saturation, and frames that can be repeated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rendering import needs_mitsuba, steady

from render.camera import Camera
from render.exposure import Shutter
from render.frames import render_frames
from render.scene import Quality, Setup
from render.sensor import Sensor

SETUP = Setup(
    camera=Camera(width=160, height=120),
    sensor=Sensor(full_well_e=8000.0, read_noise_grey=1.5, blur_px=0.6),
    quality=Quality(samples=16),
)
MOTION = steady(velocity_m_s=(0.4, 0.0, 0.0), spin_rad_s=(0.0, 30.0, 0.0))


@pytest.mark.parametrize(("bits", "dtype", "top"), [(8, np.uint8, 255), (12, np.uint16, 4095), (16, np.uint16, 65535)])
def test_full_scale_is_white_and_saturates(bits, dtype, top):
    sensor = Sensor(bit_depth=bits)
    grey = sensor.record(sensor.grey(np.array([[0.0, 0.5, 1.0, 1.7]])), 0)
    assert grey.dtype == dtype
    np.testing.assert_array_equal(grey, [[0, np.rint(top / 2), top, top]])


def test_gain_offset_and_saturation():
    sensor = Sensor(gain=2.0, offset_grey=10.0, saturation_grey=240.0)
    np.testing.assert_allclose(sensor.grey(np.array([[0.1, 0.4]])), [[10 + 51, 10 + 204]])
    np.testing.assert_array_equal(sensor.record(np.array([[3.0, 239.4, 250.0]]), 0), [[3, 239, 240]])


def test_shot_noise_grows_with_the_light_and_read_noise_does_not():
    sensor = Sensor(bit_depth=12, full_well_e=20000.0, read_noise_grey=3.0, offset_grey=100.0)
    for grey in (100.0, 600.0, 3000.0):
        found = sensor.record(np.full((400, 500), grey), 7).astype(float)
        # Poisson: n electrons have the variance n; a grey level is 20000 / 4095 electrons. Rounding adds 1/12.
        variance = (grey - 100) * 4095 / 20000 + 9 + 1 / 12
        assert found.mean() == pytest.approx(grey, abs=5 * np.sqrt(variance / found.size))
        assert found.var() == pytest.approx(variance, rel=0.02)


def test_the_point_spread_is_a_gaussian_that_keeps_the_light():
    image = np.zeros((41, 41))
    image[20, 20] = 1.0
    spread = Sensor(blur_px=1.3).grey(image) / 255
    x = np.arange(41) - 20.0
    assert spread.sum() == pytest.approx(1.0, abs=1e-6)
    assert spread.sum(axis=0) @ x**2 == pytest.approx(1.3**2, rel=1e-3)
    assert spread.sum(axis=1) @ x**2 == pytest.approx(1.3**2, rel=1e-3)


def test_noise_differs_between_frames_and_seeds_but_not_between_runs():
    grey = np.full((50, 60), 100.0)
    one = Sensor(read_noise_grey=2.0, seed=1)
    np.testing.assert_array_equal(one.record(grey, 4), one.record(grey, 4))
    assert (one.record(grey, 4) != one.record(grey, 5)).mean() > 0.5
    assert (one.record(grey, 4) != Sensor(read_noise_grey=2.0, seed=2).record(grey, 4)).mean() > 0.5


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("bit_depth", 7),
        ("bit_depth", 17),
        ("gain", 0.0),
        ("offset_grey", -1.0),
        ("blur_px", -0.1),
        ("full_well_e", -5.0),
        ("read_noise_grey", float("nan")),
        ("saturation_grey", 256.0),
        ("seed", -1),
    ],
)
def test_bad_fields_are_refused_by_name(field, value):
    with pytest.raises(ValueError, match=f"^{field} = "):
        Sensor(**{field: value})


@needs_mitsuba
def test_the_same_seed_gives_the_same_bits_and_a_frame_alone_is_the_same():
    times = np.arange(4) / 1000.0
    setup = replace(SETUP, shutter=Shutter(0.0005, 2))
    first, again = (np.stack(list(render_frames(setup, MOTION, times))) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    (alone,) = render_frames(setup, MOTION, times[2:3], numbers=[2])
    np.testing.assert_array_equal(alone, first[2])
    other = replace(setup, sensor=replace(setup.sensor, seed=9))
    assert (next(render_frames(other, MOTION, times)) != first[0]).mean() > 0.3


@needs_mitsuba
def test_frames_come_one_at_a_time_in_the_sensors_depth():
    asked = []

    def motion(times_s):
        asked.append(times_s)
        return MOTION(times_s)

    deep = replace(SETUP, sensor=Sensor(bit_depth=12))
    frames = render_frames(deep, motion, np.arange(1000) / 1000.0)
    frame = next(frames)
    assert frame.dtype == np.uint16
    assert frame.shape == (120, 160)
    assert 3000 < frame.max() <= 4095
    assert len(asked) <= 2  # once for the ball's size, once for the frame


def test_as_many_numbers_as_times_are_asked_for():
    with pytest.raises(ValueError, match="numbers has 1 entries"):
        next(render_frames(SETUP, MOTION, np.zeros(2), numbers=[0]))
