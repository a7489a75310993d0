"""The largest force of a contact and its time, from the smoothed motion, with the errors of the drawn ones."""

from __future__ import annotations

import numpy as np

from torchsphere.dynamics.ball import Ball, drawn_ball
from torchsphere.dynamics.draws import Draws
from torchsphere.dynamics.flights import in_contact
from torchsphere.dynamics.impact_estimate import Estimate
from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.dynamics.rebound import norm
from torchsphere.runtime.arrays import Array


def peak_frame(motion: Kinematics, draws: Draws) -> tuple[int, Array]:
    """The frame of the largest force in the contact, counted in those drawn, and the force's direction (2,)."""
    acceleration = motion.acceleration_m_s2[draws.span]
    size = np.where(np.isfinite(acceleration).all(1), norm(acceleration), -np.inf)
    assert motion.contact_s is not None
    outside = ~in_contact(motion.time_s[draws.span], *motion.contact_s)
    frame = int((size if outside.all() else np.where(outside, -np.inf, size)).argmax())
    return frame, acceleration[frame] / norm(acceleration[frame])


def peak_force(motion: Kinematics, draws: Draws, ball: Ball, at_peak: tuple[int, Array]) -> tuple[Estimate, Estimate]:
    """Largest force and its time, between the frames as the drawn motions go there; ``at_peak`` by `peak_frame`.

    To first order the error of the largest force is that of its moment. The largest forces of the drawn motions are no
    measure of this error, because noise raises every maximum.
    """
    time_s, acceleration = motion.time_s[draws.span], motion.acceleration_m_s2[draws.span]
    _, direction = at_peak
    mass = drawn_ball(ball, draws.inputs.mass, draws.inputs.length).mass_kg
    between = draws.between_m_s2 @ direction
    times = _finer(time_s, 0.0 * between[:1], draws.fractions)[0]
    own = (between / draws.inputs.faster[:, None, None] ** 2).mean(0, keepdims=True)
    force = ball.mass_kg * _finer(acceleration @ direction, own, draws.fractions)[0]
    drawn = mass[:, None] * _finer(draws.acceleration_m_s2 @ direction, between, draws.fractions)
    assert motion.contact_s is not None
    outside = ~in_contact(times, *motion.contact_s)
    force = np.where(np.isfinite(force) & (~outside | outside.all()), force, -np.inf)
    at = int(force.argmax())
    latest = times[np.where(np.isfinite(force), drawn, -np.inf).argmax(1)]
    # The largest of values at fixed times is known to their spacing, even where all drawn motions agree on one.
    sd_spacing = float(np.median(np.diff(times))) / np.sqrt(12)
    sd, sd_time = float(np.std(drawn[:, at])), float(np.hypot(np.nanstd(latest / draws.inputs.faster), sd_spacing))
    peak_time = Estimate(np.asarray(times[at]), np.asarray(sd_time), "s")
    return Estimate(np.asarray(force[at]), np.asarray(sd), "N"), peak_time


def _finer(values: Array, between: Array, fractions: Array) -> Array:
    """Values (s, f) in and between the m frames from those (m,) or (s, m) in the frames.

    ``between`` (s, m, j) is what they have beyond the straight line at the ``fractions`` (j,) of the steps.
    """
    values = np.broadcast_to(values, between.shape[:2])
    line = values[:, :-1, None] + np.diff(values)[..., None] * fractions
    steps = np.concatenate((values[:, :-1, None], line + between[:, :-1]), -1)
    return np.concatenate((steps.reshape(len(values), -1), values[:, -1:]), -1)
