"""Motions drawn with the errors of some sources alone."""

import dataclasses

import numpy as np
import pytest
from pulses import M_PER_PX, NOISES_M, RATE, pulse

import torchsphere as ts
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.dynamics.shared_errors import SHARED


@pytest.fixture(scope="module")
def motion() -> Kinematics:
    """Give the smoothed pulse with an error of every source."""
    track = pulse(11, NOISES_M[0]).track
    circle = dataclasses.replace(track.circle, sd_radius=0.05, sd_x=0.1, sd_y=0.1)
    uncertain = dataclasses.replace(track, circle=circle, sd_steady=np.array([1e-3, 1e-3, 1e-5, 1e-5, 1e-5]))
    given = {"relative_sd_scale": 1e-3, "relative_sd_frame_rate": 1e-3}
    first, many = (
        ts.kinematics(uncertain, frame_rate=RATE, m_per_px=M_PER_PX, **given),
        ts.kinematics_of_many([uncertain], frame_rate=RATE, m_per_px=M_PER_PX, **given),
    )
    np.testing.assert_array_equal(first.sd_velocity_m_s, many[0].sd_velocity_m_s)
    return first


def test_without_a_source_all_motions_are_the_smoothed_one(motion: Kinematics) -> None:
    assert motion.draws is not None
    assert motion.contact_s is not None
    frames = [30, 40, 50]
    plain = motion.draws.by_sources((), frames)
    for drawn, smoothed in (
        (plain.velocity_m_s, motion.velocity_m_s[frames]),
        (plain.acceleration_m_s2, motion.acceleration_m_s2[frames]),
        (plain.spin_rad_s, motion.spin_rad_s[frames]),
        (plain.contact_s, motion.contact_s),
    ):
        np.testing.assert_allclose(drawn, np.broadcast_to(smoothed, drawn.shape), rtol=1e-12)


def test_the_errors_of_the_sources_add_up_to_those_of_all_in_every_motion(motion: Kinematics) -> None:
    assert motion.draws is not None
    frames = [30, 40, 50]
    plain, together = (motion.draws.by_sources(sources, frames) for sources in ((), SHARED))
    parts = [motion.draws.by_sources((source,), frames) for source in SHARED]
    for name in ("velocity_m_s", "acceleration_m_s2", "spin_rad_s", "contact_s"):
        smoothed = getattr(plain, name)
        total = getattr(together, name) - smoothed
        added = sum(getattr(part, name) - smoothed for part in parts)
        # Errors of 0.1 % each: products of two of them are 1e-3 of the error, a few times that in the tail.
        assert np.abs(added - total).max() < 0.02 * np.abs(total).max()


def test_chosen_frames_are_those_of_the_drawn_motions(motion: Kinematics) -> None:
    assert motion.draws is not None
    chosen = motion.draws.at([50, 30])
    np.testing.assert_array_equal(chosen.velocity_m_s, motion.draws.velocity_m_s[:, [50, 30]])
    np.testing.assert_array_equal(chosen.spin_rad_s[:, 1], motion.draws.spin_rad_s[:, 30])
    np.testing.assert_array_equal(chosen.contact_s, motion.draws.contact_s)
