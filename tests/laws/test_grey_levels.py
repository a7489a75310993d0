"""No result hangs on gain and offset of the images: found circles, pairs and their uncertainties.

`test_continuity` has the same law for a whole measurement with its map.
"""

import numpy as np
import pytest
from shots import shot, textured

import torchsphere as ts

#: Gain and offset of the levels: 16 bit and 8 bit as numbers from 0 to 1, large ones, and levels below 0.
LEVELS = [(1 / 65535, 0.0), (1 / 255, 3.0), (1e4, 1e6), (1.0, -500.0)]

#: Seed, radius (px) and background of recordings, and the levels of each: every gain stands with two of them or one.
RECORDINGS = [(3, 14.0, 90.0, LEVELS[:2]), (5, 24.0, textured(5, 3.0, 20.0), LEVELS[2:]), (8, 40.0, 60.0, LEVELS[2:3])]


@pytest.mark.parametrize(
    ("seed", "radius", "background", "levels"), RECORDINGS, ids=["small", "before blotches", "large"]
)
def test_a_found_ball_and_its_steps_are_those_of_any_levels(
    seed: int, radius: float, background: object, levels: list[tuple[float, float]]
) -> None:
    made = shot(seed, n=5, radius=radius, background=background, start=(1.6 * radius + 20, 120.0), step=(2.3, 0.4))
    images = made.images.double().numpy()
    expected = ts.track(images, sphere_map=False, log=False)
    assert set(expected.status) == {"ok"}
    sd = np.sqrt(np.diagonal(expected.covariance, axis1=1, axis2=2))
    for gain, offset in levels:
        found = ts.track(gain * images + offset, sphere_map=False, log=False)
        assert found.status.tolist() == expected.status.tolist()
        assert np.abs((found.increment - expected.increment) / sd).max() < 0.01
        np.testing.assert_allclose(np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2)), sd, rtol=1e-3)
        assert abs(found.circle.radius - expected.circle.radius) < 0.01 * expected.circle.sd_radius


@pytest.mark.parametrize("engine", ["fast", "plain"])
def test_a_pair_is_measured_alike_in_any_levels(engine: str) -> None:
    made = shot(8, n=2, radius=30.0, background=60.0, start=(84.0, 120.0), step=(0.4, 0.3))
    f, g = made.images.double().numpy()
    circle = (*made.centres[0].tolist(), made.radius)
    expected = ts.correlate(f, g, circle, engine=engine)
    sd = expected.covariance[0].diagonal().sqrt()
    for gain, offset in LEVELS:
        found = ts.correlate(gain * f + offset, gain * g + offset, circle, engine=engine)
        # Levels times 1e4 moved it by 0.06 standard deviations.
        assert float(((found.q - expected.q)[0] / sd).abs().max()) < 1e-3
        assert float((found.covariance[0].diagonal().sqrt() / sd - 1).abs().max()) < 1e-3
