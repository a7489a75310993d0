"""Crops around the ball."""

import pytest
import torch

from torchsphere.imaging import crop


@pytest.mark.parametrize(("corner", "ignored"), [(20.0, False), (3.0, False), (20.0, True)])
def test_crops_are_the_same_of_images_that_do_not_lie_together(corner: float, ignored: bool) -> None:
    images = torch.randn(3, 40, 50, generator=torch.Generator().manual_seed(3))
    centres = torch.tensor([[corner, 20.4], [22.0, 19.7], [25.1, 18.0]], dtype=torch.float64)
    ignore = torch.zeros(40, 50, dtype=torch.bool)
    ignore[18:22, 20:30] = ignored
    mask = ignore if ignored else None
    together, apart = crop.cut(images, centres, 9, mask), crop.cut(list(images), centres, 9, mask)
    assert torch.equal(together.images, apart.images)
    assert torch.equal(together.origin, apart.origin)
    assert (together.usable is None) == (apart.usable is None) == (corner == 20.0 and not ignored)
    if together.usable is not None and apart.usable is not None:
        assert torch.equal(together.usable, apart.usable)


@pytest.mark.parametrize("corner", [20.0, 3.0])
def test_whole_numbers_become_float32(corner: float) -> None:
    images = torch.randint(0, 256, (2, 40, 50), generator=torch.Generator().manual_seed(4), dtype=torch.uint8)
    centres = torch.tensor([[corner, 20.4], [22.0, 19.7]], dtype=torch.float64)
    whole, floats = crop.cut(images, centres, 9), crop.cut(images.float(), centres, 9)
    assert whole.images.dtype == torch.float32
    assert torch.equal(whole.images, floats.images)
