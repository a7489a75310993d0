"""The bank of small Kalman filters against the dense joint covariance of all frames, and series that are thinned."""

import itertools
import math

import numpy as np
import torch

from torchsphere.estimation.force_forms import FORMS
from torchsphere.estimation.likelihood import STATED_COUNTS, Series, log_likelihood
from torchsphere.estimation.process_model import FLIGHT_STATES, PRIOR_VARIANCE, STATES, transitions

#: Frame 4 is missing from the recording, and frame 6 was not measured in the second degree of freedom.
TIMES = torch.tensor([[0.0, 1.0, 2.0, 3.0, 5.0, 6.0, 7.0, 8.5]], dtype=torch.float64)
WINDOWS = torch.tensor([[[1.3, 5.6], [0.0, 0.0], [3.0, 3.7]]], dtype=torch.float64)


def series() -> Series:
    generator = torch.Generator().manual_seed(2)

    def some(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    seen = torch.ones(1, 2, 8, dtype=torch.bool)
    seen[0, 1, 5] = False
    return Series(TIMES, 30 * some(1, 2, 8), 0.5 + some(1, 2, 8), 0.1 * some(1, 2, 7), seen)


def dense(
    own: Series, window: torch.Tensor, freedom: int, flight: float, contact: float, form: np.ndarray | None
) -> tuple[float, float]:
    """Log-likelihood and noise factor from the joint covariance of all values that were seen."""
    steps = transitions(own.times.numpy(), window[None, None].numpy(), None if form is None else form[None, None])
    parts = steps.matrix, steps.contact, steps.flight, steps.idle
    matrices, process, white, idle = (torch.from_numpy(part)[0, 0] for part in parts)
    t = own.times.shape[1]
    spread = torch.diag(
        torch.tensor([PRIOR_VARIANCE] * FLIGHT_STATES + [1.0] * (STATES - FLIGHT_STATES), dtype=torch.float64)
    )
    joint = torch.zeros(t, t, dtype=torch.float64)
    # Covariance of the state now with the values before: a column each.
    with_past = torch.zeros(STATES, 0, dtype=torch.float64)
    for i in range(t):
        if i:
            matrix = matrices[i - 1]
            added = 10**flight * white[i - 1] + 10**contact * process[i - 1]
            spread = matrix @ spread @ matrix.T + added
            spread[0, 0] += own.drift[0, freedom, i - 1]
            spread[FLIGHT_STATES:, FLIGHT_STATES:] += idle[i - 1]
            with_past = matrix @ with_past
        joint[i, :i] = joint[:i, i] = with_past[0]
        joint[i, i] = spread[0, 0]
        with_past = torch.cat((with_past, spread[:, :1]), 1)
    joint += torch.diag(own.variance[0, freedom])
    seen = own.seen[0, freedom]
    joint, value = joint[seen][:, seen], own.value[0, freedom][seen]
    counts = STATED_COUNTS + len(value)
    scale = (STATED_COUNTS + float(value @ torch.linalg.solve(joint, value))) / counts
    return -0.5 * (float(torch.logdet(joint)) + counts * math.log(scale)), math.sqrt(scale)


def test_the_filters_give_the_likelihood_of_the_joint_covariance() -> None:
    own = series()
    flight, contact = (torch.tensor(v).double().expand(1, 2, 3, 2) for v in ([-6.0, -2.0], [-1.0, 1.0]))
    # A form with soft ends, one without, and a triangle between frames; then the rough process.
    forms = torch.tensor([[FORMS[3], FORMS[6], FORMS[10]]], dtype=torch.float64)
    each = [log_likelihood(own, WINDOWS, flight, contact, v) for v in (forms, None)]
    for freedom in range(2):
        for place in range(3):
            for m, is_formed in itertools.product(range(2), (True, False)):
                fit, noise = each[0 if is_formed else 1]
                powers = float(flight[0, 0, 0, m]), float(contact[0, 0, 0, m])
                form = forms[0, place].numpy() if is_formed else None
                expected = dense(own, WINDOWS[0, place], freedom, *powers, form)
                found = fit[0, freedom, place, m], noise[0, freedom, place, m]
                # The prior variance of 1e8 leaves about seven digits of double precision.
                torch.testing.assert_close(torch.stack(found), torch.tensor(expected).double(), rtol=1e-5, atol=1e-5)


def test_the_rough_process_has_the_same_likelihood_with_and_without_forms_beside_it() -> None:
    own = series()
    flight = torch.tensor([-6.0, -2.0], dtype=torch.float64).expand(1, 2, 3, 2)
    contact = torch.tensor([-1.0, 2.0], dtype=torch.float64).expand(1, 2, 3, 2)
    alone = log_likelihood(own, WINDOWS, flight, contact)
    forms = torch.tensor(FORMS[:1], dtype=torch.float64).expand(1, 3, -1)
    windows, forms = WINDOWS.repeat(1, 2, 1), torch.cat((torch.zeros_like(forms), forms), 1)
    beside = log_likelihood(own, windows, *(v.repeat(1, 1, 2, 1) for v in (flight, contact)), forms)
    for one, other in zip(alone, beside, strict=True):
        torch.testing.assert_close(one, other[:, :, :3])


def test_drifts_of_frames_that_are_left_out_are_added_up() -> None:
    own = series()
    thin = own.between(1, 8, 3)
    assert thin.times.tolist() == [[1.0, 5.0, 8.5]]
    torch.testing.assert_close(thin.drift, torch.stack((own.drift[..., 1:4].sum(-1), own.drift[..., 4:7].sum(-1)), -1))
    torch.testing.assert_close(thin.value, own.value[..., [1, 4, 7]])


def long_series() -> Series:
    """Forty frames, some of them not seen, of a motion that is bent twice: by the tenth frame, and slowly."""
    generator = torch.Generator().manual_seed(5)
    times = torch.cat((torch.arange(25.0), 26.5 + torch.arange(15.0)))[None].double()
    value = torch.stack((300 * (times[0] - 9).clamp_min(0), 0.1 * times[0] ** 2))[None]
    value = value + torch.randn(value.shape, generator=generator, dtype=torch.float64)
    seen = torch.ones_like(value, dtype=torch.bool)
    seen[0, 0, 13:15] = seen[0, 1, 20] = seen[0, 1, 36:] = False
    variance = 0.5 + torch.rand(value.shape, generator=generator, dtype=torch.float64)
    return Series(times, value, variance, 0.01 * variance[..., 1:], seen)


LONG_WINDOWS = torch.tensor([[[7.2, 11.4], [5.0, 12.0], [8.1, 8.7], [9.5, 13.25]]], dtype=torch.float64)


def test_filters_that_share_their_flights_give_the_likelihood_of_a_single_filter() -> None:
    own = long_series()
    pairs = torch.cartesian_prod(torch.tensor([-9.0, -2.0]), torch.tensor([-3.0, 0.0, 3.0, 5.0])).double()
    flight, contact = (v.expand(1, 2, 1, -1) for v in pairs.T)
    fit, noise = log_likelihood(own, LONG_WINDOWS, flight, contact)
    for place in range(4):
        for m in range(8):
            alone = log_likelihood(
                own, LONG_WINDOWS[:, place : place + 1], flight[..., m : m + 1], contact[..., m : m + 1]
            )
            for one, other in zip(alone, (fit, noise), strict=True):
                torch.testing.assert_close(one[..., 0, 0], other[..., place, m], rtol=0.0, atol=1e-5)


def test_recordings_in_a_batch_have_the_likelihoods_that_they_have_alone() -> None:
    one, flight = long_series(), torch.tensor([-6.0, -2.0], dtype=torch.float64)
    later = Series(one.times + 0.5, one.value.flip(-1), one.variance, one.drift, one.seen)
    both = Series(*(torch.cat(pair) for pair in zip(one, later, strict=True)))
    windows = torch.cat((LONG_WINDOWS, 0 * LONG_WINDOWS))
    contact = torch.tensor([-1.0, 2.0], dtype=torch.float64).expand(2, 2, 1, 2)
    fit, noise = log_likelihood(both, windows, flight.expand(2, 2, 1, 2), contact)
    for row, own in enumerate((one, later)):
        alone = log_likelihood(own, windows[row : row + 1], flight.expand(1, 2, 1, 2), contact[:1])
        torch.testing.assert_close(alone[0][0], fit[row], rtol=0.0, atol=1e-6)
        torch.testing.assert_close(alone[1][0], noise[row], rtol=0.0, atol=1e-6)
