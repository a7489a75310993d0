"""The processes of flight and contact against integrals over time that know nothing of states and steps."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import betaincinv

from torchsphere.estimation.force_forms import FORMS, ROUGH, ROUGHNESS
from torchsphere.estimation.process_model import (
    FLIGHT_STATES,
    SLOPE_VARIANCE,
    STATES,
    Transitions,
    end_variance,
    flight_matrix,
    integrator,
    transitions,
    white_noise,
)

START, LENGTH, FRAMES = 2.3, 14.0, 20

#: Frame 9 is missing.
TIMES = np.delete(np.arange(float(FRAMES)), 9)

#: The forms that are weighed, and two with other kinks.
ALL_FORMS = (*FORMS, (0.0, 0.0, 0.03, 0.4, ROUGH, 0.0), (0.0, 0.0, 0.87, 0.97, ROUGH, 0.0))

every_form = pytest.mark.parametrize("form", ALL_FORMS)


def force(share: float, form: tuple[float, ...]) -> float:
    """Force over its height, from its definition alone."""
    onset, decay, risen, falling, _, is_hertz = form
    if not 0 < share < 1:
        return 0.0
    if is_hertz:
        return float(betaincinv(0.4, 0.5, 1 - abs(2 * share - 1)) ** 0.6)
    if risen > 0:
        return float(np.interp(share, [0, risen, falling, 1], [0, 1, 1, 0]))
    top = np.arctan(np.sqrt(onset / decay))
    angle = np.pi / 2 * share
    return float((np.sin(angle) / np.sin(top)) ** onset * (np.cos(angle) / np.cos(top)) ** decay)


def steps_of(form: tuple[float, ...] | None, times: np.ndarray = TIMES, length: float = LENGTH) -> Transitions:
    """Transitions of one recording under one contact."""
    return transitions(times[None], np.array([[[START, START + length]]]), None if form is None else np.array([[form]]))


def driven(form: tuple[float, ...], first: float, last: float, height: float, rate: float) -> tuple[float, float]:
    """Rate and pose at ``last`` of a body at rest, whose force has a height and its rate at the time ``first``."""
    begin, end = max(first, START), min(last, START + LENGTH)
    breaks = [START + LENGTH * kink for kink in form[2:4]]
    inside = [kink for kink in breaks if begin < kink < end] or None

    def acceleration(time: float) -> float:
        return force((time - START) / LENGTH, form) * (height + rate * (time - first))

    def weighted(time: float) -> float:
        return (last - time) * acceleration(time)

    options = {"points": inside, "epsabs": 1e-13, "epsrel": 1e-12, "limit": 200}
    return quad(acceleration, begin, end, **options)[0], quad(weighted, begin, end, **options)[0]


@every_form
def test_a_height_moves_the_ball_as_its_force_integrated_twice(form: tuple[float, ...]) -> None:
    steps, height, rate = steps_of(form), 3.0, 0.2
    state = np.array([0.0, 0.0, 0.0, height, rate])
    for number in np.flatnonzero((TIMES[:-1] > START) & (TIMES[:-1] < START + LENGTH)):
        before, after = TIMES[number : number + 2]
        now = np.array([0.0, 0.0, 0.0, height + rate * (before - 3), rate])
        moved = steps.matrix[0, 0, number] @ now
        own_rate, own_pose = driven(form, before, after, now[3], rate)
        # Powers between whole numbers are no polynomials at the ends: 2e-6 of the height, there alone. Straight lines
        # are exact wherever their kinks lie.
        tolerance = 1e-11 if form[2] > 0 else 1e-5
        np.testing.assert_allclose(moved[:3], [own_pose, own_rate, 0.0], atol=tolerance)
        state = steps.matrix[0, 0, number] @ state
    own_rate, own_pose = driven(form, 3.0, after, height, rate)
    np.testing.assert_allclose(state[:2], [own_pose, own_rate], atol=1e-10 if form[2] > 0 else 1e-4)


@every_form
def test_the_envelope_at_the_frames_is_that_of_the_form(form: tuple[float, ...]) -> None:
    expected = [force((time - START) / LENGTH, form) for time in TIMES]
    np.testing.assert_allclose(steps_of(form).envelope[0, 0], expected, atol=1e-12)


@every_form
def test_outside_the_contact_there_is_no_force_and_no_state_of_it(form: tuple[float, ...]) -> None:
    steps = steps_of(form)
    duration = np.diff(TIMES)
    flies = (TIMES[1:] <= START) | (TIMES[:-1] >= START + LENGTH)
    np.testing.assert_array_equal(steps.matrix[0, 0, flies], flight_matrix(duration[flies]))
    np.testing.assert_array_equal(steps.contact[0, 0, flies], 0.0)
    # Nothing of the force enters the contact with the flight before, and nothing of it leaves.
    first, last = np.flatnonzero(~flies)[[0, -1]]
    np.testing.assert_array_equal(steps.matrix[0, 0, first, :, FLIGHT_STATES:], 0.0)
    np.testing.assert_array_equal(steps.matrix[0, 0, last, FLIGHT_STATES:], 0.0)
    np.testing.assert_array_equal(steps.contact[0, 0, last, FLIGHT_STATES:], 0.0)
    # The states of the force mean nothing from the end of the contact until its start.
    np.testing.assert_array_equal(steps.idle[0, 0], (TIMES[1:] <= START) | (TIMES[1:] >= START + LENGTH))


def test_an_interval_of_length_0_is_no_contact() -> None:
    for forms in (None, np.array([[FORMS[0]]])):
        steps = transitions(TIMES[None], np.full((1, 1, 2), 5.0), forms)
        np.testing.assert_array_equal(steps.matrix[0, 0], flight_matrix(np.diff(TIMES)))
        assert not steps.contact.any()
        assert not steps.envelope.any()
        assert steps.idle.all()


def passed(steps: Transitions) -> tuple[np.ndarray, np.ndarray]:
    """Matrix, and covariance that the contact adds, of all steps together."""
    matrix, covariance = np.eye(STATES), np.zeros((STATES, STATES))
    for one, added in zip(steps.matrix[0, 0], steps.contact[0, 0], strict=True):
        matrix, covariance = one @ matrix, one @ covariance @ one.T + added
    return matrix, covariance


#: Frames in the contact, and the error of the covariance of a rough form that is taken as a line in every step.
LENGTHS = ((1.5, 2e-2), (6.0, 1e-4), (14.0, 5e-6))


@pytest.mark.parametrize(("length", "tolerance"), LENGTHS)
@pytest.mark.parametrize("form", [None, *ALL_FORMS])
def test_two_half_steps_are_one_step(form: tuple[float, ...] | None, length: float, tolerance: float) -> None:
    times = np.arange(START + length + 2)
    halved = np.arange(2 * len(times) - 1) / 2
    (matrix, covariance), (finer, other) = (passed(steps_of(form, t, length)) for t in (times, halved))
    np.testing.assert_allclose(matrix, finer, rtol=1e-12)
    size = np.sqrt(np.diag(covariance)[:FLIGHT_STATES].clip(1e-300))
    off = (covariance - other)[:FLIGHT_STATES, :FLIGHT_STATES] / np.outer(size, size)
    assert np.abs(off[:2, :2]).max() < (1e-11 if form is None else tolerance)


@every_form
def test_the_covariance_of_a_contact_is_the_sum_over_all_moments_of_its_noise(form: tuple[float, ...]) -> None:
    roughness, count = form[ROUGHNESS], 4000
    share = (np.arange(count) + 0.5) / count
    own = np.array([force(one, form) for one in share])
    last = float(FRAMES - 1)
    weight = np.stack((own * (last - START - LENGTH * share), own)) * LENGTH / count  # pose and rate per acceleration
    # A height and its rate at the start, and what a unit of the height's rate adds from each moment on.
    height, rate = weight.sum(1), (weight * LENGTH * share).sum(1)
    since, until_end = LENGTH * share, slice(None, None, -1)
    moment, force_left = (v[:, until_end].cumsum(1)[:, until_end] for v in (weight * since, weight))
    later = moment - since * force_left
    change = SLOPE_VARIANCE * roughness
    covariance = LENGTH**3 * (1 + change / 4) * np.outer(height, height) + LENGTH * change * np.outer(rate, rate)
    covariance -= LENGTH**2 * change / 2 * (np.outer(height, rate) + np.outer(rate, height))
    covariance += roughness * LENGTH / count * later @ later.T
    found = passed(steps_of(form))[1]
    # The response to the noise is taken as a line from a moment to the next frame: right to 4e-6.
    np.testing.assert_allclose(found[:2, :2], covariance, rtol=1e-5)
    np.testing.assert_array_equal(found[2:], 0.0)


@every_form
def test_the_intensity_times_the_cube_of_the_duration_is_the_variance_of_the_height(form: tuple[float, ...]) -> None:
    middle = np.array([0.0, START + LENGTH / 2, 30.0])
    covariance = steps_of(form, middle).contact[0, 0, 0]
    # In the middle of the contact, where the height has changed by noise alone.
    noise = form[ROUGHNESS] * (LENGTH / 2) ** 3 / 3
    assert covariance[3, 3] == pytest.approx(LENGTH**3 + noise, rel=1e-9)


def test_the_rough_process_integrates_white_noise_four_times() -> None:
    steps, duration = steps_of(None), np.diff(TIMES)
    inside = (TIMES[:-1] > START) & (TIMES[1:] < START + LENGTH)
    np.testing.assert_allclose(steps.matrix[0, 0, inside], integrator(duration[inside]), rtol=1e-12)
    np.testing.assert_allclose(steps.contact[0, 0, inside], white_noise(duration[inside], 4), rtol=1e-12)
    assert not steps.envelope.any()
    count = 20_000
    left = (np.arange(count) + 0.5) / count
    response = np.stack((left**3 / 6, left**2 / 2, left, np.ones(count)))
    np.testing.assert_allclose(white_noise(np.ones(1), 4)[0, :4, :4], response @ response.T / count, rtol=1e-6)


def test_the_acceleration_of_the_rough_process_at_the_end_is_that_of_its_jerk_and_its_noise() -> None:
    # A first jerk of variance 1 over a time of 1, and white noise integrated twice: 1 + 1/3.
    assert end_variance() == pytest.approx(4 / 3, rel=1e-12)


def test_recordings_and_intervals_in_a_batch_have_the_steps_that_they_have_alone() -> None:
    times = np.stack((TIMES, TIMES + 0.4))
    windows = np.array([[[2.3, 16.3], [5.0, 9.5]], [[3.0, 3.6], [0.0, 0.0]]])
    forms = np.array([[FORMS[2], FORMS[-1]], [FORMS[7], FORMS[0]]])
    both = transitions(times, windows, forms)
    for row, place in np.ndindex(2, 2):
        part = np.s_[row : row + 1, place : place + 1]
        alone = transitions(times[row : row + 1], windows[part], forms[part])
        for name in ("matrix", "contact", "idle", "envelope"):
            np.testing.assert_allclose(getattr(both, name)[part], getattr(alone, name), rtol=1e-12, atol=1e-15)
