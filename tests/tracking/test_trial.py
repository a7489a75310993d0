"""A circle that nothing confirms is tried on a few pairs, not in the whole recording."""

import numpy as np
import pytest

import torchsphere as ts
from torchsphere.synthetic import demo_shot
from torchsphere.tracking import start
from torchsphere.tracking.first_pass import TRIAL_PAIRS


def test_noise_is_tried_on_a_few_pairs_under_a_given_circle() -> None:
    images = np.random.default_rng(0).integers(0, 255, (60, 80, 90), dtype=np.uint8)
    track = ts.track(images, (45, 40, 25), log=False)
    assert track.findings.untried_frames == 59 - TRIAL_PAIRS
    assert not np.isin(track.status, ("ok", "weak_texture")).any()
    assert any("Nothing confirms the circle" in sentence for sentence in track.warnings)


@pytest.fixture
def images(demo_shot: demo_shot.Shot) -> np.ndarray:
    return demo_shot.images[:20]


def test_a_ball_within_a_circle_that_its_image_does_not_show_is_followed_to_the_end(images: np.ndarray) -> None:
    # A third of the ball: its texture is followed, although no limb lies along the circle.
    track = ts.track(images, (64.3, 92.6, 22.0), sphere_map=False, log=False)
    assert track.findings.untried_frames == 0
    assert (track.status == "ok").sum() >= 15


def test_a_lamp_beside_the_ball_is_not_followed_through_the_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    # A still disc without texture is found; nothing proves it to be a ball, and few frames tell so.
    rows, columns = np.indices((80, 90))
    image = np.where((columns - 45) ** 2 + (rows - 40) ** 2 < 7.5**2, 200, 60)
    images = (image + np.random.default_rng(1).normal(0, 2, (60, 80, 90))).clip(0, 255).astype(np.uint8)
    lamp = ts.Circle(45.0, 40.0, 7.5, 2.0, 2.0, 2.0, sd_guessed=True)
    monkeypatch.setattr(start, "find_initial_circle", lambda source, given, mask, refine, options: (lamp, options))
    seen = []
    with pytest.raises(ValueError, match="may not be the ball"):
        ts.track(images, progress=lambda done, total: seen.append(done), log=False)
    assert max(seen, default=0) <= TRIAL_PAIRS + 1
