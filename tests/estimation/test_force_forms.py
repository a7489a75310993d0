"""Envelopes of the force against curves that are known, and against an integrated contact of Hertz."""

import hertz_impact
import numpy as np
import pytest

from torchsphere.estimation.force_forms import (
    DECAY,
    FALLING,
    FORMS,
    HERTZ,
    ONSET,
    RISEN,
    ROUGH,
    ROUGHNESS,
    SMOOTH,
    envelope,
)

SHARE = np.linspace(0.0, 1.0, 2001)


def curve(onset: float, decay: float, risen: float = 0.0, falling: float = 1.0) -> np.ndarray:
    """Envelope (2001,) of one form at `SHARE`."""
    return envelope(SHARE, np.array([onset, decay, risen, falling, SMOOTH, 0.0]))


@pytest.mark.parametrize("form", FORMS)
def test_every_envelope_is_0_at_both_ends_and_outside_and_1_at_its_largest(form: tuple[float, ...]) -> None:
    inside = envelope(SHARE, np.array(form))
    # A cosine of a right angle is 6e-17, which a power of 0.5 would make 8e-9.
    np.testing.assert_allclose(inside[[0, -1]], 0.0, atol=1e-12)
    assert np.all(inside[1:-1] > 0)
    assert inside.max() == pytest.approx(1.0, abs=1e-6)
    outside = np.array([-1.0, -1e-9, 1.0 + 1e-9, 7.0])
    np.testing.assert_array_equal(envelope(outside, np.array(form)), 0.0)


def test_equal_powers_are_powers_of_a_sine() -> None:
    for power in (1.0, 1.25, 1.5, 2.0):
        np.testing.assert_allclose(curve(power, power), np.sin(np.pi * SHARE).clip(0) ** power, atol=1e-12)


def test_a_half_sine_and_a_squared_sine_have_the_known_integrals() -> None:
    for power, integral in ((1.0, 2 / np.pi), (2.0, 0.5)):
        assert np.trapezoid(curve(power, power), SHARE) == pytest.approx(integral, rel=1e-6)


@pytest.mark.parametrize(("onset", "decay"), [(1.0, 2.0), (1.5, 2.0), (2.0, 1.0)])
def test_a_force_begins_and_ends_with_its_powers_and_the_swapped_powers_are_its_mirror_image(
    onset: float, decay: float
) -> None:
    force, near = curve(onset, decay), slice(1, 20)
    np.testing.assert_allclose(force, curve(decay, onset)[::-1], atol=1e-12)
    # The cosine has fallen by 1e-4 at a hundredth of the contact.
    for end, power in ((force, onset), (force[::-1], decay)):
        np.testing.assert_allclose(end[near] / end[1], (SHARE[near] / SHARE[1]) ** power, rtol=1e-3)
    # The largest force is where both powers balance: tan^2 of the angle is their ratio.
    assert SHARE[force.argmax()] == pytest.approx(2 / np.pi * np.arctan(np.sqrt(onset / decay)), abs=1e-3)


@pytest.mark.parametrize(("risen", "falling"), [(0.5, 0.5), (0.25, 0.75), (0.03, 0.6)])
def test_a_form_with_kinks_consists_of_straight_lines_between_them(risen: float, falling: float) -> None:
    corners = ([0.0, risen, falling, 1.0], [0.0, 1.0, 1.0, 0.0])
    np.testing.assert_allclose(curve(0.0, 0.0, risen, falling), np.interp(SHARE, *corners), atol=1e-12)


def test_forms_and_shares_in_a_batch_have_the_envelopes_that_they_have_alone() -> None:
    forms = np.array(FORMS)
    shares = np.random.default_rng(1).uniform(-0.2, 1.2, (3, len(forms), 7))
    both = envelope(shares, forms)
    for row in range(3):
        for number, form in enumerate(forms):
            # A processor may add up a long row in another order than a short one.
            alone = envelope(shares[row, number], form)
            np.testing.assert_allclose(both[row, number], alone, rtol=1e-14, atol=1e-15)


def test_the_form_of_hertz_is_the_force_of_the_integrated_contact() -> None:
    made = hertz_impact.contact(14)
    force = np.interp(SHARE, made.time_s / made.time_s[-1], made.force_N) / made.force_N.max()
    (form,) = (form for form in FORMS if form[HERTZ])
    # The steps of the integration err by 1e-4 in the duration.
    np.testing.assert_allclose(envelope(SHARE, np.array(form)), force, atol=3e-4)
    # A sine to the same power starts alike but is larger by 2.4 % of the largest force on the way to it.
    assert np.abs(curve(1.5, 1.5) - force).max() == pytest.approx(0.024, abs=0.001)


def test_smooth_forms_stand_beside_rough_ones_and_forms_of_straight_lines() -> None:
    forms = np.array(FORMS)
    kinked = forms[:, RISEN] > 0
    assert set(forms[:, ROUGHNESS]) == {SMOOTH, ROUGH}
    assert np.all(forms[kinked][:, [ONSET, DECAY]] == 0)
    assert np.all(forms[kinked, RISEN] <= forms[kinked, FALLING])
    assert np.all(forms[~kinked][:, [RISEN, FALLING]] == [0, 1])
