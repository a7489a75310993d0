"""Medians and quantiles of many values, by NumPy's selection: a third to a tenth of the time of torch's on a CPU."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor


def median(values: Tensor) -> Tensor:
    """Median (...) along the first axis of ``values`` (n, ...), the lower one of two; NaN where there is any."""
    if not _selectable(values):
        return values.median(0).values
    middle = (len(values) - 1) // 2
    return torch.from_numpy(np.asarray(np.partition(values.numpy(), middle, axis=0)[middle]))


def quantile(values: Tensor, share: float) -> float:
    """Quantile of ``values`` (n,), between two of them in proportion, to the last bit as `torch.quantile` has it."""
    if not _selectable(values):
        return float(torch.quantile(values, share))
    rank = values.new_tensor(share) * (len(values) - 1)
    below, above = int(rank.floor()), int(rank.ceil())
    around = np.partition(values.numpy(), (below, above))[[below, above]]
    lower, upper = torch.from_numpy(around)
    return float(torch.lerp(lower, upper, rank - rank.floor()))


def _selectable(values: Tensor) -> bool:
    """Whether NumPy selects as torch does: on the CPU, and without NaN, which it takes for the largest."""
    return values.device.type == "cpu" and bool(values.sum().isfinite())
