"""Medians and quantiles by selection."""

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
