"""A ball that is darker towards the corners of the image: told, and turns are as uncertain as that makes them."""

import numpy as np
import pytest
import torch
from shots import noisy, rotation_matrix
from tracks import made_map

import torchsphere as ts
from torchsphere.sphere_map.ball import Poses
from torchsphere.sphere_map.falloff import falloff
from torchsphere.synthetic import ray_caster

RADIUS, FRAMES, SHAPE = 24.0, 20, (110, 220)
TURN = np.radians([0.4, 1.6, -0.9])
MIDDLE = torch.tensor([(SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2], dtype=torch.float64)


def places() -> torch.Tensor:
    return torch.tensor([32.0, 45.0]) + torch.arange(FRAMES)[:, None] * torch.tensor([7.4, 0.9])


def track_of(share: float) -> ts.Track:
    turns = torch.stack([rotation_matrix(torch.from_numpy(number * TURN)) for number in range(FRAMES)]).float()
    images = ray_caster.render(ray_caster.speckle(5, radius_px=RADIUS), places(), RADIUS, turns, 90.0, shape=SHAPE)
    x, y = torch.arange(SHAPE[1]) - MIDDLE[0], torch.arange(SHAPE[0]) - MIDDLE[1]
    distance = (x**2 + y[:, None] ** 2) / MIDDLE.square().sum()
    images = noisy(images * (1 - share * distance).float(), 1.5, 2)
    given = {"frame_rate": 1e4, "diameter_mm": 40.0, "telecentric": True, "log": False}
    return ts.track(images, (*places()[0].tolist(), RADIUS), **given)


@pytest.mark.parametrize("share", [0.25, 0.4])
def test_vignetting_is_told_and_the_spin_is_as_uncertain_as_it_makes_it(share: float) -> None:
    track = track_of(share)
    assert (track.status == "ok").all()
    assert 0.4 * share < made_map(track).falloff < 1.2 * share
    assert any("The ball is darker away from the image's middle" in sentence for sentence in track.warnings)
    motion = ts.kinematics(track, log=False)
    off = (motion.spin_rad_s - 1e4 * TURN) / motion.sd_spin_rad_s
    assert np.nanmax(np.abs(off)) < 3


def test_an_even_image_and_a_lamp_that_flickers_show_none() -> None:
    track = track_of(0.0)
    assert made_map(track).falloff == 0
    assert not any("is darker" in sentence for sentence in track.warnings)
    at = places().double()
    poses = Poses.at(at, torch.eye(3, dtype=torch.float64).expand(FRAMES, 3, 3))
    flicker = poses.brightened(torch.stack((0.2 * torch.sin(0.9 * torch.arange(FRAMES)), torch.zeros(FRAMES)), 1))
    assert falloff(flicker, 120.0, MIDDLE) == 0
