"""A ball that comes nearer or goes away is recognised, and measured with the model of such a motion."""

import numpy as np
import pytest
import torch
from shots import noisy, rotation_matrix

import torchsphere as ts
from torchsphere.synthetic import ray_caster

FRAMES, RADIUS, STEP = 10, 28.0, (3.0, 0.4)
TURN = np.radians([0.6, 1.0, 0.3])


def images_of(growth: float, after: float | None = None) -> torch.Tensor:
    """Images of a ball whose radius grows by that share per frame, from the middle on by the share ``after``."""
    shares = np.where(np.arange(FRAMES - 1) < FRAMES // 2, growth, growth if after is None else after)
    radii = RADIUS * np.cumprod([1, *(1 + shares)])
    pattern = ray_caster.speckle(4, radius_px=RADIUS)
    centres = torch.tensor([[45.0, 50.0]]) + torch.arange(FRAMES)[:, None] * torch.tensor(STEP)
    clean = [
        ray_caster.render(
            pattern,
            centres[i : i + 1],
            float(radii[i]),
            rotation_matrix(torch.from_numpy(i * TURN))[None].float(),
            100.0,
            shape=(104, 136),
        )[0]
        for i in range(FRAMES)
    ]
    return noisy(torch.stack(clean), 2.0, 3)


def test_a_ball_that_grows_is_recognised_and_measured_on_the_map() -> None:
    growth = 0.012
    track = ts.track(images_of(growth), (45.0, 50.0, RADIUS), log=False)
    assert track.settings["model"] == "pinhole6"
    assert (track.status == "ok").all()
    assert track.findings.is_on_map
    assert track.radius[-1] / track.radius[0] == pytest.approx((1 + growth) ** (FRAMES - 1), abs=0.0005)
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2) + track.sd_steady**2)
    off = np.abs(track.increment - np.array([*STEP, *TURN]))
    assert (off / sd).max() < 6
    assert off[:, :2].max() < 0.02
    assert any("grows by 1.2 %" in sentence for sentence in track.warnings)


def test_a_growth_that_an_impact_turns_is_recognised() -> None:
    track = ts.track(images_of(0.01, -0.008), (45.0, 50.0, RADIUS), log=False)
    assert track.findings.grows
    assert track.findings.is_on_map
    assert track.radius[5] / track.radius[0] == pytest.approx(1.01**5, abs=0.0005)
    assert track.radius[-1] / track.radius[5] == pytest.approx(0.992**4, abs=0.0005)
    assert np.abs(track.increment - np.array([*STEP, *TURN]))[:, :2].max() < 0.02
    assert any("grows by 1 %" in s and "shrinks by 0.8 %" in s for s in track.warnings)


def test_a_ball_of_one_size_keeps_its_model_and_its_map() -> None:
    track = ts.track(images_of(0.0), (45.0, 50.0, RADIUS), log=False)
    assert track.settings["model"] == "rigid"
    assert not track.findings.grows
    assert track.findings.is_on_map
