"""Medians and quantiles by selection, and what counts as a calm background."""

import pytest
import torch

from torchsphere.detection import silhouette


@pytest.mark.parametrize("shape", [(1,), (6,), (25, 7, 5), (1001,)])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_median_is_that_of_torch(shape: tuple[int, ...], dtype: torch.dtype) -> None:
    values = torch.randn(shape, generator=torch.Generator().manual_seed(3), dtype=dtype)
    assert torch.equal(silhouette.median(values), values.median(0).values)


def test_the_median_is_nan_where_a_value_is_nan() -> None:
    values = torch.arange(10.0).reshape(5, 2)
    values[3, 1] = torch.nan
    found = silhouette.median(values)
    assert float(found[0]) == 4.0
    assert bool(found[1].isnan())


@pytest.mark.parametrize("count", [1, 2, 1000, 65_536])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.97, 1.0])
def test_the_quantile_is_that_of_torch(count: int, share: float) -> None:
    values = torch.rand(count, generator=torch.Generator().manual_seed(4))
    assert silhouette.quantile(values, share) == float(torch.quantile(values, share))


def test_ignored_pixels_along_the_border_are_no_calm_background() -> None:
    image = 90 + 10 * torch.randn(1, 80, 90, generator=torch.Generator().manual_seed(0))
    image[0, 30:50, 30:50] = 200
    ignore = torch.zeros(80, 90, dtype=torch.bool)
    ignore[:6], ignore[-6:], ignore[:, :6] = True, True, True
    for mask in (None, ignore, torch.ones_like(ignore).fill_diagonal_(False)):
        seen = list(silhouette.silhouettes(lambda start, stop: image[start:stop], 0, 1, None, mask))
        assert len(seen) == 1
