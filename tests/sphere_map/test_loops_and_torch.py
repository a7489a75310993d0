"""A whole recording on its map, by the compiled loops and by torch alone, which is what a GPU runs."""

import numpy as np
import pytest
import torch
from shots import shot

from torchsphere.sphere_map import bundle_adjustment, forward_model, level, map_fit, pixel_weights, registration
from torchsphere.tracking.track import track


def test_loops_and_torch_measure_the_same_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    # Both go on to the minimum: with the limits as they are, rounding may decide which step is the last one.
    monkeypatch.setattr(level, "SETTLED_SD", 0.01)
    monkeypatch.setattr(bundle_adjustment, "LAST_SETTLED_PX", 5e-5)
    made = shot(3, n=8, radius=15.0, rotation_deg=(0.5, 2.0, 0.3))
    by_loops = track(made.images, made.circle)
    for module in (forward_model, map_fit, pixel_weights, registration):
        monkeypatch.setattr(module, "suits", lambda *_: False)
    by_torch = track(made.images, made.circle)
    assert by_loops.findings.is_on_map
    assert by_torch.findings.is_on_map
    np.testing.assert_allclose(by_loops.position, by_torch.position, atol=1e-4)
    np.testing.assert_allclose(15.0 * by_loops.increment[:, 2:], 15.0 * by_torch.increment[:, 2:], atol=1e-4)
    deviations = (np.sqrt(np.diagonal(t.covariance, axis1=1, axis2=2)) for t in (by_loops, by_torch))
    np.testing.assert_allclose(*deviations, rtol=0.01)
    assert torch.isfinite(torch.from_numpy(by_torch.orientation)).all()
