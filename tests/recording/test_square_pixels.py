"""Pixels that are not square: images are enlarged along the side along which a pixel is longer."""

from fractions import Fraction

import numpy as np
import pytest

from torchsphere.recording.square_pixels import is_square, shape_with_square_pixels, with_square_pixels

RATIOS = (Fraction(11, 10), Fraction(10, 11), Fraction(4, 3), Fraction(8, 9), Fraction(2), Fraction(1, 2))


def smooth_scene(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Grey levels of a scene without detail finer than 9 px."""
    return 100 + 30 * np.sin(0.5 * x + 0.3 * y) + 20 * np.cos(0.2 * x - 0.55 * y)


@pytest.mark.parametrize("aspect", RATIOS, ids=str)
def test_a_scene_is_drawn_where_it_is(aspect: Fraction) -> None:
    height, width = 66, 110
    wide, high = (float(aspect), 1.0) if aspect > 1 else (1.0, float(1 / aspect))
    # The middle of a stored pixel in shown px; the outer edges of both images coincide.
    x, y = (np.arange(width) + 0.5) * wide - 0.5, (np.arange(height) + 0.5) * high - 0.5
    shown = with_square_pixels(smooth_scene(x[None], y[:, None])[None], float(aspect))[0]
    expected = smooth_scene(np.arange(shown.shape[1])[None], np.arange(shown.shape[0])[:, None])
    assert shown.shape == (round(height * high), round(width * wide))
    # A cubic spline through 4.5 points per wave errs by some percent; the border has no pixel beside it.
    np.testing.assert_allclose(shown[4:-4, 4:-4], expected[4:-4, 4:-4], atol=1.5 if max(wide, high) < 1.5 else 4.0)


@pytest.mark.parametrize("aspect", RATIOS, ids=str)
def test_no_pixel_is_thrown_away(aspect: Fraction) -> None:
    height, width = shape_with_square_pixels((40, 60), float(aspect))
    assert height >= 40
    assert width >= 60
    assert (height, width) == ((40, round(60 * aspect)) if aspect > 1 else (round(40 / aspect), 60))


def test_one_grey_level_stays() -> None:
    np.testing.assert_allclose(with_square_pixels(np.full((2, 9, 13), 77, np.uint8), 1.1), 77, rtol=1e-6)


def test_pixels_that_are_square_but_for_rounding_or_unknown_are_square() -> None:
    assert is_square(None)
    assert is_square(1.0)
    assert is_square(72.0 / 72.005)
    assert not is_square(1.001)
