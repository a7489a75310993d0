"""Force by a bar's strain gauge: half a sine of force, its wave at the gauge, and its echoes, all known exactly."""

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from pulses import LENGTH, M_PER_PX, MASS_KG, NOISES_M, PEAK_N, RATE, Pulse, pulse

from torchsphere.dynamics.kinematics import Kinematics, kinematics_of_many
from torchsphere.instruments.bar import Bar, bar
from torchsphere.instruments.strain_gauge import BarForce, compare_bar

#: A round steel bar of 40 mm, with a gauge half a metre from the end that the ball hits.
STEEL = bar(modulus_pa=210e9, density_kg_m3=7850.0, diameter_m=0.04, distance_m=0.5)

#: Time of the record's clock at time 0 of the track, s, and interval of the record.
CLOCK_S, INTERVAL_S = 0.0123, 1e-6

#: The ball flies to the right and hits the end of the bar: from the bar to the ball is to the left.
LEFT = (-1.0, 0.0)


#: Seeds of the shots of repetitions, which the smoother takes at once, and of the shot of the other tests.
REPEATED, SINGLE = range(12), 21


@cache
def shots() -> dict[int, tuple[Pulse, Kinematics]]:
    """All shots and their motions."""
    truths = [pulse(seed, NOISES_M[0]) for seed in (*REPEATED, SINGLE)]
    given = {"frame_rate": RATE, "m_per_px": M_PER_PX, "mass_kg": MASS_KG, "log": False}
    motions = kinematics_of_many([truth.track for truth in truths], **given)
    return dict(zip((*REPEATED, SINGLE), zip(truths, motions, strict=True), strict=True))


def shot(seed: int) -> tuple[Pulse, Kinematics]:
    return shots()[seed]


def force_at_end(time_s: np.ndarray, truth: Pulse) -> np.ndarray:
    """The true force on the end of the bar, N."""
    share = (time_s - truth.edges_s[0]) * RATE / LENGTH
    return np.where((share > 0) & (share < 1), PEAK_N * np.sin(np.pi * share), 0.0)


def record(truth: Pulse, bar: Bar, *, noise: float = 0.0, seed: int = 0, factor: float = 1.0, samples: int = 2500):
    """Times and strains (m,) of the gauge, compression negative, with an offset, and the echoes of a bar with an end.

    The far end turns compression into tension, the struck end, which the ball has left, turns this back.
    """
    time_s = CLOCK_S - 4e-4 + INTERVAL_S * np.arange(samples)
    at_gauge = time_s - CLOCK_S - bar.travel_s
    force = force_at_end(at_gauge, truth)
    if bar.length_m is not None:
        for k in range(40):
            force = force - force_at_end(at_gauge - bar.clear_s - k * bar.echo_s, truth)
            force = force + force_at_end(at_gauge - (k + 1) * bar.echo_s, truth)
    strain = -factor * force / (bar.modulus_pa * bar.area_m2) + 3e-5
    return time_s, strain + noise * np.random.default_rng(seed).normal(size=samples)


def compared(number: int, bar: Bar = STEEL, given: dict | None = None, **recorded) -> BarForce:
    truth, motion = shot(number)
    time_s, strain = record(truth, bar, **recorded)
    options = {"mass_kg": MASS_KG, "contact_s": motion.contact_s, "direction": LEFT} | (given or {})
    return compare_bar(motion, time_s, strain, bar, **options)


def test_the_wave_speed_of_steel_and_the_strain_of_a_known_force() -> None:
    # sqrt(210e9 / 7850) = 5172 m/s: 96.7 us from the end to the gauge.
    assert STEEL.wave_speed_m_s == pytest.approx(5172.2, abs=0.1)
    assert STEEL.travel_s == pytest.approx(96.67e-6, abs=0.01e-6)
    # 29 kN on 1257 mm2 of steel: 110 microstrain, twice: by modulus and area, and by density, speed and area.
    assert STEEL.area_m2 == pytest.approx(1256.6e-6, abs=0.1e-6)
    assert PEAK_N / (STEEL.modulus_pa * STEEL.area_m2) == pytest.approx(109.9e-6, abs=0.1e-6)
    assert 7850.0 * STEEL.wave_speed_m_s**2 == pytest.approx(STEEL.modulus_pa)


def test_a_ball_that_flies_to_the_right_into_a_bar_is_pushed_to_the_left_while_the_bar_is_compressed() -> None:
    found = compared(SINGLE)
    truth, motion = shot(SINGLE)
    assert motion.velocity_m_s[2, 0] > 0
    # Positive is away from the bar, here to the left: against x.
    # The mean of half a sine over a 14th of its length is 0.2 % below its peak.
    assert found.peak_track_N == pytest.approx(-motion.force_N[:, 0].min(), rel=4e-3)
    assert found.peak_bar_N == pytest.approx(PEAK_N, rel=0.01)
    _, strain = record(truth, STEEL)
    assert strain.min() == pytest.approx(3e-5 - 109.9e-6, abs=1e-7)
    assert found.impulse_track_N_s == pytest.approx(2 / np.pi * PEAK_N * LENGTH / RATE, rel=1e-3)


def test_without_noise_delay_peak_and_impulse_are_those_of_the_half_sine() -> None:
    found = compared(SINGLE)
    assert found.delay_s == pytest.approx(CLOCK_S, abs=0.02 / RATE)
    assert found.travel_s == STEEL.travel_s
    assert found.gain == pytest.approx(1.0, abs=5e-3)
    assert found.correlation > 0.9999
    assert found.impulse_bar_N_s == pytest.approx(2 / np.pi * PEAK_N * LENGTH / RATE, rel=2e-3)
    assert found.rms_difference_N < 0.003 * PEAK_N
    assert found.valid_until_s is None


def test_the_standard_deviations_are_those_of_repetitions() -> None:
    # Noise of a twentieth of the peak on each sample.
    ratios, true = [], 2 / np.pi * PEAK_N * LENGTH / RATE
    for seed in REPEATED:
        found = compared(seed, noise=5.5e-6, seed=seed)
        ratios.append(
            (
                (found.delay_s - CLOCK_S) / found.sd_delay_s,
                (found.impulse_bar_N_s - true) / found.sd_impulse_bar_N_s,
                (found.gain - 1) / found.sd_gain,
                found.rms_difference_N / found.expected_rms_difference_N,
            )
        )
        assert abs(found.impulse_track_N_s - true) < 4 * found.sd_impulse_track_N_s
        assert 0.05 < found.sd_rms_difference_N / found.rms_difference_N < 0.4
        # The peak is the largest of about three frames near the top.
        assert abs(found.peak_bar_N - PEAK_N) < 4 * found.sd_peak_bar_N
    # Twelve values give a root mean square to a fifth: three times that.
    np.testing.assert_allclose(np.sqrt(np.square(ratios).mean(0)), 1.0, atol=0.6)


def test_the_uncertainty_of_the_bar_is_part_of_peak_impulse_and_ratio() -> None:
    found = compared(SINGLE, replace(STEEL, relative_sd=0.02), factor=1.02)
    assert found.gain - 1 == pytest.approx(found.sd_gain, rel=0.1)
    assert found.sd_peak_bar_N == pytest.approx(0.02 * found.peak_bar_N, rel=0.02)
    assert found.sd_impulse_bar_N_s == pytest.approx(0.02 * found.impulse_bar_N_s, rel=1e-3)


def test_several_gauges_are_averaged_so_that_bending_cancels() -> None:
    truth, motion = shot(SINGLE)
    time_s, strain = record(truth, STEEL)
    bending = 4e-5 * np.sin(2e4 * time_s)
    given = {"mass_kg": MASS_KG, "contact_s": motion.contact_s, "direction": LEFT}
    both = compare_bar(motion, time_s, [strain + bending, strain - bending], STEEL, **given)
    alone = compare_bar(motion, time_s, strain, STEEL, **given)
    np.testing.assert_allclose(both.bar_N, alone.bar_N, rtol=1e-9, atol=1e-6)
    assert both.delay_s == pytest.approx(alone.delay_s, abs=1e-9)


def test_a_clipped_gauge_is_named() -> None:
    truth, motion = shot(SINGLE)
    time_s, strain = record(truth, STEEL, noise=1e-7)
    given = {"mass_kg": MASS_KG, "contact_s": motion.contact_s, "direction": LEFT}
    assert compare_bar(motion, time_s, [strain, strain], STEEL, **given).warnings == ()
    (warning,) = compare_bar(motion, time_s, [strain, np.maximum(strain, -5e-5)], STEEL, **given).warnings
    assert warning.startswith("Strain gauge 2 has the value -5e-05, which it does not pass, in ")


def test_a_record_with_positive_compression_needs_its_option() -> None:
    truth, motion = shot(SINGLE)
    time_s, strain = record(truth, STEEL)
    given = {"mass_kg": MASS_KG, "contact_s": motion.contact_s, "direction": LEFT}
    turned = compare_bar(motion, time_s, -strain, STEEL, compression_positive=True, **given)
    usual = compare_bar(motion, time_s, strain, STEEL, **given)
    np.testing.assert_allclose(turned.bar_N, usual.bar_N, rtol=1e-9, atol=1e-6)
    for delay in (None, CLOCK_S):
        with pytest.raises(ValueError, match="compression_positive"):
            compare_bar(motion, time_s, -strain, STEEL, delay_s=delay, **given)


def test_from_the_reflection_on_there_is_no_force() -> None:
    # 0.9 m behind the gauge and back: 348 us, more than the contact of 280 us.
    long = replace(STEEL, length_m=1.4)
    found = compared(SINGLE, long)
    truth, _ = shot(SINGLE)
    # The mean over a frame of 20 us ends half a frame earlier; the track knows the contact's start to 2 us.
    assert found.valid_until_s == pytest.approx(truth.edges_s[0] + 1.8 / STEEL.wave_speed_m_s - 1e-5, abs=2e-6)
    late = found.time_s > found.valid_until_s
    assert late.any()
    assert np.isnan(found.bar_N[late]).all()
    assert np.isfinite(found.bar_N[~late]).all()
    assert found.delay_s == pytest.approx(CLOCK_S, abs=0.02 / RATE)
    assert found.impulse_bar_N_s == pytest.approx(found.impulse_track_N_s, rel=3e-3)


def test_a_reflection_during_the_contact_cuts_peak_and_impulses_of_both_alike() -> None:
    # 0.5 m behind the gauge and back: 193 us of the 280 us.
    found = compared(SINGLE, replace(STEEL, length_m=1.0))
    truth, _ = shot(SINGLE)
    assert found.delay_s == pytest.approx(CLOCK_S, abs=0.05 / RATE)
    assert found.impulse_bar_N_s == pytest.approx(found.impulse_track_N_s, rel=0.01)
    assert found.impulse_track_N_s < 0.8 * 2 / np.pi * PEAK_N * LENGTH / RATE
    assert found.peak_bar_N == pytest.approx(PEAK_N, rel=0.02)
    last = found.time_s[np.isfinite(found.bar_N)][-1]
    # The change of momentum of half a sine up to the last frame.
    share = (last - truth.edges_s[0]) * RATE / LENGTH
    partial = PEAK_N * LENGTH / RATE / np.pi * (1 - math.cos(math.pi * share))
    assert found.impulse_track_N_s == pytest.approx(partial, rel=2e-3)


def test_of_the_echoes_in_a_bar_the_first_passage_is_taken() -> None:
    # 773 us of travel to and fro in 2.5 ms of record: with noise a later passage may agree better.
    for seed in range(4):
        found = compared(seed, replace(STEEL, length_m=2.0), noise=4e-6, seed=seed)
        assert found.delay_s == pytest.approx(CLOCK_S, abs=0.2 / RATE)


def test_a_known_delay_is_taken_as_given_with_its_uncertainty() -> None:
    late = 2e-6
    found = compared(SINGLE, given={"delay_s": CLOCK_S + late, "sd_delay_s": late})
    assert found.delay_s == CLOCK_S + late
    assert found.sd_delay_s == late
    slope = np.abs(np.gradient(found.track_N, found.time_s))
    steep = slope.argmax()
    assert found.sd_bar_N[steep] == pytest.approx(slope[steep] * late, rel=0.15)
    assert found.rms_difference_N < 2 * found.expected_rms_difference_N
    times = [compared(SINGLE, given={"delay_s": CLOCK_S + shift}).rms_difference_N for shift in (0.0, 1e-5, 2e-5)]
    assert all(a < b for a, b in pairwise(times))


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"modulus_pa": math.nan}, "modulus_pa"),
        ({"modulus_pa": 210.0}, "wave speed of 0.1636 m/s"),
        ({"diameter_m": None}, "either its cross-section"),
        ({"area_m2": 1e-3}, "either its cross-section"),
        ({"density_kg_m3": None}, "either its density"),
        ({"wave_speed_m_s": 5e3}, "either its density"),
        ({"distance_m": -0.1}, "distance_m"),
        ({"length_m": 0.4}, "more than the gauge's distance"),
        ({"relative_sd": 1.0}, "relative_sd"),
    ],
)
def test_a_bar_with_missing_or_wrong_values_is_refused(change: dict, word: str) -> None:
    values = {"modulus_pa": 210e9, "density_kg_m3": 7850.0, "diameter_m": 0.04, "distance_m": 0.5} | change
    with pytest.raises(ValueError, match=word):
        bar(**values)


@pytest.mark.parametrize("case", ["microstrain", "modulus", "later", "cut", "no zero", "noise", "constant", "slow"])
def test_a_record_that_cannot_be_compared_is_refused_in_one_sentence(case: str) -> None:
    truth, motion = shot(SINGLE)
    time_s, strain = record(truth, STEEL)
    used, given = STEEL, {"mass_kg": MASS_KG, "contact_s": motion.contact_s, "direction": LEFT}
    middle = CLOCK_S + truth.edges_s.mean() + STEEL.travel_s
    word = {
        "microstrain": "1 microstrain is 1e-6",
        "modulus": "check the units",
        "later": "0 frames of the contact",
        "cut": "samples before the wave arrives",
        "no zero": "samples before the wave arrives",
        "noise": "compression_positive",
        "constant": "constant",
        "slow": "longer than the camera's",
    }[case]
    if case == "microstrain":
        strain = 1e6 * strain
    elif case == "modulus":
        # The modulus in MPa would give a wrong wave speed, which is given here.
        used = replace(STEEL, modulus_pa=210e6)
    elif case == "later":
        given["delay_s"] = CLOCK_S - 1.0
    elif case == "cut":
        time_s, strain = time_s[time_s > middle], strain[time_s > middle]
        given["delay_s"] = CLOCK_S
    elif case == "no zero":
        keep = time_s > CLOCK_S + truth.edges_s[0] + STEEL.travel_s + 1e-5
        time_s, strain = time_s[keep], strain[keep]
        given["delay_s"] = CLOCK_S
    elif case == "noise":
        strain = 1e-5 * np.random.default_rng(5).normal(size=len(strain))
    elif case == "constant":
        strain = np.full(len(strain), 1e-5)
    else:
        time_s, strain = time_s[::30], strain[::30]
    with pytest.raises(ValueError, match=word):
        compare_bar(motion, time_s, strain, used, **given)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"mass_kg": 0.0}, "mass_kg"),
        ({"contact_s": (2.0, 1.0)}, "contact_s"),
        ({"direction": (0.0, 0.0)}, "direction"),
        ({"delay_s": math.inf}, "delay_s"),
    ],
)
def test_invalid_numbers_are_refused(change: dict, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        compared(SINGLE, given=change)
