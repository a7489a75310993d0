"""The process noise: its prior, the intensities of the processes, and what a step of one process adds."""

import numpy as np
import torch

from torchsphere.estimation.force_forms import FORMS
from torchsphere.estimation.process_model import FLIGHT_STATES, STATES, transitions
from torchsphere.estimation.process_noise import (
    CONTACT_GRID,
    CONTACT_RANGE,
    FLIGHT_GRID,
    FLIGHT_RANGE,
    NEGLIGIBLE_INTENSITY,
    added_covariance,
    contact_intensities,
    flight_noise,
    log_prior,
)

TIMES = np.arange(6.0)[None]
WINDOW = np.array([[[1.5, 3.5]]])
FORM = np.array(FORMS[:1])[:, None]


def test_the_grids_lie_within_the_ranges_and_a_restless_flight_is_less_likely() -> None:
    assert (CONTACT_GRID[0], CONTACT_GRID[-1]) == CONTACT_RANGE
    assert FLIGHT_GRID[0] == FLIGHT_RANGE[0]
    assert FLIGHT_GRID[-1] <= FLIGHT_RANGE[1]
    assert log_prior(torch.tensor(FLIGHT_GRID)).diff().max() < 0


def test_each_contact_drives_one_process_and_keeps_the_states_of_the_other_from_being_known() -> None:
    rough, formed = contact_intensities(np.array([3.0, 3.0]), np.array([False, True]))
    np.testing.assert_array_equal(rough, [3.0, 0.0])
    np.testing.assert_array_equal(formed, [NEGLIGIBLE_INTENSITY, 3.0])


def test_in_flight_a_step_adds_white_jerk_alone_and_in_contact_the_noise_of_its_process() -> None:
    for form in (None, FORM):
        steps = transitions(TIMES, WINDOW, form)
        added = added_covariance(steps, 2.0, 5.0, is_formed=form is not None)[0, 0]
        flying = np.zeros((STATES, STATES))
        flying[:FLIGHT_STATES, :FLIGHT_STATES] = 2.0 * flight_noise(np.ones(1))[0, :FLIGHT_STATES, :FLIGHT_STATES]
        # States without a meaning get a variance of 1.
        flying += np.diag([0.0, 0.0, 0.0, 1.0, 1.0])
        np.testing.assert_allclose(added[[0, 4]], [flying, flying])
        np.testing.assert_allclose(added[2] - flying + np.diag([0.0, 0.0, 0.0, 1.0, 1.0]), 5.0 * steps.contact[0, 0, 2])
        assert (np.diagonal(added, axis1=1, axis2=2) > 0).all()
