"""The disc that separates inside and outside best."""

import torch

from torchsphere.detection import disc_filter


def silhouette(x: float, y: float, radius: float, seed: int) -> torch.Tensor:
    rows, columns = torch.arange(120.0)[:, None], torch.arange(200.0)
    noise = 0.1 * torch.rand(120, 200, generator=torch.Generator().manual_seed(seed))
    return ((columns - x) ** 2 + (rows - y) ** 2 < radius**2).float() * 0.9 + noise


def test_a_batch_of_silhouettes_equals_its_rows() -> None:
    some = torch.stack((silhouette(60.0, 50.0, 20.0, 1), torch.zeros(120, 200), silhouette(140.0, 70.0, 35.0, 2)))
    found = disc_filter.best_discs(some)
    assert found[1] is None
    for each, guess in zip(some[::2], found[::2], strict=True):
        (alone,) = disc_filter.best_discs(each[None])
        assert alone is not None
        assert guess is not None
        assert torch.equal(guess, alone)


def test_a_ring_beyond_the_border_does_not_wrap_around() -> None:
    # Rings reach beyond one border: in a plane that is too small they would wrap around to the other.
    found = disc_filter.best_discs(torch.stack((silhouette(30.0, 60.0, 28.0, 3), silhouette(170.0, 60.0, 28.0, 4))))
    for guess, x in zip(found, (30.0, 170.0), strict=True):
        assert guess is not None
        # Steps of the coarse image and of the radius.
        assert float((guess[0] - torch.tensor([x, 60.0, 28.0])).abs().max()) < 3.0
