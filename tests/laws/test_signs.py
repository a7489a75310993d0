"""Axes and signs, each with a pair of images that a person can imagine.

A grey ball carries one bright spot; x points to the right, y down. The first test asserts the motion of the spot in the
image, the second the sign and size that the correlation gives for a speckled ball with the same motion.
"""

import numpy as np
import pytest
import torch
from shots import pair, spot

from torchsphere import correlate

ANGLE = 2.0  # deg
SHIFT = 1.5  # px
R = 50.0
FRONT_PX = R * np.deg2rad(ANGLE)  # motion of the front of the ball: 1.745 px

FRONT, TOP, RIGHT = (0.0, 0.0), (0.0, -0.6), (0.6, 0.0)

# Motion (dx, dy, wx, wy, wz), px and degrees; place of the spot, radii; its motion (right, down) in the image, px.
MOTIONS = {
    "+dx moves the ball to the right": ((SHIFT, 0, 0, 0, 0), FRONT, (SHIFT, 0)),
    "-dx moves the ball to the left": ((-SHIFT, 0, 0, 0, 0), FRONT, (-SHIFT, 0)),
    "+dy moves the ball down": ((0, SHIFT, 0, 0, 0), FRONT, (0, SHIFT)),
    "-dy moves the ball up": ((0, -SHIFT, 0, 0, 0), FRONT, (0, -SHIFT)),
    "+wx moves the front down": ((0, 0, ANGLE, 0, 0), FRONT, (0, FRONT_PX)),
    "-wx moves the front up": ((0, 0, -ANGLE, 0, 0), FRONT, (0, -FRONT_PX)),
    "+wy moves the front to the left": ((0, 0, 0, ANGLE, 0), FRONT, (-FRONT_PX, 0)),
    "-wy moves the front to the right": ((0, 0, 0, -ANGLE, 0), FRONT, (FRONT_PX, 0)),
    "+wz moves the top to the right (clockwise)": ((0, 0, 0, 0, ANGLE), TOP, (0.6 * FRONT_PX, 0)),
    "+wz moves the right side down (clockwise)": ((0, 0, 0, 0, ANGLE), RIGHT, (0, 0.6 * FRONT_PX)),
    "-wz moves the top to the left": ((0, 0, 0, 0, -ANGLE), TOP, (-0.6 * FRONT_PX, 0)),
}
CASES = pytest.mark.parametrize(("motion", "place", "shift"), MOTIONS.values(), ids=MOTIONS.keys())


def bright_centroid(image: torch.Tensor) -> np.ndarray:
    """Centroid (x, y), px, of the light above ball and background."""
    light = (image - 65).clamp_min(0)
    y, x = torch.meshgrid(*(torch.arange(s, dtype=torch.float64) for s in image.shape), indexing="ij")
    return np.array([float((light * x).sum()), float((light * y).sum())]) / float(light.sum())


@CASES
def test_the_bright_spot_moves_as_the_sentence_says(
    motion: tuple[float, ...], place: tuple[float, float], shift: tuple[float, float]
) -> None:
    f, g, (x, y, radius) = pair(motion, pattern=spot(*place), background=60.0)
    before, after = bright_centroid(f), bright_centroid(g)
    # The spot is 5 px wide on a curved surface: its centroid differs from its middle by 1 % of a radius at 0.6 R, in f
    # and nearly as much in g. The difference in the motion of 1.0 to 1.75 px is less than 0.1 px.
    np.testing.assert_allclose(before, (x + place[0] * radius, y + place[1] * radius), atol=1.0)
    np.testing.assert_allclose(after - before, shift, atol=0.1)


@CASES
def test_correlation_finds_sign_and_size_of_the_same_motion(
    motion: tuple[float, ...], place: tuple[float, float], shift: tuple[float, float]
) -> None:
    f, g, circle = pair(motion)
    found = correlate(f, g, circle)
    assert found.status.tolist() == ["ok"]
    q = found.q[0].numpy().copy()
    q[2:] = np.rad2deg(q[2:])
    # Linearising 2 deg costs 0.007 px on average; the bound for one pattern is 0.02 px, and 0.02 px / 50 px = 0.023 deg
    # of rotation. A wrong sign would cost 3 px or 4 deg.
    np.testing.assert_allclose(q[:2], motion[:2], atol=0.02)
    np.testing.assert_allclose(q[2:], motion[2:], atol=0.03)
