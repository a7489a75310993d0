"""Process, interval and intensities that the data choose for a force of known shape."""

from collections.abc import Callable

import numpy as np
import pytest
import torch

from torchsphere.estimation import contact_search
from torchsphere.estimation.force_forms import DECAY, ONSET, RISEN, ROUGH, ROUGHNESS, SMOOTH
from torchsphere.estimation.likelihood import Series
from torchsphere.estimation.process_fits import log_end_sd, posterior

FRAMES, START, LENGTH = 80, 20.3, 40.0

#: Largest acceleration, noise standard deviations per frame^2: 29 kN on 110 g at 50 kfps, seen to 7.5 um.
TOP = 14.0


def half_sine(share: np.ndarray) -> np.ndarray:
    return np.sin(np.pi * share)


def half_sine_squared(share: np.ndarray) -> np.ndarray:
    return half_sine(share) ** 2


def triangle(share: np.ndarray) -> np.ndarray:
    return 1 - np.abs(2 * share - 1)


def moved(shape: Callable[[np.ndarray], np.ndarray], seed: int) -> np.ndarray:
    """Positions (t,) of a body under a force of that shape, in units of their noise."""
    fine = (np.arange(FRAMES * 100) + 0.5) / 100
    share = (fine - START) / LENGTH
    acceleration = np.where((share > 0) & (share < 1), TOP * shape(np.clip(share, 0, 1)), 0.0)
    # Steps of a hundredth of a frame: exact to 1e-3 of the noise.
    position = (np.cumsum(acceleration) / 100).cumsum() / 100
    return np.concatenate(([0.0], position))[::100][:FRAMES] + np.random.default_rng(seed).normal(size=FRAMES)


def series(*shapes: Callable[[np.ndarray], np.ndarray]) -> Series:
    """One recording with a degree of freedom of each shape."""
    value = torch.from_numpy(np.stack([moved(shape, seed) for seed, shape in enumerate(shapes)]))[None]
    return Series(
        times=torch.arange(float(FRAMES), dtype=torch.float64)[None],
        value=value,
        variance=torch.ones_like(value),
        drift=torch.zeros_like(value[..., 1:]),
        seen=torch.ones_like(value, dtype=torch.bool),
    )


def no_force(share: np.ndarray) -> np.ndarray:
    return 0 * share


def two_peaks(share: np.ndarray) -> np.ndarray:
    return half_sine(share) * (1 - 0.5 * np.exp(-(((share - 0.5) / 0.12) ** 2)))


def found_forms(*shapes: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Forms (c, 5), and whether a degree of freedom has them (c, k)."""
    found = contact_search.find(series(*shapes))
    assert bool(found.found[0])
    return found.forms[0].numpy(), found.formed[0].numpy()


@pytest.mark.parametrize(
    ("shape", "onset", "risen"), [(half_sine, 1.0, 0.0), (half_sine_squared, 2.0, 0.0), (triangle, 0.0, 0.5)]
)
def test_a_half_sine_its_square_and_a_triangle_are_found_with_their_forms(
    shape: Callable, onset: float, risen: float
) -> None:
    forms, formed = found_forms(shape, shape)
    assert formed.mean() > 0.95
    is_own = np.all(forms[:, [ONSET, DECAY, ROUGHNESS]] == [onset, onset, SMOOTH], axis=1)
    assert is_own.mean() > 0.9
    # A kink is found to 0.4 frames: a hundredth of the contact.
    np.testing.assert_allclose(forms[is_own, RISEN], risen, atol=0.03)


def test_a_force_of_no_form_is_found_rough() -> None:
    forms, formed = found_forms(two_peaks, two_peaks)
    is_rough = ~formed | (forms[:, None, ROUGHNESS] == ROUGH)
    assert is_rough.mean() > 0.9


def test_the_intensities_of_a_rough_force_are_drawn_from_their_posterior() -> None:
    data, fine = series(two_peaks, two_peaks), torch.arange(-3.0, 2.0, 0.05, dtype=torch.float64)
    found = contact_search.find(data)
    assert not found.formed.any()
    flight = found.flight.log10().mT[..., None]
    fit, _ = posterior(data, found.windows, flight, fine.expand(1, 2, flight.shape[2], -1))
    fit = fit + log_end_sd(fine, found.windows[:, None, :, None], torch.tensor([True]))
    weight = fit.softmax(-1).mean(2)[0]
    mean = weight @ fine
    spread = (weight @ fine**2 - mean**2).sqrt()
    # Steps of the intensity as wide as three times its error had put all weight on one of them.
    drawn = found.contact[0].log10()
    np.testing.assert_allclose(drawn.mean(0), mean, atol=0.1)
    np.testing.assert_allclose(drawn.std(0), spread, rtol=0.25)


def test_a_force_of_another_form_is_rough_beside_forces_of_one_form() -> None:
    _, formed = found_forms(triangle, half_sine, half_sine, half_sine)
    assert formed[:, 0].mean() < 0.1
    assert formed[:, 1:].mean() > 0.9


def test_a_flight_in_a_batch_with_a_contact_gives_the_results_that_it_gives_alone() -> None:
    touched, free = series(half_sine, half_sine), series(no_force, no_force)
    both = Series(*map(torch.cat, zip(touched, free, strict=True)))
    beside, alone = contact_search.find(both), contact_search.find(free)
    assert beside.found.tolist() == [True, False]
    assert not alone.windows.any()
    assert not beside.windows[1].any()
    # Without contact only the intensities of flight have an effect.
    np.testing.assert_allclose(alone.flight[0], beside.flight[1], rtol=1e-12)
    np.testing.assert_allclose(alone.noise[0], beside.noise[1], rtol=1e-12)


def brief(share: np.ndarray) -> np.ndarray:
    """A half-sine of 14 frames in the middle."""
    return half_sine(np.clip((share - 0.325) / 0.35, 0, 1))


def test_a_weak_change_stays_possible_and_no_change_is_not_taken_for_a_change() -> None:
    # Rates change by 0.43 noise standard deviations per frame: a spin about an axis that an impact hardly turns.
    found = contact_search.find(series(brief, *[lambda share: 0.0034 * brief(share)] * 8, *[no_force] * 8))
    assert bool(found.found[0])
    # The square of the force over the cube of 14 frames: such a change has an intensity of 1e-6. Of the values without
    # change some look like a tenth of it by chance.
    weighed = (found.contact[0] > 1e-8).double().mean(0)
    assert float(weighed[1:9].min()) > 0.9
    assert float(weighed[9:].median()) < 0.1
    assert float((found.contact[0, :, 9:] > 1e-5).double().mean()) < 0.05


def fading(share: np.ndarray) -> np.ndarray:
    """Rises within a seventh of the contact and fades without a slope."""
    rise = 0.15
    return np.where(
        share < rise, np.sin(0.5 * np.pi * share / rise), np.cos(0.5 * np.pi * (share - rise) / (1 - rise)) ** 2
    )


@pytest.mark.parametrize("shape", [fading, lambda share: fading(1 - share)])
def test_the_intervals_of_a_force_that_fades_or_swells_include_the_true_interval(shape: Callable) -> None:
    windows = contact_search.find(series(shape, shape)).windows[0]
    assert float(windows[:, 0].min()) < START + 0.5
    assert float(windows[:, 1].max()) > START + LENGTH - 0.5
