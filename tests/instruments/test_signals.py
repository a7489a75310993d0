"""Light gate and accelerometer: delays to a fraction of a sample, with standard deviations by many repetitions."""

import contextlib
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pulses import LENGTH, M_PER_PX, MASS_KG, NOISES_M, PEAK_N, RATE, Pulse, pulse

import torchsphere as ts
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.instruments.delay import fit_delay
from torchsphere.instruments.signals import align, light_gate, mean_speed

INTERVAL_S, COUNT = 1e-6, 2000


def barrier(time_s: np.ndarray, at_s: float) -> np.ndarray:
    """Signal of a ball that darkens a barrier for 270 us, with edges of 15 us."""
    return 1 / (1 + np.exp(-(time_s - at_s) / 15e-6)) - 1 / (1 + np.exp(-(time_s - at_s - 270e-6) / 15e-6))


def gate(delay_s: float, noise: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    time_s = INTERVAL_S * np.arange(COUNT)
    first = 2.0 + barrier(time_s, 400e-6) + noise * rng.normal(size=COUNT)
    second = 1.0 + 0.8 * barrier(time_s, 400e-6 + delay_s) + noise * rng.normal(size=COUNT)
    return time_s, first, second


def test_a_light_gate_without_noise_gives_the_velocity_to_a_thousandth_of_a_sample() -> None:
    delay = 628.63e-6
    found = light_gate(*gate(delay, 0.0, 0), spacing_m=0.04)
    assert found.delay_s == pytest.approx(delay, abs=1e-3 * INTERVAL_S)
    assert found.velocity_m_s == pytest.approx(0.04 / delay, rel=1e-5)
    assert found.correlation > 0.9999


@pytest.mark.parametrize("noise", [0.01, 0.05])
def test_the_standard_deviation_of_a_light_gate_is_that_of_many_repetitions(noise: float) -> None:
    delay = 628.63e-6
    found = [light_gate(*gate(delay, noise, seed), spacing_m=0.04) for seed in range(100)]
    ratio = np.array([f.delay_s - delay for f in found]) / np.array([f.sd_delay_s for f in found])
    # 100 values give the root mean square to 7 %, and the mean to 0.1: three times that.
    assert np.sqrt((ratio**2).mean()) == pytest.approx(1.0, abs=0.21)
    assert abs(ratio.mean()) < 0.3


def test_the_uncertainty_of_the_spacing_is_part_of_that_of_the_velocity() -> None:
    found = light_gate(*gate(628.63e-6, 0.0, 0), spacing_m=0.04, sd_spacing_m=0.0004)
    assert found.sd_velocity_m_s == pytest.approx(0.01 * found.velocity_m_s, rel=1e-3)


def darkened(time_s: np.ndarray, at_s: float) -> np.ndarray:
    """A barrier that stays dark because the ball is still in it at the end of the record."""
    return 1 / (1 + np.exp(-(time_s - at_s) / 15e-6))


@pytest.mark.parametrize("first_s", [400e-6, 1200e-6])
@pytest.mark.parametrize("shape", [darkened, barrier])
def test_barriers_that_stay_dark_or_are_cut_off_have_the_delay_of_their_edges(shape, first_s: float) -> None:
    # With the first at 1200 us the second is dark from 1829 us on, and the record ends at 2000.
    delay, time_s, ratios = 628.63e-6, INTERVAL_S * np.arange(COUNT), []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        first = 2.0 - shape(time_s, first_s) + 0.01 * rng.normal(size=COUNT)
        second = 1.0 - 0.8 * shape(time_s, first_s + delay) + 0.01 * rng.normal(size=COUNT)
        found = light_gate(time_s, first, second, spacing_m=0.04)
        assert found.correlation > 0.999
        ratios.append((found.delay_s - delay) / found.sd_delay_s)
    # 20 values give the root mean square to 16 %: three times that.
    assert np.sqrt((np.array(ratios) ** 2).mean()) == pytest.approx(1.0, abs=0.48)


def step(at: np.ndarray) -> np.ndarray:
    return np.where(at >= 0, 1.0, 0.0)


def lagging(at: np.ndarray) -> np.ndarray:
    """An edge behind a filter of first order."""
    return 1 - np.exp(-np.maximum(at, 0) / 0.5)


def smooth(at: np.ndarray) -> np.ndarray:
    return 0.5 + 0.5 * np.tanh(2 * at)


@pytest.mark.parametrize("stays_dark", [False, True])
@pytest.mark.parametrize(
    ("edge", "samples", "noise", "least"),
    [
        (step, 1.0, 0.0, 0.61),
        (step, 1.0, 0.02, 0.61),
        (lagging, 0.5, 0.02, 0.4),
        (lagging, 3.0, 0.02, 0.4),
        (smooth, 3.0, 0.02, 0.4),
        (smooth, 30.0, 0.02, 0.61),
    ],
)
def test_an_edge_is_known_as_well_as_its_samples_tell(
    edge, samples: float, noise: float, least: float, stays_dark: bool
) -> None:
    # Edges at random places between the samples, from steps to slow ones.
    rng, ratios, at = np.random.default_rng(0), [], np.arange(800.0)
    for _ in range(30):
        first, delay, dark = rng.uniform((160, 230, 80), (161, 231, 81))
        signals = []
        for place in (first, first + delay):
            signal = edge((at - place) / samples) - (0 if stays_dark else edge((at - place - dark) / samples))
            signals.append(signal + noise * rng.normal(size=len(at)))
        found = light_gate(INTERVAL_S * at, signals[0], 0.8 * signals[1], spacing_m=0.04)
        ratios.append((found.delay_s - INTERVAL_S * delay) / found.sd_delay_s)
    # 30 values give a root mean square to 13 %: three times that. An edge of a few samples is stated wider.
    assert least < np.sqrt(np.square(ratios).mean()) < 1.39


def test_the_delay_of_steps_is_uncertain_by_the_distance_of_the_samples() -> None:
    at = np.arange(800.0)
    # Each of two steps lies anywhere in an interval: the root of 2 / 12; of two pulses, the mean of two such delays.
    for dark, samples in ((np.inf, math.sqrt(2 / 12)), (80, math.sqrt(1 / 12))):
        signals = [step(at - place) - step(at - place - dark) for place in (160.5, 390.5)]
        found = light_gate(INTERVAL_S * at, *signals, spacing_m=0.04)
        assert found.delay_s == pytest.approx(230 * INTERVAL_S, abs=1e-9)
        assert found.sd_delay_s == pytest.approx(samples * INTERVAL_S, rel=0.02)


@pytest.mark.parametrize("case", ["noise", "turned over"])
def test_signals_of_two_shapes_have_no_velocity(case: str) -> None:
    time_s, first, second = gate(628.63e-6, 0.05, 3)
    if case == "noise":
        second = np.random.default_rng(4).normal(size=COUNT)
    else:
        second = -second
    with pytest.raises(ValueError, match="give the part of both that holds the whole event"):
        light_gate(time_s, first, second, spacing_m=0.04)


def test_two_signals_of_one_barrier_are_refused() -> None:
    time_s, first, _ = gate(628.63e-6, 0.05, 3)
    with pytest.raises(ValueError, match="light_gate"):
        light_gate(time_s, first, first, spacing_m=0.04)


@pytest.fixture(scope="module")
def truth() -> Pulse:
    return pulse(21, NOISES_M[0])


@pytest.fixture(scope="module")
def motion(truth: Pulse) -> Kinematics:
    return ts.kinematics(truth.track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG)


def test_an_accelerometer_is_aligned_with_the_track_to_a_tenth_of_a_frame(truth: Pulse, motion: Kinematics) -> None:
    clock, rng = 0.0123, np.random.default_rng(5)
    time_s = 0.011 + 1e-6 * np.arange(5000)
    share = np.clip((time_s - clock - truth.edges_s[0]) * RATE / LENGTH, 0, 1)
    top = PEAK_N / MASS_KG
    sensor = -top * np.sin(np.pi * share) + 50.0 + 0.02 * top * rng.normal(size=len(time_s))
    found = align(motion, time_s, sensor, direction=np.array([1.0, 0.0]))
    assert abs(found.delay_s - clock) < min(3 * found.sd_delay_s, 0.1 / RATE)
    assert found.peak_track_m_s2 == pytest.approx(-top, rel=0.03)
    assert found.peak_sensor_m_s2 == pytest.approx(-top, rel=0.03)
    change = -2 / np.pi * top * LENGTH / RATE
    assert found.change_track_m_s == pytest.approx(change, rel=0.02)
    assert found.change_sensor_m_s == pytest.approx(change, rel=0.02)
    assert found.rms_difference_m_s2 < 0.02 * top
    assert found.gain == pytest.approx(1.0, abs=0.02)
    assert found.correlation > 0.99


@pytest.mark.parametrize("length", [4.0, 6.3, 9.0, 14.0])
@pytest.mark.parametrize("start", [12.0, 12.4, 12.7])
def test_sensor_and_track_of_one_pulse_have_one_size(length: float, start: float) -> None:
    # 0.5 % apart at 9 frames and 2.5 % at 4, where only the sensor was taken as means over a frame.
    def passed(time: np.ndarray) -> np.ndarray:
        return np.clip((time - start) / length, 0, 1)

    frames, moments = np.arange(40.0), 0.01 * np.arange(4000)
    push = np.stack((-np.sin(np.pi * passed(frames)), np.zeros(40)), 1)
    slowed = np.stack((-0.5 * length * 2 / np.pi * (1 - np.cos(np.pi * passed(frames))), np.zeros(40)), 1)
    exact = SimpleNamespace(time_s=frames, velocity_m_s=slowed, sd_velocity_m_s=0 * slowed, acceleration_m_s2=push)
    found = align(exact, moments, -np.sin(np.pi * passed(moments)), direction=np.array([1.0, 0.0]))
    assert found.gain == pytest.approx(1.0, abs=0.003)
    assert found.delay_s == pytest.approx(0.0, abs=0.02)
    assert (found.change_track_m_s, found.change_sensor_m_s) == pytest.approx((-length * 2 / np.pi,) * 2, rel=0.002)


@pytest.mark.parametrize(
    ("factor", "sentence"),
    [
        (1.0, ""),
        (1 / 9.9, "as if its signal were in g, and taken as in m/s^2"),
        (9.6, "as if its signal were in m/s^2, and taken as in g"),
        (1e-3, "a unit a thousand times as large"),
        (3.0, "check its unit"),
    ],
)
def test_a_gain_as_of_a_wrong_unit_is_a_warning(factor: float, sentence: str, truth: Pulse, motion: Kinematics) -> None:
    time_s, rng, top = 1e-6 * np.arange(3000), np.random.default_rng(5), PEAK_N / MASS_KG
    share = np.clip((time_s - truth.edges_s[0]) * RATE / LENGTH, 0, 1)
    sensor = -top * np.sin(np.pi * share) + 0.02 * top * rng.normal(size=len(time_s))
    warnings = align(motion, time_s, factor * sensor, direction=np.array([1.0, 0.0])).warnings
    assert len(warnings) == bool(sentence)
    assert sentence in " ".join(warnings)


@pytest.mark.parametrize("case", ["nothing but noise", "turned over", "cut in the middle"])
def test_a_sensor_without_the_event_of_the_track_is_refused(case: str, truth: Pulse, motion: Kinematics) -> None:
    time_s, rng, top = 1e-6 * np.arange(3000), np.random.default_rng(5), PEAK_N / MASS_KG
    if case == "cut in the middle":
        time_s = time_s + truth.edges_s.mean()
    share = np.clip((time_s - truth.edges_s[0]) * RATE / LENGTH, 0, 1)
    height = {"nothing but noise": 0.0, "turned over": 1.0}.get(case, -1.0)
    sensor = height * top * np.sin(np.pi * share) + 0.02 * top * rng.normal(size=len(time_s))
    with pytest.raises(ValueError, match="give the part of both that holds the whole event"):
        align(motion, time_s, sensor, direction=np.array([1.0, 0.0]))


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"spacing_m": 0.0}, "spacing_m"),
        ({"first": np.ones(COUNT)}, "constant"),
        ({"second": np.where(np.arange(COUNT) == 7, np.nan, 1.0)}, "finite numbers, got nan at 7 and 1 such"),
        ({"first": np.ones(3)}, "numbers"),
    ],
)
def test_an_invalid_gate_is_refused(change: dict, word: str) -> None:
    time_s, first, second = gate(628e-6, 0.0, 0)
    arguments = {"first": first, "second": second, "spacing_m": 0.04} | change
    with pytest.raises(ValueError, match=word):
        light_gate(time_s, **arguments)


def test_a_record_that_lies_between_two_frames_is_refused() -> None:
    frames = np.arange(20.0)
    push = np.stack((np.clip(frames - 8, 0, 4), np.zeros(20)), 1)
    motion = SimpleNamespace(
        time_s=frames, velocity_m_s=push.cumsum(0), sd_velocity_m_s=0 * push + 0.1, acceleration_m_s2=push
    )
    time_s = 0.01 * np.arange(30)
    with pytest.raises(ValueError, match=r"do not overlap|No delay|not of one shape"):
        align(motion, time_s, time_s.copy(), direction=np.array([1.0, 0.0]))


def test_a_gate_is_compared_with_the_velocity_across_its_barriers() -> None:
    velocity, sd = np.tile([40.0, 30.0], (4, 1)), np.tile([0.1, 0.2], (4, 1))
    motion = SimpleNamespace(time_s=np.arange(4.0), velocity_m_s=velocity, sd_velocity_m_s=sd, acceleration_m_s2=sd)
    assert mean_speed(motion, math.inf) == pytest.approx((50.0, math.hypot(0.8 * 0.1, 0.6 * 0.2)))
    assert mean_speed(motion, math.inf, np.array([2.0, 0.0])) == pytest.approx((40.0, 0.1))
    assert mean_speed(motion, math.inf, np.array([0.0, 1.0])) == pytest.approx((30.0, 0.2))


def test_barriers_in_the_wrong_order_are_refused() -> None:
    time_s, first, second = gate(628e-6, 0.0, 0)
    with pytest.raises(ValueError, match="swap"):
        light_gate(time_s, second, first, spacing_m=0.04)


SHAPES = {
    "first": np.arange(COUNT) == 0,
    "last": np.arange(COUNT) == COUNT - 1,
    "spike": np.arange(COUNT) == 900,
    "step": np.arange(COUNT) > 400,
    "late step": np.arange(COUNT) > 900,
    "huge": 1e300 * (np.arange(COUNT) > 400),
    "tiny": 1e-300 * (np.arange(COUNT) > 800),
    "ramp": np.arange(COUNT),
    "noise": np.random.default_rng(0).normal(size=COUNT),
}


@pytest.mark.parametrize("first", SHAPES)
def test_signals_of_any_shape_and_height_give_a_velocity_or_one_sentence(first: str) -> None:
    # The tests take every warning of NumPy as an error.
    time_s = INTERVAL_S * np.arange(COUNT)
    for second in SHAPES.values():
        with contextlib.suppress(ValueError):
            found = light_gate(time_s, SHAPES[first], second, spacing_m=0.04)
            assert found.velocity_m_s > 0
            assert np.isfinite([found.velocity_m_s, found.sd_velocity_m_s]).all()


def test_the_velocity_by_a_gate_is_independent_of_the_height_of_its_signals() -> None:
    time_s, first, second = gate(628.63e-6, 0.01, 3)
    usual = light_gate(time_s, first, second, spacing_m=0.04)
    for factor in (1e-200, 1e200):
        found = light_gate(time_s, factor * first, second, spacing_m=0.04)
        assert found.velocity_m_s == pytest.approx(usual.velocity_m_s, rel=1e-9)
        assert found.sd_velocity_m_s == pytest.approx(usual.sd_velocity_m_s, rel=1e-6)


def test_a_track_of_constant_acceleration_has_no_event_to_align() -> None:
    steady = replace(pulse(21, NOISES_M[0]).track)
    frames = np.arange(len(steady.status))
    steady.position[:] = np.stack((3.0 * frames, 0.0 * frames), 1)
    steady.increment[:] = [3.0, 0.0, 0.0, 0.0, 0.0]
    motion = ts.kinematics(steady, frame_rate=RATE, m_per_px=M_PER_PX, method="differences")
    time_s = 1e-6 * np.arange(1600)
    sensor = np.exp(-0.5 * ((time_s - 8e-4) / 6e-5) ** 2)
    with pytest.raises(ValueError, match=r"constant|No delay"):
        align(motion, time_s, sensor, direction=np.array([1.0, 0.0]))


@pytest.mark.parametrize("error", [-1e-3, 1e-3])
def test_a_delay_of_whole_samples_is_found_although_a_sample_comes_and_goes_with_it(error: float) -> None:
    def signal(at: np.ndarray) -> np.ndarray:
        return np.exp(-(((at - 170) / 30) ** 2)) + 5e-3 * at

    at = np.arange(400.0)
    late = signal(at - 50 + 5e-7)
    # Sample 50 lies over sample 0 of the other signal at delays below 50, and over none above.
    late[50] += error
    assert fit_delay(signal(at), late, 50.0).delay == pytest.approx(50, abs=1e-3)
