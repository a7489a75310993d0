"""Outlines that are ellipses with axes along the image's."""

import numpy as np
import pytest
import torch
from shots import clean
from torch import Tensor

from torchsphere.detection import limb_ellipse
from torchsphere.recording.square_pixels import with_square_pixels


def circles_of(centres: Tensor, radius: float) -> Tensor:
    return torch.cat((centres, torch.full((len(centres), 1), radius, dtype=torch.float64)), 1)


@pytest.mark.parametrize("radius", [30.0, 60.0])
def test_the_outline_of_a_ball_is_a_circle(radius: float) -> None:
    made = clean(seed=1, n=4, radius=radius, start=(90.0, 120.0))
    found, sd = limb_ellipse.fit(made.images, circles_of(made.centres, radius + 1))
    assert (found.abs() < 4 * sd).all()
    assert sd.max() < 0.2 / radius


@pytest.mark.parametrize("aspect", [16 / 15, 1.1, 10 / 11, 1.25, 0.8])
def test_a_stretched_image_has_its_ellipse(aspect: float) -> None:
    made = clean(seed=2, n=4, radius=40.0, start=(90.0, 120.0))
    # Drawn as if its pixels had those sides: the ball becomes an ellipse.
    images = torch.from_numpy(with_square_pixels(made.images.numpy(), aspect))
    x, y = made.centres.T
    wide, high = max(aspect, 1.0), max(1 / aspect, 1.0)
    centres = torch.stack(((x + 0.5) * wide - 0.5, (y + 0.5) * high - 0.5), 1)
    found, sd = limb_ellipse.fit(images, circles_of(centres, 20.0 * (wide + high)))
    np.testing.assert_allclose(found[:, 0], (aspect - 1) / (aspect + 1), atol=float(4 * sd.max()))
    np.testing.assert_allclose(found[:, 1], 0.0, atol=float(4 * sd.max()))


def test_an_outline_beyond_the_image_is_unknown() -> None:
    made = clean(seed=1, n=2)
    found, _ = limb_ellipse.fit(made.images, torch.tensor([[0.0, 0.0, 50.0]], dtype=torch.float64).expand(2, 3))
    assert found.isnan().all()
