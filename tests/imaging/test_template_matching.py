"""Where the ball is in the next image, without a guess."""

import numpy as np
import pytest
import torch
from shots import noisy, shot

from torchsphere.imaging import template_matching


@pytest.mark.parametrize(
    ("step", "radius"),
    [((0.0, 0.0), 50.0), ((22.0, 3.0), 50.0), ((-60.0, 40.0), 50.0), ((35.0, -5.0), 20.0), ((150.0, 30.0), 40.0)],
)
def test_the_ball_is_found_to_a_tenth_of_its_radius(step: tuple[float, float], radius: float) -> None:
    made = shot(1, n=2, step=step, jitter=0.4, radius=radius, start=(180.0, 110.0), rotation_deg=(1, 2, 1))
    found = template_matching.best_match(made.images[0], made.images[1], made.centres[0], radius)
    # What `best_match` promises, and what a correlation from several starts can go on from.
    assert float((found - made.centres[1]).norm()) < 0.1 * radius


def test_an_ignored_region_does_not_draw_the_match() -> None:
    made = shot(1, n=2, step=(10.0, 3.0), start=(200.0, 120.0))
    ignore = torch.zeros(made.images.shape[1:], dtype=torch.bool)
    ignore[90:130, 190:220] = True
    spoiled = made.images.clone()
    spoiled[:, ignore] = 255
    found = template_matching.best_match(spoiled[0], spoiled[1], made.centres[0], made.radius, ignore)
    assert float((found - made.centres[1]).norm()) < 0.1 * made.radius


def test_a_match_exists_even_for_images_without_any_ball() -> None:
    blank = noisy(torch.full((2, 100, 120), 90.0), 2.0, 1)
    found = template_matching.best_match(blank[0], blank[1], torch.tensor([60.0, 50.0]), 20.0)
    assert found.shape == (2,)
    assert np.isfinite(found.numpy()).all()
