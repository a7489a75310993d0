"""Whether the images show a lens that nobody stated, and which of its unknowns: decided on coarse cells."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import nearness, radius_error, shared_unknown
from torchsphere.sphere_map.elimination import COMMON, PER_IMAGE
from torchsphere.sphere_map.lens import View, is_seen
from torchsphere.sphere_map.level import MAX_STEPS, Adjustment, Level, adjust_level, equations_of, gradients
from torchsphere.sphere_map.shared_unknown import SharedUnknowns
from torchsphere.sphere_map.state import State

#: Most images in which a lens is looked for (docs/constants.toml).
LENS_IMAGES = 6

#: Residual that a lens leaves, over that without one, both as variances, below which it is a lens though the poses have
#: not settled (docs/constants.toml).
EXPLAINED = 0.5


def found_in(view: View, start: State, adjustment: Adjustment, level: Level, shared: RowRunner) -> Adjustment | None:
    """The adjustment on coarse cells with what its images show of the ``view``; None if they show nothing.

    ``adjustment`` is that of a camera infinitely far away, without a lens, from the ``start`` on. Where no lens
    settles, a near camera may.
    """
    if not shows_lens(adjustment, view, level, shared):
        return None
    if view.unknowns != (nearness.UNKNOWN,):
        watched = adjust_level(view.of(start), level._replace(unknowns=view.all), shared)
        if _is_found(watched, adjustment) and lens_of(watched, view.unknowns):
            return with_lens_alone(watched, view.unknowns)
    if nearness.UNKNOWN not in view.unknowns:
        return None
    near = _near_camera(view.of(adjustment.state), level, shared)
    is_near = _is_found(near, adjustment) and is_seen(*_last_unknown(near))
    return with_lens_alone(near, near.unknowns) if is_near else None


def _is_found(seen: Adjustment, adjustment: Adjustment) -> bool:
    """Whether an adjustment with a lens has settled, or explains so much more than the one without that it goes on.

    In windows that are cut for a camera far away, poses before a near one may not settle.
    """
    return seen.settled or seen.residual_variance < EXPLAINED * adjustment.residual_variance


def _near_camera(state: State, level: Level, shared: RowRunner) -> Adjustment:
    """The adjustment from a ``state`` on with the camera's nearness alone, from its first step on."""
    _, model, joint = equations_of(state, (), shared)
    first = shared_unknown.measure(nearness.UNKNOWN, state, model, joint, shared)
    return adjust_level(first.applied(state), level._replace(unknowns=(nearness.UNKNOWN,), max_steps=MAX_STEPS), shared)


def _last_unknown(adjustment: Adjustment) -> tuple[float, float]:
    """Value and standard deviation of the last unknown of the ``adjustment``."""
    sd = adjustment.covariance.diagonal()[-COMMON - 1].sqrt()
    return float(adjustment.unknowns[-1].value(adjustment.state)), float(sd)


def shows_lens(adjustment: Adjustment, view: View, level: Level, shared: RowRunner) -> bool:
    """Whether the images of an ``adjustment`` show a lens, by one step of all unknowns on its ``level``.

    Poses that have not settled may lack one.
    """
    if not adjustment.settled:
        return True
    if not _may_show_lens(adjustment, view, shared):
        return False
    once = level._replace(unknowns=view.all, max_steps=1)
    return bool(lens_of(adjust_level(view.of(adjustment.state), once, shared), view.unknowns))


def _may_show_lens(adjustment: Adjustment, view: View, shared: RowRunner) -> bool:
    """Whether some images of an ``adjustment`` may show a lens, by an approximate step, which hardly costs anything.

    What may explain it otherwise is left out: where the map takes no part, a light from a side explains too much.
    """
    count = len(adjustment.state.poses)
    rows = torch.linspace(0, count - 1, min(count, LENS_IMAGES)).round().long().unique()
    state = view.of(adjustment.state.take(rows))
    at = equations_of(state, view.unknowns, shared)
    step = at.joint.approximate(*gradients(at, view.unknowns)).step
    return bool(_seen(view.unknowns, step[PER_IMAGE * len(rows) :], at.joint.covariance, state))


def _seen(unknowns: SharedUnknowns, values: Tensor, covariance: Tensor, state: State) -> SharedUnknowns:
    """Those of the ``unknowns`` that the images of a ``state`` show, if a lens is among them.

    The camera's nearness alone is told on fine cells. The ``values`` (k,) have their variances in the ``covariance``
    after those of the poses.
    """
    first = PER_IMAGE * len(state.poses)
    # A texture that passes for outline changes the ball's shape as a lens does.
    radius = float(state.ball.radius)
    of_shape = radius_error.of_model(state.poses.orientation, radius) / radius
    sds = [math.hypot(of_shape, sd) for sd in covariance.diagonal()[first:].sqrt().tolist()]
    seen = tuple(one for one, value, sd in zip(unknowns, values, sds, strict=False) if is_seen(float(value), sd))
    return () if seen == (nearness.UNKNOWN,) else seen


def lens_of(adjustment: Adjustment, unknowns: SharedUnknowns) -> SharedUnknowns:
    """Those of its first ``unknowns`` that the images show, if a lens is among them."""
    values = torch.stack([unknown.value(adjustment.state) for unknown in unknowns])
    return _seen(unknowns, values, adjustment.covariance, adjustment.state)


def with_lens_alone(adjustment: Adjustment, unknowns: SharedUnknowns) -> Adjustment:
    """The ``adjustment`` on coarse cells with those ``unknowns`` of a lens that the images show, or all of them."""
    state, seen = adjustment.state, lens_of(adjustment, unknowns) or unknowns
    for unknown in adjustment.unknowns:
        if unknown not in seen:
            state = unknown.changed(state, -unknown.value(state))
    return replace(adjustment, state=state, unknowns=(), lens=seen)
