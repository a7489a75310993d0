"""Edges, kinks and intensities of each process: where they lie, how well they are known, and the forms they give."""

import math

import numpy as np
import pytest
import torch

from torchsphere.estimation.force_forms import FALLING, FORMS, MIN_PART, RISEN, SMOOTH
from torchsphere.estimation.likelihood import Series, log_likelihood
from torchsphere.estimation.process_fits import (
    EDGES,
    FLIGHT_VARIANCE,
    MIN_CONTACT_FRAMES,
    PLACES,
    ProcessFits,
    clamped,
    fit_of,
    forms_at,
    free_places,
    log_end_sd,
    posterior,
)
from torchsphere.estimation.process_noise import FLIGHT_PENALTY, FLIGHT_RANGE

FRAMES, START, LENGTH = 50, 14.3, 20.0

#: Numbers of the processes: 0 is the rough one, and the forms follow.
HALF_SINE = 1 + FORMS.index((1.0, 1.0, 0.0, 1.0, SMOOTH, 0.0))
TRIANGLE, PLATEAU = (1 + number for number, form in enumerate(FORMS) if form[RISEN] > 0)


def moved(risen: float, falling: float) -> np.ndarray:
    """Positions (t,) in units of their noise, under a force of three straight lines with kinks at these shares."""
    fine = (np.arange(FRAMES * 100) + 0.5) / 100
    force = np.interp((fine - START) / LENGTH, [0, risen, falling, 1], [0, 30, 30, 0], left=0, right=0)
    return np.concatenate(([0.0], (np.cumsum(force) / 100).cumsum() / 100))[::100][:FRAMES]


def series(risen: float, falling: float, seeds: tuple[int, ...]) -> Series:
    """Recordings of one degree of freedom with different noise."""
    noise = np.stack([np.random.default_rng(seed).normal(size=FRAMES) for seed in seeds])
    value = torch.from_numpy(moved(risen, falling) + noise)[:, None]
    return Series(
        times=torch.arange(float(FRAMES), dtype=torch.float64).expand(len(seeds), -1),
        value=value,
        variance=torch.ones_like(value),
        drift=torch.zeros_like(value[..., 1:]),
        seen=torch.ones_like(value, dtype=torch.bool),
    )


def first_fits(count: int) -> ProcessFits:
    """All processes near the contact, with an intensity that is that of the force."""
    window = torch.tensor([[START + 0.6, START + LENGTH - 0.5]], dtype=torch.float64).expand(count, -1)
    fits = ProcessFits.at(window, torch.full((count, 1, 1 + len(FORMS)), -12.0, dtype=torch.float64))
    return fits._replace(contact=torch.full_like(fits.flight, math.log10(30**2 / LENGTH**3)))


def test_edges_are_unknown_in_all_processes_and_kinks_in_those_that_have_them() -> None:
    free = free_places()
    assert free.shape == (1 + len(FORMS), PLACES)
    assert free[:, :EDGES].all()
    assert not free[0, EDGES:].any()
    for form, (first, last) in zip(FORMS, free[1:, EDGES:].tolist(), strict=True):
        assert first == (form[RISEN] > 0)
        # The single kink of a triangle is the first one.
        assert last == (form[RISEN] > 0 and form[FALLING] > form[RISEN])


def test_all_processes_begin_at_the_given_interval_with_the_kinks_of_their_forms() -> None:
    fits = first_fits(1)
    start, end = START + 0.6, START + LENGTH - 0.5
    np.testing.assert_allclose(fits.places[0, :, :EDGES], np.broadcast_to([start, end], (1 + len(FORMS), 2)))
    for form, places in zip(FORMS, fits.places[0, 1:], strict=True):
        np.testing.assert_allclose(places[EDGES:], [start + share * (end - start) for share in form[RISEN:4]])
    every = torch.arange(len(FORMS))
    found = forms_at(fits.places[:, 1:, None], every)
    np.testing.assert_allclose(found[0, :, 0], FORMS, rtol=1e-12)


def test_forms_have_the_kinks_of_their_places_in_order_and_apart_from_the_edges() -> None:
    places = torch.tensor([[10.0, 20.0, 12.0, 17.0], [10.0, 20.0, 17.0, 12.0], [10.0, 20.0, 9.0, 30.0]]).double()
    which = torch.tensor([[HALF_SINE - 1] * 3, [TRIANGLE - 1] * 3, [PLATEAU - 1] * 3]).T
    sine, triangle, plateau = forms_at(places[None, :, None].expand(-1, -1, 3, -1), which[None])[0].unbind(1)
    np.testing.assert_allclose(sine, np.broadcast_to(FORMS[HALF_SINE - 1], (3, 6)))
    np.testing.assert_allclose(triangle[:, RISEN : FALLING + 1], [[0.2, 0.2], [0.7, 0.7], [MIN_PART, MIN_PART]])
    np.testing.assert_allclose(plateau[:, RISEN : FALLING + 1], [[0.2, 0.7], [0.7, 0.7], [MIN_PART, 1 - MIN_PART]])


def test_intervals_stay_within_the_recording_and_are_no_shorter_than_the_shortest_contact() -> None:
    some = series(0.5, 0.5, (0,))
    windows = torch.tensor([[[-5.0, 70.0], [20.0, 19.0], [60.0, 61.0]]], dtype=torch.float64)
    last = FRAMES - 1.0
    expected = [[0.0, last], [20.0, 20.0 + MIN_CONTACT_FRAMES], [last - MIN_CONTACT_FRAMES, last]]
    np.testing.assert_allclose(clamped(some, windows)[0], expected)


def test_a_restless_flight_is_less_likely_by_its_penalty() -> None:
    some, window = series(0.5, 0.5, (0,)), torch.tensor([[[START, START + LENGTH]]], dtype=torch.float64)
    flight = torch.tensor([-9.0], dtype=torch.float64).expand(1, 1, 1, 1)
    from_prior, noise = posterior(some, window, flight, torch.zeros_like(flight))
    alone, same = log_likelihood(some, window, flight, torch.zeros_like(flight))
    np.testing.assert_allclose(alone - from_prior, FLIGHT_PENALTY * (-9 - FLIGHT_RANGE[0]), rtol=1e-9)
    np.testing.assert_array_equal(noise, same)


def test_every_process_has_its_own_places_and_intensities_among_the_others() -> None:
    some, fits = series(0.25, 0.75, (0,)), first_fits(1)
    generator = torch.Generator().manual_seed(1)
    shift = torch.rand(1, 1 + len(FORMS), 2, PLACES, generator=generator, dtype=torch.float64)
    places = fits.places[:, :, None] + shift
    flight = torch.rand(1, 1, 1 + len(FORMS), 3, generator=generator, dtype=torch.float64) - 9
    contact = flight + 9
    together = fit_of(some, places, flight, contact)
    for process in (0, HALF_SINE, PLATEAU):
        for place in range(2):
            own = places[:, process : process + 1, place : place + 1]
            form = None if process == 0 else forms_at(own, torch.tensor([process - 1]))[:, 0]
            alone, _ = posterior(
                some, own[:, 0, :, :EDGES], flight[:, :, process, None], contact[:, :, process, None], form
            )
            np.testing.assert_allclose(together[:, :, process, place], alone[:, :, 0], rtol=1e-9)


def test_kinks_and_edges_of_a_plateau_are_found_and_known_as_well_as_they_scatter() -> None:
    recordings = series(0.3, 0.8, (0, 1, 2, 3))
    found, root = first_fits(4).located(recordings)
    off = found.places[:, PLATEAU].numpy() - (START + LENGTH * np.array([0.0, 1.0, 0.3, 0.8]))
    sd = (root[:, PLATEAU] @ root[:, PLATEAU].mT).diagonal(dim1=-2, dim2=-1).sqrt().numpy()
    assert np.abs(off).max() < 0.5
    # Sixteen errors give the ratio to 18 percent: three times that.
    assert 0.5 < np.sqrt(((off / sd) ** 2).mean()) < 1.55
    # What is not unknown has no error, and the right process is the likeliest.
    assert not (root[:, HALF_SINE, EDGES:]).any()
    fit = fit_of(recordings, found.places[:, :, None], found.flight[..., None], found.contact[..., None])
    assert (fit[:, 0, :, 0, 0].argmax(1) == PLATEAU).all()


def test_only_a_rough_process_may_end_with_a_force() -> None:
    windows = torch.tensor([3.0, 17.0], dtype=torch.float64)
    contact, rough = torch.tensor([-2.0, -2.0, -math.inf]).double(), torch.tensor([True, False, True])
    found = log_end_sd(contact, windows, rough)
    # Its jerk at first and its noise: 4/3 of the cube of the length.
    variance = [1e-2 * 4 / 3 * 14.0**3, 0.0, 0.0]
    np.testing.assert_allclose(found, 0.5 * np.log(np.array(variance) + FLIGHT_VARIANCE), rtol=1e-9)


@pytest.mark.parametrize("process", [0, HALF_SINE, PLATEAU])
def test_a_selected_process_comes_beside_the_rough_one(process: int) -> None:
    fits = first_fits(1)
    fits = fits._replace(flight=torch.arange(1.0 + len(FORMS))[None, None].double())
    both, flight, _ = fits.selected(torch.tensor([[process]]))
    assert both.tolist() == [[[0, process]]]
    assert flight.tolist() == [[[[0.0, float(process)]]]]
