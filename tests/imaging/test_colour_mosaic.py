"""The raw mosaic of a colour sensor is recognised, whatever it shows; grey images are not taken for one."""

import numpy as np
import pytest
import torch
from shots import SHAPE, clean, compressed, noisy, shot, textured
from stored_images import mosaic_of
from torch import Tensor

from torchsphere.imaging import colour_mosaic, interlacing
from torchsphere.imaging.crop import Crops
from torchsphere.settings.choices import BAYER

#: The light's strength in red, green and blue: a lamp, a sensor that is balanced but for its green, and none of both.
LIGHTS = ((0.55, 1.0, 0.7), (0.9, 1.0, 0.95), (0.8, 1.0, 0.8), (0.3, 0.6, 1.0))


def raw_images(light: tuple[float, float, float], colours: str, pattern: str, seed: int = 0) -> Tensor:
    """Two images of a ball whose speckle is grey, or of random colours, as a colour sensor sees it."""
    seeds = (seed, seed, seed) if colours == "grey" else (seed, seed + 50, seed + 100)
    red, green, blue = (
        factor * clean(seed=each, n=2).images.numpy() for factor, each in zip(light, seeds, strict=True)
    )
    return noisy(torch.from_numpy(mosaic_of(red, green, blue, pattern)), 2.0, seed)


@pytest.mark.parametrize("light", LIGHTS, ids=str)
@pytest.mark.parametrize("colours", ["grey", "random"])
def test_a_mosaic_is_recognised_by_its_green_pixels(light: tuple[float, float, float], colours: str) -> None:
    for pattern in BAYER:
        found = colour_mosaic.recognised(raw_images(light, colours, pattern))
        assert pattern in found
        assert len(found) == 2


def fields(images: Tensor) -> Tensor:
    """Images whose odd rows show the ball one image later."""
    combed = images[:-1].clone()
    combed[:, 1::2] = images[1:, 1::2]
    return combed


def test_grey_images_are_no_mosaic() -> None:
    speckled = clean(seed=3, n=3).images
    generator = torch.Generator().manual_seed(0)
    columns = torch.full(SHAPE, 100.0)
    columns[:, ::2] *= 1.02
    grey = {
        "example": shot(0, n=2).images,
        "fine background": shot(1, n=2, background=textured(3, 1.0, 40.0)).images,
        "compressed": compressed(speckled, 24.0),
        "interlaced": fields(speckled),
        "noise": 100 + 10 * torch.randn(2, *SHAPE, generator=generator),
        "doubled": noisy(speckled, 5.0, 1)[:, :128, :256].repeat_interleave(2, 1).repeat_interleave(2, 2),
        "columns of two amplifiers": noisy(columns[None].repeat(2, 1, 1), 1.0, 2),
        "nothing": torch.zeros(2, *SHAPE),
        "a slope": torch.arange(512.0).expand(2, *SHAPE) + torch.arange(256.0)[:, None],
        "too small": torch.rand(2, 20, 20, generator=generator),
    }
    assert {name: colour_mosaic.recognised(images) for name, images in grey.items()} == dict.fromkeys(grey, ())


@pytest.mark.parametrize("gain", [1 / 255, 16.0])
def test_gain_and_offset_do_not_matter(gain: float) -> None:
    images = raw_images(LIGHTS[0], "grey", "GRBG")
    assert colour_mosaic.recognised(gain * images + 40 * gain) == colour_mosaic.recognised(images)


def test_a_mosaic_looks_interlaced_and_interlaced_images_are_no_mosaic() -> None:
    # The reason why the mosaic is looked for first.
    images = raw_images(LIGHTS[0], "grey", "RGGB")
    assert interlacing.is_interlaced(Crops(images[:, 70:171, 30:131], None, torch.zeros(2, 2, dtype=torch.float64)))
    assert not np.any(colour_mosaic.recognised(fields(clean(seed=1, n=3).images)))
