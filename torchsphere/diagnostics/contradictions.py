"""Results that contradict themselves: velocities against positions."""

from __future__ import annotations

import numpy as np

from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.runtime.arrays import Array
from torchsphere.runtime.warning_levels import severe

#: Difference of positions and the integral of the velocity, in standard deviations of the velocity, that contradicts
#: it (docs/constants.toml).
CONTRADICTION_SD = 5.0

#: Difference of positions and the integral of the velocity that is none, px (docs/constants.toml).
NEGLIGIBLE_PX = 0.25


def contradictions(motion: Kinematics | None) -> tuple[str, ...]:
    """A sentence if the ball is elsewhere than its velocity leads, by more than the velocity's error explains."""
    if motion is None:
        return ()
    for part in _known_runs(motion):
        gap, allowed = _gap(motion, part)
        worst = int(np.argmax(gap - allowed))
        if gap[worst] <= allowed[worst]:
            continue
        first, last = motion.frame[[part.start, part.start + worst]]
        return (
            severe(
                f"Velocity and position contradict each other: from frame {first} to {last} the integral of the "
                f"velocity leads {1e3 * gap[worst]:.3g} mm away from the measured position, and its standard deviation "
                f"explains {1e3 * allowed[worst]:.3g} mm. One of the two is wrong: look at the path in the report, and "
                "measure the parts before and after a jump alone with `frames`."
            ),
        )
    return ()


def _known_runs(motion: Kinematics) -> list[slice]:
    """Runs of three or more frames with a position and a velocity."""
    known = np.isfinite(motion.position_m).all(1) & np.isfinite(motion.velocity_m_s).all(1)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], known, [False])).astype(int)))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a > 2]


def _gap(motion: Kinematics, part: slice) -> tuple[Array, Array]:
    """Distances (m,) of the positions from the integral of the velocity since the first frame, and what is allowed.

    The errors of the velocity may be the same in all frames. Between two frames the trapezoidal rule errs by a quarter
    of the change of the velocity at most.
    """
    position, velocity = motion.position_m[part], motion.velocity_m_s[part]
    interval = np.diff(motion.time_s[part])[:, None]
    way = np.concatenate((np.zeros((1, 2)), np.cumsum(0.5 * interval * (velocity[1:] + velocity[:-1]), axis=0)))
    gap = np.linalg.norm(position - position[0] - way, axis=1)
    sd_velocity, sd_position = (
        np.linalg.norm(np.nan_to_num(sd), axis=1) for sd in (motion.sd_velocity_m_s[part], motion.sd_position_m[part])
    )
    change = 0.25 * interval[:, 0] * np.linalg.norm(np.diff(velocity, axis=0), axis=1)
    reach = 0.5 * interval[:, 0] * (sd_velocity[1:] + sd_velocity[:-1])
    edge = np.zeros(1)
    by_velocity, by_rule = (np.concatenate((edge, np.cumsum(steps))) for steps in (reach, change))
    own = np.hypot(sd_position, sd_position[0])
    return gap, CONTRADICTION_SD * np.hypot(by_velocity, own) + by_rule + NEGLIGIBLE_PX * motion.scale.m_per_px
