"""The scale of grey levels: what gain, offset, steps and odd pixels of a recording do to it."""

import numpy as np
import pytest
import torch

from torchsphere.recording.level_scale import LEAST_SD, WHITE, LevelScale


def image(seed: int = 1) -> np.ndarray:
    """Whole levels (1, 60, 80) from about 20 to 200."""
    return np.random.default_rng(seed).normal(110, 25, (1, 60, 80)).round().clip(20, 200)


def scale_of(*images: np.ndarray) -> LevelScale:
    stack = np.concatenate(images)
    return LevelScale.of(lambda start, stop: stack[start:stop], len(stack))


def standard(levels: np.ndarray) -> np.ndarray:
    return scale_of(levels).standard(torch.from_numpy(levels), torch.float32).numpy()


@pytest.mark.parametrize("gain", [1 / 65535, 1 / 255, 1.0, 257.0, 1e4])
@pytest.mark.parametrize("offset", [0.0, 0.3, 64.0])
def test_neither_gain_nor_offset_changes_a_standard_level(gain: float, offset: float) -> None:
    levels = image()
    changed = gain * (levels + 100 * offset)
    # The resolution of float32 at the largest of these levels, 6600 steps above 0.
    np.testing.assert_allclose(standard(changed.astype(np.float32)), standard(levels), atol=0.002)
    np.testing.assert_allclose(standard(changed), standard(levels), atol=2e-5)


def test_black_and_white_are_those_of_an_image_of_8_bit() -> None:
    levels = np.linspace(0, 1, 100_000).reshape(1, 250, 400)
    assert standard(levels).min() == pytest.approx(0.0, abs=0.6)
    assert standard(levels).max() == pytest.approx(WHITE, abs=0.6)


@pytest.mark.parametrize("kind", ["uint8", "uint16", "int32", "float32", "float64"])
def test_the_type_of_whole_levels_changes_nothing(kind: str) -> None:
    levels = image().astype(kind)
    assert scale_of(levels) == scale_of(image())
    # Torch calculates little with 16 bits.
    images = levels.astype(np.float32) if kind == "uint16" and not hasattr(torch, "uint16") else levels
    found = scale_of(levels).standard(torch.from_numpy(images), torch.float32)
    np.testing.assert_array_equal(found, standard(image()))


@pytest.mark.parametrize(("gain", "step"), [(1.0, 1.0), (16.0, 16.0), (1 / 255, 1 / 255), (0.1, 0.1)])
def test_the_steps_of_a_file_are_its_rounding(gain: float, step: float) -> None:
    for kind in (np.float32, np.float64):
        scale = scale_of((gain * image() + 3).astype(kind))
        assert scale.step == pytest.approx(step, rel=1e-4)
        assert scale.rounding_variance == pytest.approx((step / scale.unit) ** 2 / 12)
    if gain >= 1:
        assert scale_of((gain * image()).astype(np.uint16)).step == step


def test_levels_without_steps_have_the_rounding_of_single_precision() -> None:
    scale = scale_of(np.random.default_rng(1).normal(110, 25, (1, 60, 80)))
    assert scale.step == 0
    assert scale.rounding_variance == LEAST_SD**2


def test_pixels_that_are_not_finite_or_defective_do_not_change_the_scale() -> None:
    levels, spoilt = image(), image()
    spoilt[0, 0, :3] = np.nan, np.inf, 1e30
    assert scale_of(spoilt).black == pytest.approx(scale_of(levels).black, abs=1)
    assert scale_of(spoilt).unit == pytest.approx(scale_of(levels).unit, rel=0.02)


def test_the_scale_is_that_of_the_first_image_that_shows_anything() -> None:
    blank = np.full((5, 60, 80), 7.0)
    assert scale_of(blank, image(), image(2), image(3), image(4)) == scale_of(image(4))
    assert scale_of(blank) == LevelScale()
    assert scale_of(np.full((2, 60, 80), np.nan)) == LevelScale()


def test_a_few_bright_pixels_before_one_level_give_a_scale() -> None:
    levels = np.full((1, 60, 80), 5.0)
    levels[0, 3, 4] = 9.0
    assert scale_of(levels).unit == pytest.approx(4 / WHITE)
