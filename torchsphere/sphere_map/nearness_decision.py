"""Whether the images tell the distance of a camera that nobody stated, and what it is."""

from __future__ import annotations

import math
from dataclasses import replace

import torch

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import nearness, residual_scatter, shared_unknown
from torchsphere.sphere_map.bundle_adjustment import with_error_of_model
from torchsphere.sphere_map.forward_model import Linearisation
from torchsphere.sphere_map.level import LAST_SETTLED_PX, MAX_STEPS, Adjustment, Level, adjust_level, joint_equations
from torchsphere.sphere_map.perspective import Optics
from torchsphere.sphere_map.state import State

#: Nearness of the camera in its standard deviations from which the view is taken as perspective, and largest nearness
#: (docs/constants.toml).
SEEN_NEARNESS_SD, MAX_NEARNESS = 2.0, 0.3

#: Nearness by the first step, in its standard deviations, from which it is an unknown of the adjustment
#: (docs/constants.toml).
SUSPECTED_NEARNESS_SD = 1.3

#: Factor in the steps' errors from which the images tell nothing of the camera's distance: what the model lacks may be
#: a near camera, or look like one (docs/constants.toml).
MAX_FACTOR = 2.0

#: Change of a stated nearness by one step, in its standard deviations, up to which the images agree with it, and error
#: of what was stated over the change beyond that (docs/constants.toml).
AGREED_SD, ERROR_PER_STEP = 2.0, 1.5


def check_nearness(adjustment: Adjustment, optics: Optics, shared: RowRunner) -> Adjustment:
    """The adjustment before a camera whose distance was stated, with what its images say against that as its error.

    Only a nearer one: under a lamp the ball's front is brighter, and its images seem to lack perspective that they
    have. ``optics`` are those of a camera infinitely far away.
    """
    assert adjustment.last is not None
    before, model, joint = adjustment.last
    state = replace(before, windows=before.windows.seen_by(before.windows.optics or optics))
    try:
        found = shared_unknown.measure(nearness.UNKNOWN, state, model, joint, shared)
    except torch.linalg.LinAlgError:  # type: ignore[attr-defined]
        return adjustment
    sd = ERROR_PER_STEP * max(float(found.change) - AGREED_SD * float(found.sd), 0.0)
    return replace(adjustment.with_radius_error(found.of_radius * sd), sd_nearness=sd)


def find_nearness(adjustment: Adjustment, optics: Optics, shared: RowRunner) -> Adjustment:
    """The adjustment with the camera's distance, if the images tell it from one infinitely far away.

    ``optics`` are those of a camera infinitely far away. A nearness that is not seen, or that no camera can have, is
    left at 0, and stated as what it may be.
    """
    try:
        return _with_nearness(adjustment, optics, shared)
    except torch.linalg.LinAlgError:  # type: ignore[attr-defined]
        # A model that fits no image at all leaves no equations to solve.
        return replace(adjustment, sd_nearness=nearness.UNKNOWN_SD)


def _with_nearness(adjustment: Adjustment, optics: Optics, shared: RowRunner) -> Adjustment:
    assert adjustment.last is not None
    if adjustment.unknowns[-1:] == (nearness.UNKNOWN,):
        sd, of_radius = _told(adjustment, shared)
        is_near = float(nearness.nearness_of(adjustment.state)) > SEEN_NEARNESS_SD * nearness.apparent_sd(sd)
        # A near camera and a lens look alike, and the steps end before the two have parted.
        is_doubtful = is_near and _has_lens(adjustment.state)
        sd = nearness.UNKNOWN_SD if is_doubtful else nearness.total_sd(sd)
        return replace(adjustment.with_radius_error(of_radius * sd), sd_nearness=sd)
    before, model, joint = adjustment.last
    # A lens that was found stays.
    optics = before.windows.optics or optics
    far = replace(before, windows=before.windows.seen_by(optics))
    # By the equations of the last step: the step itself hardly matters.
    found = shared_unknown.measure(nearness.UNKNOWN, far, model, joint, shared)
    change, sd = float(found.change), float(found.sd)
    if change <= SUSPECTED_NEARNESS_SD * nearness.apparent_sd(sd):
        return _not_seen(adjustment, math.hypot(change, nearness.total_sd(sd)), found.of_radius)
    unknowns = (*adjustment.unknowns, nearness.UNKNOWN)
    level = Level(adjustment.state.ball.cells, LAST_SETTLED_PX, MAX_STEPS, is_last=True, unknowns=unknowns)
    start = replace(adjustment.state, windows=adjustment.state.windows.seen_by(optics))
    near = adjust_level(found.applied(start), level, shared)
    value = float(nearness.nearness_of(near.state))
    sd, of_radius = _told(near, shared)
    if near.settled and value <= SEEN_NEARNESS_SD * nearness.apparent_sd(sd):
        return _not_seen(adjustment, math.hypot(value, nearness.total_sd(sd)), of_radius)
    if not near.settled or value >= MAX_NEARNESS or not tells_nearness(_widening(near.state)):
        # What was seen and could not be settled is not known to less than what the search had found.
        unseen = _not_seen(adjustment, nearness.UNKNOWN_SD, found.of_radius)
        return replace(unseen, sd_nearness=max(nearness.UNKNOWN_SD, abs(value)))
    sd = nearness.total_sd(sd)
    return replace(with_error_of_model(near).with_radius_error(of_radius * sd), sd_nearness=sd)


def _has_lens(state: State) -> bool:
    optics = state.windows.optics
    return optics is not None and bool(optics.distortion.any() or optics.stretch)


def tells_nearness(factor: float) -> bool:
    """Whether images whose steps err by that ``factor`` more than by the noise tell the camera's distance."""
    return factor <= MAX_FACTOR


def _widening(state: State) -> float:
    """Largest factor of `residual_scatter.widening` in the images of a ``state``."""
    some = state.take(torch.from_numpy(residual_scatter.spread_out(len(state.poses))))
    return float(residual_scatter.widening(some.windows, some.poses, some.ball, some.profile).max())


def _not_seen(adjustment: Adjustment, sd: float, of_radius: float) -> Adjustment:
    """The ``adjustment`` of a camera infinitely far away, whose radius errs with a nearness of that ``sd``."""
    sd = min(sd, nearness.UNKNOWN_SD)
    return replace(adjustment.with_radius_error(of_radius * sd), sd_nearness=sd)


def _told(adjustment: Adjustment, shared: RowRunner) -> tuple[float, float]:
    """Standard deviation of the last unknown of the ``adjustment``, and change of the radius with it, px."""
    assert adjustment.last is not None
    state, model, joint = adjustment.last
    columns = model.jacobian.shape[-1] - 1
    without = Linearisation(model.levels, model.jacobian[..., :columns].contiguous())
    rest = joint_equations(state, without, joint.map, adjustment.unknowns[:-1])
    found = shared_unknown.measure(adjustment.unknowns[-1], state, without, rest, shared)
    return float(found.sd), found.of_radius
