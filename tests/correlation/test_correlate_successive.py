"""Pairs of successive images of one array: each image is filtered once, and the motion is that of copies."""

from typing import Any

import numpy as np
import pytest
from shots import shot

from torchsphere import correlate
from torchsphere.correlation.reference import Filtered
from torchsphere.imaging.crop import Crops


def successive_images(form: str) -> tuple[Any, Any, np.ndarray, np.ndarray]:
    """Reference and deformed images of nine pairs as two parts of one array, circles and starts."""
    made = shot(3, n=10, radius=40.0, jitter=0.05)
    images = made.images.numpy() if form == "numpy" else made.images
    circles = np.column_stack((made.centres[:-1], np.full(9, made.radius)))
    return images[:-1], images[1:], circles, made.increments.numpy()


@pytest.mark.parametrize("form", ["numpy", "torch"])
@pytest.mark.parametrize("mask", [False, True])
def test_images_of_a_recording_are_filtered_once_and_measured_as_separate_pairs(
    monkeypatch: pytest.MonkeyPatch, form: str, mask: bool
) -> None:
    f, g, circles, start = successive_images(form)
    ignore = np.zeros(f.shape[1:], dtype=bool)
    ignore[100:110] = mask
    filtered: list[int] = []
    of = Filtered.of

    def counted(crops: Crops, pre_blur: float) -> Filtered:
        filtered.append(len(crops.images))
        return of(crops, pre_blur)

    monkeypatch.setattr(Filtered, "of", counted)
    found = correlate(f, g, circles, start=start, ignore=ignore)
    assert filtered == [10]
    apart = correlate(f.copy() if form == "numpy" else f.clone(), g, circles, start=start, ignore=ignore)
    assert filtered == [10, 9, 9]
    assert set(found.status) == set(apart.status) == {"ok"}
    np.testing.assert_allclose(found.q, apart.q, atol=1e-4 / 40)
    np.testing.assert_allclose(found.covariance, apart.covariance, rtol=1e-3, atol=1e-12)


def test_circles_away_from_the_expected_ones_have_separate_crops() -> None:
    f, g, circles, start = successive_images("torch")
    circles[4:, 0] += 2.5
    as_parts, apart = (correlate(images, g, circles, start=start) for images in (f, f.clone()))
    np.testing.assert_array_equal(as_parts.q, apart.q)


@pytest.mark.parametrize("order", [slice(None, None, -1), slice(0, 1), slice(None, None, 2)])
def test_parts_of_one_array_that_are_not_successive_are_separate_images(order: slice) -> None:
    f, g, circles, start = successive_images("numpy")
    copies = (np.ascontiguousarray(part[order]) for part in (f, g))
    found = correlate(f[order], g[order], circles[order], start=start[order])
    np.testing.assert_array_equal(found.q, correlate(*copies, circles[order], start=start[order]).q)
