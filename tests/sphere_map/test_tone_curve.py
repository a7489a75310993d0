"""Grey levels that are not proportional to the light: the radius is right, and it is said.

`experiments.validation.tone_curve` has more exponents, backgrounds and blurs.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch
from ball_models import poses, rough_ball, windows
from shots import noisy, rotation_matrix
from tracks import made_map

import torchsphere as ts
from torchsphere.imaging.interpolation import blur
from torchsphere.sphere_map import forward_model, rays
from torchsphere.synthetic import ray_caster

RADIUS, FRAMES, WHITE = 24.0, 16, 255.0
TURN = torch.tensor(np.radians([0.8, 1.6, 2.4]))


def track_of(exponent: float, background: float, blur_px: float = 0.0) -> ts.Track:
    """Track of a ball in images whose levels are the light to the power of the ``exponent``."""
    start = torch.tensor([40.3, 38.2])
    places = start + torch.arange(FRAMES)[:, None] * torch.tensor([4.2, 0.7])
    turns = torch.stack([rotation_matrix(number * TURN) for number in range(FRAMES)]).float()
    given = ray_caster.speckle(8, radius_px=RADIUS), places, RADIUS, turns, WHITE * background
    light = ray_caster.render(*given, shape=(90, 145), subsamples=5) / WHITE
    light = blur(light, blur_px) if blur_px else light
    images = noisy(WHITE * light.clamp(0, 1) ** exponent, 2.0, 4)
    return ts.track(images, (*start.tolist(), RADIUS), log=False)


@pytest.mark.parametrize(("exponent", "background"), [(0.45, 0.08), (0.6, 0.02), (1.6, 0.05)])
def test_a_tone_curve_is_found_and_the_radius_is_without_it(exponent: float, background: float) -> None:
    track = track_of(exponent, background)
    assert (track.status == "ok").all()
    # Brighter dark parts move the edge of a bright ball outwards.
    assert (made_map(track).edge_bend > 0) == (exponent < 1)
    assert abs(track.circle.radius - RADIUS) < 3 * track.circle.sd_radius
    assert track.circle.sd_radius < 0.06
    # The common error of all turns, beside that of the radius, which `kinematics` adds.
    off = np.abs(np.nanmean(track.increment[:, 2:], 0) - TURN.numpy())
    by_radius = track.circle.sd_radius / RADIUS * np.abs(TURN.numpy()).max()
    assert (off < 3 * np.hypot(track.sd_steady[2:], by_radius)).all()
    assert any("not proportional to the light" in sentence for sentence in track.warnings)


@pytest.mark.parametrize("background", [1.15, 1.35])
def test_a_background_that_is_too_bright_for_the_camera_does_not_move_the_outline(background: float) -> None:
    """Pixels that the ball covers by a fifth are as white as the background."""
    track = track_of(1.0, background)
    assert (track.status == "ok").all()
    assert made_map(track).edge_bend < -0.2
    assert track.circle.radius == pytest.approx(RADIUS, abs=0.1)
    assert abs(track.circle.radius - RADIUS) < 3 * track.circle.sd_radius
    assert any("too bright for the camera" in sentence for sentence in track.warnings)


@pytest.mark.parametrize("exponent", [0.45, 1.0])
def test_a_ball_that_is_darker_and_brighter_than_its_background_has_an_uncertain_radius(exponent: float) -> None:
    """The tone curve moves the edges of its bright parts outwards, and those of its dark parts inwards."""
    track = track_of(exponent, 0.4, blur_px=1.0)
    assert (track.status == "ok").all()
    assert abs(track.circle.radius - RADIUS) < 2.5 * track.circle.sd_radius
    assert (track.circle.sd_radius > 0.07) == (exponent < 1)


def test_levels_that_are_proportional_to_the_light_have_no_tone_curve() -> None:
    track = track_of(1.0, 0.08)
    assert made_map(track).edge_bend == 0
    assert not any("proportional to the light" in sentence for sentence in track.warnings)


def test_a_pixel_that_is_covered_by_half_seems_to_be_covered_by_more() -> None:
    half = torch.full((1,), 0.5)
    share, by_radius, _ = rays.bent((half, half, half), 0.4)
    assert float(share) == pytest.approx(0.6)
    assert float(by_radius) == pytest.approx(0.5)
    at, ball = poses(1), rough_ball()
    bright = replace(ball, coefficients=torch.full_like(ball.coefficients, 200.0))
    seen = windows(at)
    plain, bent = (forward_model.linearise(seen, at, replace(bright, edge_bend=bend)).levels for bend in (0.0, 0.4))
    # The ball is brighter than its background.
    assert float((bent - plain).min()) > -1e-9
    assert float((bent - plain).max()) > 5
