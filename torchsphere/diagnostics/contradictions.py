"""Results that contradict themselves: velocities against positions, and residual images that are no noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torchsphere.dynamics.kinematics import Kinematics
from torchsphere.runtime.warning_levels import severe
from torchsphere.sphere_map.decision import MadeMap
from torchsphere.tracking.result import Track

#: Difference of positions and the integral of the velocity, in standard deviations of the velocity, that contradicts
#: it (docs/constants.toml).
CONTRADICTION_SD = 5.0

#: Difference of positions and the integral of the velocity that is none, px (docs/constants.toml).
NEGLIGIBLE_PX = 0.25

#: Factor on the standard deviations of the steps, and residual over noise, of a residual that is no noise
#: (docs/constants.toml).
STRUCTURED_WIDENING, STRUCTURED_RESIDUAL = 3.0, 1.5

Array = NDArray[np.float64]


def contradictions(track: Track, motion: Kinematics | None) -> tuple[str, ...]:
    """Sentences on a result that contradicts itself."""
    return (*_velocity_against_position(motion), *_structured_residual(track))


def _velocity_against_position(motion: Kinematics | None) -> tuple[str, ...]:
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


def _structured_residual(track: Track) -> tuple[str, ...]:
    """A sentence if the residual images on the map are alike over many pixels, as no noise is."""
    made = track.findings.map
    if not isinstance(made, MadeMap):
        return ()
    widened, over_noise = made.widened, made.residual_over_noise
    is_large = over_noise >= STRUCTURED_RESIDUAL
    # A codec's blocks are alike over many pixels; another sentence reports the codec.
    is_alike = widened >= STRUCTURED_WIDENING and not track.findings.coded
    if not (is_large or is_alike):
        return ()
    signs = [f"they are {over_noise:.1f} times as large"] if is_large else []
    signs += [f"alike over many pixels, which widens standard deviations up to {widened:.1f} times"] if is_alike else []
    return (
        f"The residual images are no noise: {', and '.join(signs)}. The ball as modelled does not explain its images: "
        "likely causes are moving light or reflections, a wrong circle, a body that is no sphere, or a near camera. "
        "Look at the residual in the report.",
    )
