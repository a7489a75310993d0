"""The process noise: which intensities it may have, how likely they are, and what they add to the states in a step.

White noise drives every process of `process_model`, in flight and in contact. Its intensities are searched
(`contact_search`, `process_fits`), weighed (`model_averaging`), and used by the filters and the smoother.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.estimation.process_model import FLIGHT_STATES, Transitions, white_noise
from torchsphere.runtime.arrays import Array

#: Range of the intensity in flight, powers of ten of the noise variance per frame^5 (docs/constants.toml).
FLIGHT_RANGE = (-12.0, 8.0)

#: Lowest and highest intensity in contact, powers of ten (docs/constants.toml).
CONTACT_RANGE = (-12.0, 8.0)

#: Highest intensity in contact that steps from those of the range reach, powers of ten.
MAX_CONTACT = 12.0

#: Coarse grid of all possible intensities, powers of ten, in flight and in contact.
FLIGHT_GRID = tuple(float(power) for power in range(-12, 5))
CONTACT_GRID = tuple(float(power) for power in range(-12, 9))

#: Loss of log-likelihood per power of ten of the intensity in flight, as a prior (docs/constants.toml).
FLIGHT_PENALTY = 1.0

#: Intensity of white noise that stands for none, noise variance per frame^7 (docs/constants.toml).
NEGLIGIBLE_INTENSITY = 1e-40


def log_prior(flight: Tensor) -> Tensor:
    """Logarithm of the prior of intensities in flight, powers of ten, up to a constant.

    Only gravity and drag act in flight: weak changes in contact are not to be taken for a restless flight.
    """
    return -FLIGHT_PENALTY * (flight - FLIGHT_RANGE[0])


def flight_noise(duration: Array) -> Array:
    """Covariance (..., 5, 5) that white jerk of unit intensity adds over ``duration`` (...), in flight and contact."""
    return white_noise(duration, FLIGHT_STATES)


def contact_intensities(contact: Array, is_formed: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Intensities (...) of the rough process and of that with a form, of which each contact has one.

    The two states of a form must not be known exactly where the process is the rough one.
    """
    return np.where(is_formed, 0.0, contact), np.where(is_formed, contact, NEGLIGIBLE_INTENSITY)


def added_covariance(steps: Transitions, flight: float, contact: float, *, is_formed: bool) -> Array:
    """Covariance (n, c, t - 1, 5, 5) that the steps of one process add to the states of a degree of freedom."""
    added = contact * steps.contact + flight * steps.flight
    if not is_formed:
        # The fifth state of the rough process is none, but must not be known exactly.
        added[..., -1, -1] += NEGLIGIBLE_INTENSITY
    return with_idle(added, FLIGHT_STATES, steps.idle)


def with_idle(added: Array, first: int, idle: NDArray[np.bool_]) -> Array:
    """The covariances (..., s, s), with a variance of 1 of the states from ``first`` on where ``idle`` (...) is True.

    There these states have no meaning, but a filter needs some variance of them.
    """
    later = np.arange(first, added.shape[-1])
    added[..., later, later] += idle[..., None]
    return added
