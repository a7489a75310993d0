"""Standard deviations of drawn values by their quantiles."""

from __future__ import annotations

import numpy as np

from torchsphere.runtime.arrays import Array

#: Shares of a normal distribution within one and two standard deviations.
ONE_SD, TWO_SD = 0.6827, 0.9545


def sd_of_errors(errors: Array) -> Array:
    """Standard deviation (...) of drawn errors (s, ...), of which NaN are left out; NaN where all are.

    A few motions with a softer contact would dominate a root mean square. Quantiles ignore them; the second one holds
    the band of 95 % where the force has two likely forms, whose contacts are of two lengths.
    """
    is_known = np.isfinite(errors).any(0)
    inner, outer = np.nanquantile(np.abs(np.where(is_known, errors, 0.0)), (ONE_SD, TWO_SD), axis=0)
    return np.asarray(np.where(is_known, np.maximum(inner, 0.5 * outer), np.nan))
