"""The law of continuity: what cannot be seen in the images changes no result, as rounding must decide nothing.

Neither levels changed in their last digits nor gain and offset of the images do. The experiment
`experiments.validation.continuity` has more changes, more recordings, threads and processors.
"""

import functools

import numpy as np
import pytest

import torchsphere as ts
from experiments.validation.continuity import AS_IT_IS, MOST, VARIATIONS, changes
from torchsphere.synthetic.demo_shot import make_shot

#: Changes of the images alone.
BY_NAME = {variation.name: variation for variation in (AS_IT_IS, *VARIATIONS) if not variation.environment}


@functools.cache
def recording() -> np.ndarray:
    """Images (n, h, w) of the demo's contact."""
    return make_shot().images[26:38].astype(np.float64)


@functools.cache
def track_of(variation: str) -> ts.Track:
    return ts.track(BY_NAME[variation].images(recording()), log=False)


#: The least change, and gain and offset in one.
@pytest.mark.parametrize("variation", ["levels + 1e-4", "levels / 255 + 3"])
def test_what_cannot_be_seen_changes_no_result(variation: str) -> None:
    statuses, most = changes(track_of(AS_IT_IS.name), track_of(variation))
    assert statuses == 0
    assert most < MOST
