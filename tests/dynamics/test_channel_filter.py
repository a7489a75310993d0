"""Channel frequency classes: gains of the standards, constants and ramps, gaps, ends, and standard deviations."""

import numpy as np
import pytest

from torchsphere.dynamics.channel_filter import channel_filter, channel_filter_sd, coefficients
from torchsphere.settings.choices import CHANNEL_CLASSES

RATE = 50e3


def gain_db(frequency: float, cfc: int) -> float:
    time = np.arange(20_000) / RATE
    filtered = channel_filter(np.sin(2 * np.pi * frequency * time), RATE, cfc)[5000:15_000]
    wave = np.exp(-2j * np.pi * frequency * time[5000:15_000])
    # The amplitude by a fit of both phases: a maximum of samples would miss the crest.
    basis = np.stack((wave.real, wave.imag), 1)
    return float(20 * np.log10(np.linalg.norm(np.linalg.lstsq(basis, filtered, rcond=None)[0])))


@pytest.mark.parametrize(("cfc", "frequency"), [(60, 100.0), (180, 300.0), (600, 1000.0), (1000, 1650.0)])
def test_each_class_loses_3_db_at_the_frequency_of_the_standard_and_6_at_its_design(cfc: int, frequency: float) -> None:
    # ISO 6487 and SAE J211 round the frequencies: 1650 Hz is 1.65 classes, the others are 1.667.
    assert gain_db(frequency, cfc) == pytest.approx(-3.0, abs=0.15)
    assert gain_db(2.0775 * cfc, cfc) == pytest.approx(2 * -3.0103, abs=0.001)
    # The standards allow +0.5 to -1 dB up to the class's own frequency.
    assert -1.0 < gain_db(cfc, cfc) < 0.0


@pytest.mark.parametrize("cfc", CHANNEL_CLASSES)
def test_the_coefficients_are_those_of_sae_j211(cfc: int) -> None:
    wd = 2 * np.pi * cfc * 2.0775
    wa = np.sin(wd / RATE / 2) / np.cos(wd / RATE / 2)
    a0 = wa**2 / (1 + np.sqrt(2) * wa + wa**2)
    b1 = -2 * (wa**2 - 1) / (1 + np.sqrt(2) * wa + wa**2)
    b2 = (-1 + np.sqrt(2) * wa - wa**2) / (1 + np.sqrt(2) * wa + wa**2)
    own, past = coefficients(RATE, cfc)
    np.testing.assert_allclose(own, [a0, 2 * a0, a0], rtol=1e-12)
    # The standard adds the past outputs, a transfer function subtracts them.
    np.testing.assert_allclose(past, [1, -b1, -b2], rtol=1e-12)


@pytest.mark.parametrize("count", [1, 2, 5, 60, 3000])
def test_a_constant_stays_a_constant_however_short_the_run(count: int) -> None:
    np.testing.assert_allclose(channel_filter(np.full(count, 3.5), RATE, 180), 3.5, rtol=1e-12)


def test_a_ramp_stays_a_ramp_up_to_its_ends_and_nothing_is_delayed() -> None:
    ramp = np.linspace(0, 1, 500)
    np.testing.assert_allclose(channel_filter(ramp, RATE, 1000), ramp, atol=2e-5)
    pulse = np.exp(-(((np.arange(501) - 250) / 20) ** 2))
    filtered = channel_filter(pulse, RATE, 1000)
    np.testing.assert_allclose(filtered, filtered[::-1], atol=1e-6)
    # Area is kept: the gain at 0 Hz is 1.
    assert filtered.sum() == pytest.approx(pulse.sum(), rel=1e-4)


def test_runs_between_gaps_are_filtered_on_their_own_and_columns_too() -> None:
    values = np.random.default_rng(0).normal(size=(300, 2))
    values[100:110, 0] = np.nan
    filtered = channel_filter(values, RATE, 600)
    assert filtered.shape == values.shape
    np.testing.assert_array_equal(np.isnan(filtered), np.isnan(values))
    np.testing.assert_array_equal(filtered[:100, 0], channel_filter(values[:100, 0], RATE, 600))
    np.testing.assert_array_equal(filtered[110:, 0], channel_filter(values[110:, 0], RATE, 600))
    np.testing.assert_array_equal(filtered[:, 1], channel_filter(values[:, 1], RATE, 600))


@pytest.mark.parametrize("stencil", [(1.0,), (-1.0, 1.0), (1.0, -2.0, 1.0)])
@pytest.mark.parametrize("count", [7, 400, 1500])
def test_standard_deviations_are_those_of_the_filter_as_a_matrix(stencil: tuple[float, ...], count: int) -> None:
    sd = np.random.default_rng(1).uniform(0.5, 2.0, count + len(stencil) - 1)
    differences = sum(weight * np.eye(count, len(sd), k=shift) for shift, weight in enumerate(stencil))
    # The filter of each error's effect; the whole matrix, without the blocks and limits of the program.
    response = channel_filter(differences, RATE, 1000)
    expected = np.sqrt((response**2) @ sd**2)
    # Responses further away than the padding, 1e-4 of the largest, are left out.
    np.testing.assert_allclose(channel_filter_sd(sd, RATE, 1000, stencil), expected, rtol=1e-3)


def test_standard_deviations_are_nan_where_an_error_is_not_known() -> None:
    sd = np.ones((20, 2))
    sd[8, 1] = np.nan
    found = channel_filter_sd(sd, RATE, 1000, (1, -2, 1))
    assert found.shape == (18, 2)
    assert np.isfinite(found[:, 0]).all()
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found[:, 1])), [6, 7, 8])


@pytest.mark.parametrize("cfc", [0, 100, 1001, "60", None])
def test_a_class_that_the_standards_do_not_have_is_refused(cfc: object) -> None:
    with pytest.raises(ValueError, match="expected one of the channel frequency classes 60, 180, 600, 1000"):
        channel_filter(np.ones(50), RATE, cfc)


def test_a_rate_below_ten_times_the_class_is_refused_with_the_rate_that_is_needed() -> None:
    channel_filter(np.ones(50), 6000.0, 600)
    with pytest.raises(ValueError, match=r"5999 frames per second, and ISO 6487 and SAE J211 ask for at least 6000"):
        channel_filter(np.ones(50), 5999.0, 600)
    with pytest.raises(ValueError, match="rate_hz"):
        channel_filter(np.ones(50), -1.0, 60)
