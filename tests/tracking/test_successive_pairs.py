"""Pairs of a batch are measured at the ball's true position, whatever position was expected."""

import dataclasses

import numpy as np
import pytest
import torch
from shots import Shot, shot
from torch import Tensor

from torchsphere.correlation.options import Options
from torchsphere.correlation.reference import SLACK_PX, Filtered
from torchsphere.correlation.result import Correlation
from torchsphere.tracking import successive_pairs

SETUP = successive_pairs.PairSetup(Options(), None, False, shared=lambda part, rows: [part(0, rows)])


@pytest.fixture(scope="module")
def made() -> Shot:
    return shot(4, n=12, radius=40.0)


@pytest.fixture(scope="module")
def truly(made: Shot) -> Tensor:
    """True circles (12, 3)."""
    return torch.cat((made.centres, torch.full((12, 1), made.radius, dtype=torch.float64)), -1)


def correlated(images: Tensor, balls: Tensor, start: Tensor, truly: Tensor) -> tuple[Correlation, Tensor]:
    """Correlation with the ball expected at ``balls`` (n, 3); ``truly`` in the first image."""
    return successive_pairs.correlate_successive(successive_pairs.prepare(images, balls, start, SETUP), truly[0], SETUP)


def filtered(images: Tensor, balls: Tensor) -> Filtered:
    return successive_pairs._filter(successive_pairs._cut(images, balls, SETUP), SETUP, interlaced=False)


def filtered_where_off(before: Filtered, images: Tensor, balls: Tensor, expected: Tensor) -> Filtered:
    return successive_pairs._filter_where_off(before, images, balls, expected, SETUP, interlaced=False)


#: Error (12, 3) of the expected circles of a ball that slows down: 4 px at the end, too much for the crops from 10 on.
OFF = torch.tensor([0.033, 0.0, 0.0], dtype=torch.float64) * torch.arange(12)[:, None] ** 2


def test_images_filtered_anew_are_reduced_to_a_field_only_if_the_others_are(made: Shot, truly: Tensor) -> None:
    images = made.images.clone()
    # Only the last two images, which are cut anew, show the ball at two instants.
    for later in (11, 10):
        images[later, 1::2] = made.images[later - 1, 1::2]
    start = made.increments.clone()
    start[:, 0] += OFF[:, 0].diff()
    found, _ = correlated(images, truly + OFF, start, truly)
    expected, _ = correlated(images, truly, made.increments, truly)
    assert len(found.q) == 11
    np.testing.assert_allclose(found.q[-2, :2], expected.q[-2, :2], atol=0.02)


def test_a_wrong_prediction_of_the_end_of_the_path_changes_nothing(made: Shot, truly: Tensor) -> None:
    start = made.increments.clone()
    start[:, 0] += OFF[:, 0].diff()
    found, circles = correlated(made.images, truly + OFF, start, truly)
    expected, _ = correlated(made.images, truly, made.increments, truly)
    assert set(found.status) == set(expected.status) == {"ok"}
    np.testing.assert_allclose(circles[:, :2], truly[:, :2], atol=0.1)
    # Circles that differ by hundredths of a px may select other pixels: a third of the noise.
    apart = (found.q - expected.q).double() / expected.covariance.diagonal(dim1=1, dim2=2).sqrt()
    assert float(apart.abs().max()) < 0.5


def test_a_wrong_coarse_solution_of_a_hidden_ball_leaves_a_circle(made: Shot, truly: Tensor) -> None:
    batch = successive_pairs.prepare(made.images, truly, made.increments, SETUP)
    wrong = torch.cat((batch.coarse.q, torch.full_like(batch.coarse.q[:, :1], -1.47)), 1)
    batch = dataclasses.replace(batch, coarse=batch.coarse._replace(q=wrong))
    radii = batch.circles_from(truly[0])[:, 2]
    assert radii[0] == made.radius
    assert bool((radii > 0).all())


def test_a_wrong_prediction_from_the_first_image_on_changes_nothing(made: Shot, truly: Tensor) -> None:
    away = torch.tensor([0.4, -0.3, 0.0], dtype=torch.float64)
    found, circles = correlated(made.images, truly + away, made.increments, truly)
    expected, _ = correlated(made.images, truly, made.increments, truly)
    np.testing.assert_allclose(circles[:, :2], truly[:, :2], atol=0.1)
    apart = (found.q - expected.q).double() / expected.covariance.diagonal(dim1=1, dim2=2).sqrt()
    assert float(apart.abs().max()) < 0.5


def test_images_are_filtered_anew_from_the_first_with_too_small_a_margin_of_the_crop(made: Shot, truly: Tensor) -> None:
    before = filtered(made.images, truly + OFF)
    found = filtered_where_off(before, made.images, truly, truly + OFF)
    anew = filtered(made.images, truly)
    first = 10
    assert float(OFF[first, 0]) > SLACK_PX > float(OFF[first - 1, 0])
    assert torch.equal(found.c[:first], before.c[:first])
    assert torch.equal(found.crops.origin[first:], anew.crops.origin[first:])
    torch.testing.assert_close(found.c[first:], anew.c[first:])


def test_a_ball_that_comes_nearer_than_expected_gets_larger_crops(made: Shot, truly: Tensor) -> None:
    before = filtered(made.images, truly)
    larger = truly.clone()
    larger[-1, 2] += 2 * SLACK_PX
    found = filtered_where_off(before, made.images, larger, truly)
    assert found.c.shape[-1] > before.c.shape[-1]
    assert len(found.c) == len(made.images)


def test_crops_that_reach_the_border_join_with_crops_that_do_not(made: Shot, truly: Tensor) -> None:
    before = filtered(made.images, truly)
    moved = truly.clone()
    moved[-2:, 1] = 20.0  # half above the image
    found = filtered_where_off(before, made.images, moved, truly)
    assert before.crops.usable is None
    assert found.crops.usable is not None
    assert bool(found.crops.usable[:-2].all())
    assert not bool(found.crops.usable[-2:].flatten(1).all(1).any())
