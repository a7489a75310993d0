"""Forms of the force in a contact: envelopes that begin and end at 0, which a height multiplies.

A form is a vector of six numbers: the powers with which the force begins and ends, the shares of the contact at which
it has risen and from which it falls where it has kinks, the roughness of the height, and whether it is the elastic
contact of Hertz. With the powers 1 and 2 at both ends it is a half-sine (a ball on a linear spring) and a squared sine.
With kinks and the powers 0 it consists of straight lines. Numbers that are all 0 stand for no form, but for the rough
process of `process_model`.

In the contact of Hertz the force grows as the penetration ``d`` to the power 1.5. By conservation of energy its share
of the largest penetration at the share ``u`` of the way to the turning point has ``I(d^2.5; 2/5, 1/2) = u``, with the
regularised incomplete beta function ``I`` (Johnson, Contact Mechanics, 1985, section 11.4).
"""

from __future__ import annotations

import functools
import math

import numpy as np

from torchsphere.runtime.arrays import Array

#: Places of the numbers in a form, and their names in a summary.
ONSET, DECAY, RISEN, FALLING, ROUGHNESS, HERTZ = range(6)
NAMES = ("onset_power", "decay_power", "risen_share", "falling_share", "roughness", "is_hertz")

#: Power of the penetration in the force of Hertz.
HERTZ_POWER = 1.5

#: Roughness of a force that follows its form, and of one that departs from it by as much as its size
#: (docs/constants.toml).
SMOOTH, ROUGH = 5e-4, 1.0

#: Points in a table of half of that force: linear interpolation is exact to 1e-7 of the peak.
HERTZ_POINTS = 1001

#: Least part of the contact before, between and after the kinks, as a share (docs/constants.toml).
MIN_PART = 0.03

#: The forms that are weighed (docs/constants.toml).
FORMS = (
    *((power, power, 0.0, 1.0, SMOOTH, 0.0) for power in (1.0, 1.25, 1.5, 1.75, 2.0)),
    (HERTZ_POWER, HERTZ_POWER, 0.0, 1.0, SMOOTH, 1.0),
    *((onset, decay, 0.0, 1.0, ROUGH, 0.0) for onset, decay in ((1.0, 1.0), (1.5, 1.5), (1.0, 2.0), (2.0, 1.0))),
    (0.0, 0.0, 0.5, 0.5, SMOOTH, 0.0),
    (0.0, 0.0, 0.25, 0.75, SMOOTH, 0.0),
)


def envelope(share: Array, forms: Array) -> Array:
    """Force (..., m) over its height at shares (..., m) of the contact, of forms (..., 6); 0 before and after."""
    # A report takes the power of Hertz alone, and loads no compiler.
    from torchsphere.kernels import contact_steps

    forms = np.broadcast_to(forms, (*share.shape[:-1], forms.shape[-1])).reshape(-1, forms.shape[-1])
    flat = np.ascontiguousarray(share, dtype=np.float64).reshape(-1, share.shape[-1])
    found = np.empty_like(flat)
    contact_steps.envelopes(flat, np.ascontiguousarray(forms), hertz_over_sine(), found)
    return found.reshape(share.shape)


def hertz(share: Array) -> Array:
    """Force over its peak in an elastic contact of Hertz, at shares of the contact from 0 to 1."""
    # A report takes the power of Hertz alone, and loads no SciPy.
    from scipy.special import betaincinv

    way = betaincinv(1 / (1 + HERTZ_POWER), 0.5, 1 - np.abs(2 * share - 1))
    return np.asarray(way ** (HERTZ_POWER / (1 + HERTZ_POWER)))


@functools.cache
def hertz_over_sine() -> Array:
    """The force of Hertz over a sine to the same power (p,), at even shares of 0 to 0.5: smooth, also at the ends."""
    # The ratio is even and nearly constant at the start, where both forces are 0.
    near = np.maximum(np.linspace(0.0, 0.5, HERTZ_POINTS), 1e-4)
    return np.asarray(hertz(near) / np.sin(math.pi * near) ** HERTZ_POWER)
