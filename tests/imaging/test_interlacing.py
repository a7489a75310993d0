"""Images of two instants are told from images of one, however far the ball moves between them."""

import torch

import torchsphere as ts
from torchsphere.imaging import interlacing
from torchsphere.imaging.crop import Crops, cut
from torchsphere.synthetic import ray_caster

RADIUS, STEP, FRAMES = 26.0, 8.0, 8


def film() -> tuple[torch.Tensor, torch.Tensor]:
    """Interlaced images (n, h, w) of a ball that moves by 8 px per frame, and its centres (n, 2) in the even rows."""
    pattern = ray_caster.speckle(3, radius_px=RADIUS)
    centres = torch.tensor([[42.0, 42.0]]) + torch.arange(FRAMES)[:, None] * torch.tensor([STEP, 0.0])
    still = torch.eye(3).expand(FRAMES, 3, 3)
    fields = [
        ray_caster.render(pattern, centres + torch.tensor([late, 0.0]), RADIUS, still, 100.0, shape=(84, 148))
        for late in (0.0, STEP / 2)
    ]
    images = fields[0].clone()
    images[:, 1::2] = fields[1][:, 1::2]
    noise = torch.randn(images.shape, generator=torch.Generator().manual_seed(1))
    return (images + 2 * noise).round(), centres


def crops_of(images: torch.Tensor, centres: torch.Tensor) -> Crops:
    return cut(images, centres, 34)


def test_fields_that_are_far_apart_comb() -> None:
    images, centres = film()
    assert interlacing.combing(crops_of(images, centres).images).min() > 2
    assert interlacing.is_interlaced(crops_of(images, centres))
    noise = 50 + 4 * torch.randn(3, 60, 60, generator=torch.Generator().manual_seed(2))
    assert torch.allclose(interlacing.combing(noise), torch.ones(3), atol=0.15)


def test_the_even_rows_show_one_instant() -> None:
    images, centres = film()
    even = interlacing.of_even_rows(images)
    assert torch.equal(even[:, ::2], images[:, ::2])
    assert not interlacing.is_interlaced(crops_of(even, centres))


def test_a_track_of_interlaced_video_lies_where_the_even_rows_show_the_ball() -> None:
    images, centres = film()
    found = ts.track(images, log=False)
    assert found.findings.interlaced
    assert any("interlaced" in sentence for sentence in found.warnings)
    assert abs(found.position - centres.numpy()).max() < 0.3
