"""Motions around a contact, drawn within the errors of data, calibration and inputs.

All errors of a motion come together in `Draws`. `Draws.by_sources` gives motions with the errors of some sources alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from torchsphere.dynamics.shared_errors import InputErrors, SharedErrors
from torchsphere.dynamics.units import Units
from torchsphere.estimation.rates import Motion, MotionContact
from torchsphere.runtime.arrays import Array


@dataclass(frozen=True)
class Undisturbed:
    """The smoothed motion around a contact without drawn errors, px and frames, and the errors that may be drawn."""

    rate: Array  # (m, 5)
    acceleration: Array  # (m, 5)
    frames: Array  # (m,), times
    interval: Array  # (2,), start and end of the contact
    shared: SharedErrors
    units: Units


@dataclass(frozen=True)
class Draws:
    """Motions (s of them) around a contact, drawn within the errors of data and calibration.

    Attributes
    ----------
    velocity_m_s, acceleration_m_s2 : ndarray
        (s, m, 2).
    spin_rad_s : ndarray
        (s, m, 3).
    contact_s : ndarray
        Start and end of the contact (s, 2).
    span : slice
        The m of the n frames that they cover.
    between_m_s2 : ndarray
        Accelerations (s, m, j, 2) after each frame, less the straight line to the next one.
    fractions : ndarray
        Shares (j,) of the step to the next frame at which they lie.
    inputs : InputErrors
        Errors (s,) of frame rate, length and mass of each motion.
    undisturbed : Undisturbed
    """

    velocity_m_s: Array
    acceleration_m_s2: Array
    spin_rad_s: Array
    contact_s: Array
    span: slice
    between_m_s2: Array
    fractions: Array
    inputs: InputErrors
    undisturbed: Undisturbed

    def at(self, frames: Sequence[int]) -> Draws:
        """The same motions in some of the m frames alone, in their order."""
        chosen = list(frames)
        return replace(
            self,
            velocity_m_s=self.velocity_m_s[:, chosen],
            acceleration_m_s2=self.acceleration_m_s2[:, chosen],
            spin_rad_s=self.spin_rad_s[:, chosen],
            between_m_s2=self.between_m_s2[:, chosen],
        )

    def by_sources(self, sources: Sequence[str], frames: Sequence[int]) -> Draws:
        """The smoothed motion in some frames with the errors of the ``sources`` of `shared_errors.SHARED` alone.

        The errors are those of these motions: the sum over all sources is, to first order, the error of a motion.
        """
        chosen, count, undisturbed = list(frames), len(self.contact_s), self.undisturbed
        rate, acceleration = (
            np.broadcast_to(values[chosen], (count, len(chosen), 5))
            for values in (undisturbed.rate, undisturbed.acceleration)
        )
        interval = np.broadcast_to(undisturbed.interval, (count, 2))
        part = replace(undisturbed, frames=undisturbed.frames[chosen], shared=undisturbed.shared.by_sources(sources))
        return _disturbed(part, rate, acceleration, interval, self.span)


def drawn_motions(contact: MotionContact, motion: Motion, frames: Array, shared: SharedErrors, units: Units) -> Draws:
    """Drawn motions in SI units, each with shared errors of its own; ``frames`` (n,) are the times of the frames."""
    samples = contact.samples
    part = samples.span
    undisturbed = Undisturbed(
        motion.rate[part], motion.acceleration[part], frames[part], contact.interval, shared, units
    )
    drawn = _disturbed(undisturbed, samples.rate, samples.acceleration, samples.interval, part)
    # One product: there are a million accelerations between frames.
    factor = units.translation(np.ones(2), 2) * drawn.inputs.faster[:, None, None, None] ** 2
    return replace(drawn, between_m_s2=samples.between * factor, fractions=samples.fractions)


def _disturbed(about: Undisturbed, rate: Array, acceleration: Array, interval: Array, span: slice) -> Draws:
    """Motions with the given rates and accelerations (s, m, 5) and contacts (s, 2), and with shared errors."""
    shared, units = about.shared, about.units
    rate, acceleration = shared.draw(rate, acceleration, about.frames, interval)
    inputs = shared.draw_inputs(len(rate))
    velocity, spin = units.rates(rate)
    faster = inputs.faster[:, None, None]
    return Draws(
        velocity_m_s=velocity * faster,
        acceleration_m_s2=units.rates(acceleration, 2)[0] * faster**2,
        spin_rad_s=spin * faster,
        contact_s=interval / units.frame_rate / inputs.faster[:, None],
        span=span,
        between_m_s2=np.zeros((*rate.shape[:2], 0, 2)),
        fractions=np.zeros(0),
        inputs=inputs,
        undisturbed=about,
    )
