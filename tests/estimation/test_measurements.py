"""Poses with independent errors, out of steps of which some lack the rotation."""

import dataclasses

import numpy as np
import torch
from tracks import made_track

import torchsphere as ts
from torchsphere.estimation.measurements import poses

#: Frames with steps of the outline alone, and frames with steps of the texture.
PLAIN, TEXTURED = 20, 8


def half_textured() -> ts.Track:
    """A ball whose texture comes into view: from it translation and rotation are known together better than alone."""
    n = PLAIN + TEXTURED
    sd = np.array([0.04, 0.04, 1e-3, 1e-3, 1e-3])
    track = made_track(np.tile([3.0, 0.4, 0.0, 0.0, 0.0], (n, 1)), sd, ts.Circle(50.0, 40.0, 30.0, 0.0, 0.0, 0.0))
    covariance, increment = track.covariance.copy(), track.increment.copy()
    for i, j in ((0, 3), (1, 2)):
        covariance[:, i, j] = covariance[:, j, i] = 0.95 * sd[i] * sd[j]
    covariance[:PLAIN, 2:], covariance[:PLAIN, :, 2:], increment[:PLAIN, 2:] = np.nan, np.nan, np.nan
    covariance[:PLAIN, :2, :2] = np.diag([0.01, 0.01]) ** 2
    return dataclasses.replace(track, covariance=covariance, increment=increment, settings={})


def test_no_pose_has_a_covariance_that_none_can_have() -> None:
    found = poses([half_textured()], [np.arange(PLAIN + TEXTURED + 1.0)])
    smallest = torch.linalg.eigvalsh(found.covariance[0] / found.unit[0] / found.unit[0, :, None])[:, 0]
    assert torch.all(smallest >= 0)
    # Where both come from the same steps, what they say of one another stays.
    both = found.covariance[0, PLAIN + 1 :]
    torch.testing.assert_close(both[:, 0, 3], 0.95 * (both[:, 0, 0] * both[:, 3, 3]).sqrt())


def test_texture_that_comes_into_view_does_not_end_the_smoother() -> None:
    motion = ts.kinematics(half_textured(), frame_rate=1000.0, m_per_px=5e-4)
    np.testing.assert_allclose(motion.velocity_m_s[:, 0], 1.5, atol=0.01)
    assert np.isfinite(motion.sd_velocity_m_s).all()
