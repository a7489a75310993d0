"""A limit that is passed little by little, so that no choice hangs on the last digit of a number."""

from __future__ import annotations

import math

import torch
from torch import Tensor


def share_beyond(value: Tensor, limit: Tensor | float) -> float:
    """Share from 0, for a ``value`` () up to half of the ``limit``, to 1, from twice the limit on."""
    ratio = float(torch.as_tensor(value / limit).double().nan_to_num(0.0))
    at = min(max(0.5 + 0.5 * math.log2(max(ratio, 0.25)), 0.0), 1.0)
    return at**2 * (3 - 2 * at)
