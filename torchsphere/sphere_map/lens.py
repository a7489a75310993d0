"""What the images tell of the lens: its first radial distortion, and the sides of the pixels, as unknowns of the step.

A ball that crosses the image shows both by its outline and by its texture: distorted, it is larger and wider along the
radius of the image, or smaller; on pixels that are not square it is wider than high everywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchsphere.sphere_map.elimination import PER_IMAGE
from torchsphere.sphere_map.perspective import Optics
from torchsphere.sphere_map.shared_unknown import SharedUnknown, SharedUnknowns
from torchsphere.sphere_map.state import State

#: Prior standard deviations of the distortion in the image's corner, a share of the distance from its middle, and of
#: the logarithm of the ratio of the pixels' sides (docs/constants.toml).
DISTORTION_SD, STRETCH_SD = 0.03, 0.03

#: Largest change of both at once, and change below which they have settled (docs/constants.toml).
MAX_CHANGE, LAST_CHANGE = 0.05, 2e-5

#: Value of an unknown from which the images show it: in its standard deviations, and at least (docs/constants.toml).
SEEN_SD, LEAST_SEEN = 5.0, 5e-4

#: Change over which the model's derivative is taken.
STEP = 0.002


@dataclass(frozen=True)
class Lens:
    """The lens as the images show it."""

    distortion: float = 0.0  # in the image's corner, a share of the distance from its middle
    stretch: float = 0.0  # logarithm of the pixels' width over their height
    sd_distortion: float = 0.0
    sd_stretch: float = 0.0
    middle: tuple[float, float] = (0.0, 0.0)  # of the image (x, y), px


@dataclass(frozen=True)
class View:
    """A camera infinitely far away, and what the images may tell of the one that it stands for."""

    far: Optics
    unknowns: SharedUnknowns
    beside: SharedUnknowns = ()  # that change the ball's shape, too, and may explain what looks like a lens

    @property
    def all(self) -> SharedUnknowns:
        """The unknowns in the order of their columns."""
        return (*self.unknowns, *self.beside)

    def of(self, state: State) -> State:
        """The ``state`` as this camera sees it."""
        return replace(state, windows=state.windows.seen_by(self.far))


def is_seen(value: float, sd: float) -> bool:
    """Whether an unknown with that ``value`` and standard deviation is no chance."""
    return abs(value) > max(SEEN_SD * sd, LEAST_SEEN)


def unknowns(far: Optics) -> SharedUnknowns:
    """Distortion and stretch of images whose camera, infinitely far away and without both, is ``far``."""
    corner = float(far.principal.square().sum())

    def bent(optics: Optics, change: Tensor) -> Optics:
        first = torch.zeros_like(optics.distortion).index_fill(0, torch.tensor(0, device=change.device), 1.0)
        return replace(optics, distortion=optics.distortion + change / corner * first)

    def stretched(optics: Optics, change: Tensor) -> Optics:
        return replace(optics, stretch=optics.stretch + change)

    return (
        _unknown(far, lambda optics: corner * optics.distortion[0], bent, DISTORTION_SD),
        _unknown(far, lambda optics: optics.stretch, stretched, STRETCH_SD),
    )


def found(of_lens: SharedUnknowns, state: State, unknowns: SharedUnknowns, covariance: Tensor) -> Lens:
    """The lens of a ``state`` whose ``unknowns``, and the ``covariance`` (u, u) of all, may hold those ``of_lens``."""
    if state.windows.optics is None or not of_lens:
        return Lens()
    sd, first = covariance.diagonal().sqrt(), PER_IMAGE * len(state.poses)
    sds = [float(sd[first + unknowns.index(one)]) if one in unknowns else 0.0 for one in of_lens]
    distortion, stretch = (float(one.value(state)) for one in of_lens)
    if not (distortion or stretch):
        return Lens()
    x, y = state.windows.optics.principal.tolist()
    return Lens(distortion, stretch, sds[0], sds[1], (x, y))


def _unknown(
    far: Optics, value: Callable[[Optics], Tensor], changed: Callable[[Optics, Tensor], Optics], prior_sd: float
) -> SharedUnknown:
    def of_state(state: State) -> Tensor:
        return value(state.windows.optics or far)

    def of_change(state: State, change: Tensor) -> State:
        before = state.windows.optics or far
        return seen_through(state, before, changed(before, change))

    return SharedUnknown(of_state, of_change, STEP, prior_sd, MAX_CHANGE, LAST_CHANGE)


def seen_through(state: State, before: Optics, after: Optics) -> State:
    """The state with the lens ``after``: the ball stays where it is seen, and about as large."""
    seen = before.bent(state.poses.centre)
    scale = _local_scale(after, seen) / _local_scale(before, seen)
    ball = replace(state.ball, radius=state.ball.radius * scale.mean())
    poses = replace(state.poses, centre=after.straightened(seen))
    return replace(state, windows=state.windows.seen_by(after), poses=poses, ball=ball)


def _local_scale(optics: Optics, seen: Tensor) -> Tensor:
    """Root (n,) of the area that a px of the image at ``seen`` (n, 2) has without the lens."""
    unit = torch.eye(2, dtype=seen.dtype, device=seen.device)
    columns = [(optics.straightened(seen + step) - optics.straightened(seen - step)) / 2 for step in unit]
    return torch.linalg.det(torch.stack(columns, -1)).abs().sqrt()
