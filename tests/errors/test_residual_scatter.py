"""Residual images that are no noise."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from tracks import falling_track

import torchsphere as ts
from torchsphere.errors.residual_scatter import sentences
from torchsphere.motion.findings import Findings
from torchsphere.sphere_map.decision import MadeMap

#: The sentences read the track alone.
NO_EVIDENCE: Any = None


@pytest.fixture
def falling() -> ts.Track:
    return falling_track()


@pytest.mark.parametrize(("widened", "over_noise", "count"), [(1.0, 1.0, 0), (2.9, 1.4, 0), (3.1, 1.0, 1), (1, 1.6, 1)])
def test_a_residual_that_is_no_noise_is_flagged(
    falling: ts.Track, widened: float, over_noise: float, count: int
) -> None:
    findings = Findings(map=MadeMap(widened=widened, residual_over_noise=over_noise))
    found = sentences(dataclasses.replace(falling, findings=findings), NO_EVIDENCE)
    assert len(found) == count
    assert all(sentence.startswith("The residual images are no noise") for sentence in found)


def test_a_residual_that_a_video_codec_explains_is_not_flagged_twice(falling: ts.Track) -> None:
    findings = Findings(map=MadeMap(widened=5.4, residual_over_noise=0.8), coded=True)
    assert sentences(dataclasses.replace(falling, findings=findings), NO_EVIDENCE) == []


def test_steps_without_a_map_have_no_such_residual(falling: ts.Track) -> None:
    assert sentences(dataclasses.replace(falling, findings=Findings()), NO_EVIDENCE) == []
    assert np.isfinite(falling.increment).all()
