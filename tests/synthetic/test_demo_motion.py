"""The demo's motion obeys mechanics: rates are derivatives, friction brakes and spins, momentum is kept."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from torchsphere.synthetic import demo_motion as motion

#: Ends of the contact, moments around them and in each part of the shot, frames.
EDGES = (motion.CONTACT_START, motion.CONTACT_START + motion.CONTACT_LENGTH)
MOMENTS = np.array(
    [3.0, 20.4, EDGES[0] - 1e-6, EDGES[0] + 1e-6, 29.0, 32.3, 36.1, EDGES[1] - 1e-6, EDGES[1] + 1e-6, 60.0]
)


@pytest.mark.parametrize(("value", "rate"), [("position", "velocity"), ("velocity", "acceleration")])
def test_velocity_and_acceleration_are_derivatives_at_every_moment_and_jump_nowhere(value: str, rate: str) -> None:
    step = 1e-4
    of, stated = getattr(motion, value), getattr(motion, rate)
    difference = (of(MOMENTS + step) - of(MOMENTS - step)) / (2 * step)
    # The acceleration has a corner at the ends, of 0.26 px/frame^3: a quarter of it times the step.
    np.testing.assert_allclose(stated(MOMENTS), difference, atol=1e-5)


def test_the_orientation_turns_with_the_spin() -> None:
    turned = motion.orientation(motion.FRAMES)
    steps = Rotation.from_matrix(turned[1:] @ turned[:-1].swapaxes(1, 2)).as_rotvec()
    middle = motion.spin(np.arange(motion.FRAMES - 1) + 0.5)
    in_flight = np.r_[0:25, 39:70]
    np.testing.assert_allclose(steps[in_flight], middle[in_flight], atol=1e-12)
    # In the contact the step is the spin's integral; Simpson's rule is good to 1e-8 rad.
    first, last = motion.spin(np.arange(27, 37)), motion.spin(np.arange(28, 38))
    np.testing.assert_allclose(steps[27:37], (first + 4 * middle[27:37] + last) / 6, atol=3e-7)


def test_the_ball_flies_right_is_thrown_back_left_and_its_touching_side_is_dragged_up_as_it_slid_down() -> None:
    before, after = motion.VELOCITY_BEFORE, motion.VELOCITY_AFTER
    assert before[0] > 0 > after[0]
    # y points down: the right side slides down, so that friction pushes the ball up and turns this side up.
    assert before[1] > after[1]
    assert motion.SPIN_AFTER[2] < motion.SPIN_BEFORE[2]


def test_the_friction_is_the_torque_and_ends_the_sliding() -> None:
    change = motion.VELOCITY_AFTER - motion.VELOCITY_BEFORE
    contact = np.array([motion.RADIUS_PX, 0.0, 0.0])
    turned = 0.4 * motion.RADIUS_PX**2 * (motion.SPIN_AFTER - motion.SPIN_BEFORE)
    np.testing.assert_allclose(turned, np.cross(contact, change), atol=1e-12)
    slip = motion.VELOCITY_AFTER + np.cross(motion.SPIN_AFTER, contact)
    np.testing.assert_allclose(slip[1:], 0.0, atol=1e-12)


def test_the_force_is_0_in_flight_and_its_integral_is_the_change_of_velocity() -> None:
    np.testing.assert_allclose(motion.acceleration([0.0, EDGES[0], EDGES[1], 70.0]), 0.0, atol=1e-12)
    for axis in range(2):
        gained, _ = quad(lambda t, k=axis: motion.acceleration([t])[0, k], *EDGES, epsabs=1e-12)
        assert gained == pytest.approx(motion.VELOCITY_AFTER[axis] - motion.VELOCITY_BEFORE[axis], abs=1e-9)
