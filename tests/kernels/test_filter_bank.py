"""The compiled bank of small Kalman filters against covariances and means moved and updated one filter at a time."""

import numpy as np
import pytest

from torchsphere.estimation.force_forms import FORMS
from torchsphere.estimation.process_model import step_tables, transitions
from torchsphere.kernels.filter_bank import Frames, Hypotheses, Limits, run

#: Prior variance, frames that settle a state, and fewest frames that are shared: none, or those of the last flight.
ALONE, SHARING = Limits(1e6, 5, 1000), Limits(1e6, 5, 3)

#: Intervals of one recording, the last of which is no contact, and their forms: the first process is the rough one.
WINDOWS = np.array([[7.2, 11.4], [5.0, 12.0], [8.1, 8.7], [0.0, 0.0]])
CONTACT_FORMS = np.array([[0.0] * 6, FORMS[1], FORMS[10], FORMS[0]])


def some_frames() -> Frames:
    """Two recordings of 24 frames and two degrees of freedom, in which some frames are not seen."""
    rng = np.random.default_rng(3)
    times = np.cumsum(0.5 + rng.random((2, 24)), axis=1)
    seen = rng.random((2, 2, 24)) > 0.2
    value = np.where(seen, 20 * rng.normal(size=seen.shape), np.nan)
    return Frames(times, value, 0.5 + rng.random(seen.shape), 0.1 * rng.random((2, 2, 23)), seen)


def sums_of_one(frames: Frames, place: tuple[int, int, int], powers: tuple[float, float]) -> tuple[float, float]:
    """Sums of one filter, of a recording, a degree of freedom and an interval."""
    n, k, c = place
    form = CONTACT_FORMS[c]
    times, window = frames.times[n : n + 1], WINDOWS[None, c : c + 1]
    steps = transitions(times, window, form[None, None] if form.any() else None)
    covariance, mean, logs, squares = np.diag([ALONE.prior_variance] * 3 + [0.0] * 2), np.zeros(5), 0.0, 0.0
    for f in range(times.shape[1]):
        if f:
            matrix = steps.matrix[0, 0, f - 1]
            added = powers[0] * steps.flight[0, 0, f - 1] + powers[1] * steps.contact[0, 0, f - 1]
            covariance, mean = matrix @ covariance @ matrix.T + added, matrix @ mean
            covariance[0, 0] += frames.drift[n, k, f - 1]
        if frames.seen[n, k, f]:
            variance, innovation = covariance[0, 0] + frames.variance[n, k, f], frames.value[n, k, f] - mean[0]
            logs, squares = logs + np.log(variance), squares + innovation**2 / variance
            gain = covariance[:, 0] / variance
            mean, covariance = mean + gain * innovation, covariance - np.outer(gain, covariance[0])
    return logs, squares


@pytest.mark.parametrize("limits", [ALONE, SHARING])
def test_filters_have_the_sums_of_one_alone_whether_or_not_they_share_the_last_flight(limits: Limits) -> None:
    frames, (count, pairs) = some_frames(), (len(WINDOWS), 6)
    rng = np.random.default_rng(4)
    contact = 10.0 ** rng.uniform(-2, 2, (2, 2, count, pairs))
    # Two intensities in flight: less than a fourth of the filters of a degree of freedom.
    flight = np.broadcast_to(10.0 ** np.array([-6.0, -2.0] * 3), contact.shape).copy()
    windows, forms = (np.tile(v, (2, 1, 1)) for v in (WINDOWS, CONTACT_FORMS))
    logs, squares = np.empty((2, *contact.shape))
    run(frames, Hypotheses(windows, forms, flight, contact), step_tables(), limits, logs, squares)
    for n, k, c, m in np.ndindex(contact.shape):
        expected = sums_of_one(frames, (n, k, c), (flight[n, k, c, m], contact[n, k, c, m]))
        # The prior variance leaves ten digits of the first state's covariance.
        np.testing.assert_allclose((logs[n, k, c, m], squares[n, k, c, m]), expected, rtol=1e-6)
