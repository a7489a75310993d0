"""The colour mosaic of a sensor, measured on its green pixels."""

import numpy as np
import pytest
from stored_images import mosaic_of

from torchsphere.recording import mosaic
from torchsphere.settings.choices import BAYER

RNG = np.random.default_rng(11)


@pytest.mark.parametrize("pattern", BAYER)
@pytest.mark.parametrize("shape", [(3, 24, 36), (2, 13, 17)])
def test_green_is_exact_up_to_cubic_polynomials_whatever_the_other_colours_are(
    pattern: str, shape: tuple[int, int, int]
) -> None:
    y, x = np.indices(shape[1:]) / 10.0
    green = (50 + 8 * x - 5 * y + 3 * x * y + 2 * x**2 * y - y**3 + 0.5 * x**3)[None].repeat(shape[0], 0)
    red, blue = RNG.uniform(0, 255, (2, *shape))
    found = mosaic.green(mosaic_of(red, green, blue, pattern), pattern)
    np.testing.assert_allclose(found[:, 2:-2, 2:-2], green[:, 2:-2, 2:-2], rtol=1e-5)
    # At the border the slope is mirrored, and no other colour comes in.
    assert np.abs(found - green).max() < 3.0


def test_patterns_are_named_by_the_codes_of_their_pixels() -> None:
    assert mosaic.pattern_of((0, 1, 1, 2)) == "RGGB"
    assert mosaic.pattern_of((1, 2, 0, 1)) == "GBRG"
    assert mosaic.pattern_of((0, 1, 2, 1)) is None
    assert mosaic.pattern_of((3, 4, 5, 1)) is None
