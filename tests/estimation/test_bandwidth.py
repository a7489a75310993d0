"""Weights of the poses in the smoothed rates, from which the bandwidth follows."""

import numpy as np
import pytest

from torchsphere.estimation.bandwidth import cutoffs, smoother_weights


@pytest.mark.parametrize(("gap", "at"), [(5, 4), (40, 20), (55, 32), (55, 60)])
def test_a_frame_in_or_beside_a_long_gap_has_a_bandwidth(gap: int, at: int) -> None:
    times = np.arange(gap + 9.0)
    variance = np.full(len(times), 0.1)
    variance[2:-7] = np.inf
    weights, part = smoother_weights(times, variance, (0.0, 0.0), (1e-12, 1e-12, None), at)
    # A rate of 1 per frame is found as 1, and frames that were not seen have no weight.
    assert weights[0] @ times[part] == pytest.approx(1, abs=1e-6)
    assert (weights[:, np.isinf(variance[part])] == 0).all()
    found = cutoffs(weights, times[part] - times[at])
    assert 0 < found["rate"] < 0.5
