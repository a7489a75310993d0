"""A whole recording on its map, by the compiled loops and by torch alone, which is what a GPU runs."""

import numpy as np
import pytest
import torch
from shots import shot

from torchsphere.sphere_map import forward_model, map_fit, pixel_weights, registration
from torchsphere.tracking.track import track


def test_loops_and_torch_measure_the_same_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    made = shot(3, n=8, radius=15.0, rotation_deg=(0.5, 2.0, 0.3))
    by_loops = track(made.images, made.circle)
    for module in (forward_model, map_fit, pixel_weights, registration):
        monkeypatch.setattr(module, "suits", lambda *_: False)
    by_torch = track(made.images, made.circle)
    assert by_loops.findings.is_on_map
    assert by_torch.findings.is_on_map
    of_loops, of_torch = (np.sqrt(np.diagonal(t.covariance, axis1=1, axis2=2)) for t in (by_loops, by_torch))
    np.testing.assert_allclose(of_loops, of_torch, rtol=0.01)
    # A step below a tenth of a standard deviation may be the last one, and rounding decides which step is.
    assert (np.abs(by_loops.increment - by_torch.increment) < 0.05 * of_loops).all()
    assert (np.abs(by_loops.position - by_torch.position) < 0.05 * of_loops[:, :2].max(0)).all()
    assert torch.isfinite(torch.from_numpy(by_torch.orientation)).all()
