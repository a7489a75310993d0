"""An impact needs a flight on either side: enough measured frames, in which nothing pushes the ball."""

import dataclasses
import re

import numpy as np
import pytest
from pulses import LENGTH, M_PER_PX, MASS_KG, NOISES_M, RATE, Pulse, pulse

import torchsphere as ts
from experiments.validation import simulated_impacts
from torchsphere.dynamics.flights import flight_frames, is_confirmed, is_spin_known, sides
from torchsphere.dynamics.impact import impact
from torchsphere.dynamics.kinematics import FoundContact, Kinematics


@pytest.fixture(scope="module")
def truth() -> Pulse:
    return pulse(11, NOISES_M[0])


@pytest.fixture(scope="module")
def motion(truth: Pulse) -> Kinematics:
    return ts.kinematics(truth.track, frame_rate=RATE, m_per_px=M_PER_PX, mass_kg=MASS_KG, log=False)


def seen_in(motion: Kinematics, rows: np.ndarray) -> Kinematics:
    """The motion, of which only the frames ``rows`` (n,) were measured."""
    assert motion.track is not None
    position, orientation = motion.track.position.copy(), motion.track.orientation.copy()
    position[~rows], orientation[~rows] = np.nan, np.nan
    increment = np.where((rows[1:] & rows[:-1])[:, None], motion.track.increment, np.nan)
    track = dataclasses.replace(motion.track, position=position, orientation=orientation, increment=increment)
    return dataclasses.replace(motion, track=track, is_measured=rows)


def few(motion: Kinematics, before: int, after: int) -> Kinematics:
    """The motion with so many measured frames before and after the contact, next to it."""
    earlier, later = (side.measured for side in sides(motion, contact_of(motion)))
    frames = np.arange(len(motion.time_s))
    return seen_in(motion, (frames > earlier[-1] - before) & (frames < later[0] + after))


def contact_of(motion: Kinematics) -> FoundContact:
    [contact] = motion.contacts
    return contact


def reason_of(motion: Kinematics) -> str:
    found, reason = impact(motion, log=False)
    assert (found is None) == bool(reason)
    return reason


@pytest.mark.parametrize(("before", "after", "word"), [(2, 20, "before"), (20, 2, "after"), (20, 1, "after")])
def test_fewer_frames_than_a_flight_has_unknowns_give_no_impact_and_the_sentence_counts(
    motion: Kinematics, before: int, after: int, word: str
) -> None:
    reason = reason_of(few(motion, before, after))
    assert f"Only {min(before, after)} measured frame" in reason
    assert f"the flight {word} the contact: 3 are needed" in reason
    assert reason_of(few(motion, max(before, 3), max(after, 3))) == ""


def test_no_frame_on_a_side_is_a_contact_that_reaches_the_end(motion: Kinematics) -> None:
    assert reason_of(few(motion, 20, 0)).startswith("The contact reaches the end: no flight after it was measured.")
    both = reason_of(few(motion, 0, 2))
    assert "reaches the start" in both
    assert "Only 2 measured frames show the flight after" in both
    assert "The speed" not in both


def test_the_speed_of_the_side_that_is_known_is_said(motion: Kinematics, truth: Pulse) -> None:
    reason = reason_of(few(motion, 2, 20))
    value, sd = map(float, re.findall(r"The speed after it is ([\d.]+) ± ([\d.]+) m/s\.", reason)[0])
    assert abs(value - np.linalg.norm(truth.velocity_m_s[-1])) < 3 * sd
    # Five frames do not surely tell flight from contact, which is for a speed without an impact to do by itself.
    assert "The speed" not in reason_of(few(motion, 2, 4))


def test_places_that_nothing_confirms_do_not_count(motion: Kinematics) -> None:
    sparse = few(motion, 20, 6)
    assert sparse.track is not None
    # The ball is found anew by its outline in every frame after the contact, without a step from frame to frame.
    alone = np.arange(len(motion.time_s)) > 30 + LENGTH
    increment = np.where((alone[1:] | alone[:-1])[:, None], np.nan, sparse.track.increment)
    orientation = np.where(alone[:, None, None], np.nan, sparse.track.orientation)
    track = dataclasses.replace(sparse.track, increment=increment, orientation=orientation)
    lone = dataclasses.replace(sparse, track=track)
    assert np.isfinite(track.position[alone]).any()
    assert not is_confirmed(lone)[alone].any()
    assert "no flight after it was measured" in reason_of(lone)
    # With its texture the ball is confirmed where it is found again.
    textured = dataclasses.replace(lone, track=dataclasses.replace(track, orientation=sparse.track.orientation))
    assert reason_of(textured) == ""


def accelerated(motion: Kinematics, side: slice, m_s2: float, sd_m_s2: float) -> Kinematics:
    """The motion with another acceleration along x, and its standard deviation, in some frames."""
    acceleration, sd = motion.acceleration_m_s2.copy(), motion.sd_acceleration_m_s2.copy()
    acceleration[side], sd[side] = (m_s2, 0.0), sd_m_s2
    return dataclasses.replace(motion, acceleration_m_s2=acceleration, sd_acceleration_m_s2=sd)


def test_a_side_in_which_the_ball_is_pushed_or_may_be_is_no_flight(motion: Kinematics) -> None:
    contact = contact_of(motion)
    # Two thirds of the half-sine's largest force of 29 kN, on 110 g.
    mean = (motion.velocity_m_s[-1, 0] - motion.velocity_m_s[0, 0]) / np.diff(contact.contact_s)[0]
    assert mean == pytest.approx(-2 / np.pi * 29e3 / MASS_KG, rel=0.01)
    before = slice(0, 34)
    for share, sd, said in (
        (0.5, 0.01, "before the contact that was found the ball is pushed, too, with 48 % or more"),
        (0.0, 0.6, "before the contact that was found the ball may be pushed as in the contact itself"),
        (0.09, 0.0, ""),
        (0.5, 0.24, ""),
        # Gravity that pulls the ball to its target is no push from the target, however weak the impact.
        (-0.8, 0.01, ""),
    ):
        found = flight_frames(accelerated(motion, before, share * mean, sd * abs(mean)), contact)
        assert said in found if said else isinstance(found, list), found


def test_a_spin_that_changes_in_a_flight_of_few_frames_is_not_stated(motion: Kinematics) -> None:
    def turning(sparse: Kinematics, sds: float) -> Kinematics:
        rate = sparse.angular_acceleration_rad_s2.copy()
        rate[:, 1] = sds * sparse.sd_angular_acceleration_rad_s2[:, 1]
        return dataclasses.replace(sparse, angular_acceleration_rad_s2=rate)

    sparse = few(motion, 6, 20)
    assert is_spin_known(turning(sparse, 0.0), contact_of(motion))
    assert is_spin_known(turning(sparse, 1.5), contact_of(motion))
    assert not is_spin_known(turning(sparse, 2.5), contact_of(motion))
    # In long flights noise is known well enough to tell a step from a slope.
    assert is_spin_known(turning(motion, 2.5), contact_of(motion))
    (still, _), (found, reason) = impact(turning(sparse, 0.0), log=False), impact(turning(sparse, 2.5), log=False)
    assert still is not None
    assert found is not None, reason
    assert np.isnan(found.spin_after.value).all()
    assert found.energy_given is not None
    assert np.isnan(found.energy_given.value)
    assert any("cannot be told from one in flight" in sentence for sentence in found.missing)
    # Rotation and place share 95 % of their errors: without the rotation those of the speed are 1 / sqrt(1 - 0.95^2).
    assert found.speed_after.value == still.speed_after.value
    assert found.speed_after.sd == pytest.approx(3.2 * still.speed_after.sd, rel=0.02)


def test_three_places_of_which_two_lie_in_the_contact_are_no_flight() -> None:
    # A ball of 70 m/s in contact from frame 2.3 to 5.3, found in a few frames by its outline to 0.4 px. The straight
    # line through three of them made a speed before of 6.8 +- 0.9 m/s, and a restitution of 5.3 +- 0.7.
    push = simulated_impacts.rebound(simulated_impacts.half_sine, 2.3, 3.0)
    track = simulated_impacts.simulated([push], 13, 4e-5, 0).track
    seen = np.isin(np.arange(13), [0, 3, 5, 6, 8, 9, 10, 11])
    both = seen[1:] & seen[:-1]
    turns = np.arange(5) >= 2
    sparse = dataclasses.replace(
        track,
        position=np.where(seen[:, None], track.position, np.nan),
        increment=np.where(both[:, None] & ~turns, track.increment, np.nan),
        covariance=np.where(both[:, None, None] & ~(turns | turns[:, None]), track.covariance, np.nan),
        orientation=np.where(np.arange(13)[:, None, None] == 0, np.eye(3), np.nan),
        status=np.where(np.append(False, both), "weak_texture", "lost"),
    )
    motion = ts.kinematics(sparse, frame_rate=simulated_impacts.RATE, m_per_px=simulated_impacts.M_PER_PX, log=False)
    assert motion.contact_s is not None
    assert "shows the flight before the contact: 3 are needed" in reason_of(motion)
