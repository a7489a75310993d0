"""Registration of images on a known texture map: Gauss-Newton on the forward model, all images of a batch at once."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchsphere.kernels import layout
from torchsphere.kernels import registration as loops
from torchsphere.kernels.forward_model import Model
from torchsphere.kernels.jit import suits
from torchsphere.sphere_map import exposure, forward_model, pixel_weights, rays
from torchsphere.sphere_map.ball import Poses, TexturedBall
from torchsphere.sphere_map.forward_model import BRIGHTNESS, MOTION, Linearisation
from torchsphere.sphere_map.pixel_weights import ResidualProfile
from torchsphere.sphere_map.window import Windows

#: Largest number of steps, and length of a step, px, after which no further one is needed: a step leaves about the
#: square of the error (docs/constants.toml).
MAX_STEPS, LAST_STEP_PX = 8, 0.03

#: Ridge of the normal equations, as a share of their trace.
RIDGE = 1e-12

#: Columns of the jacobian that a registration solves for, of a ball that grows and of any other.
GROWING = [*range(layout.COLUMNS)[MOTION], layout.BY_RADIUS, *range(layout.COLUMNS)[BRIGHTNESS]]
COLUMNS = [column for column in GROWING if column != layout.BY_RADIUS]


@dataclass(frozen=True)
class Registration:
    """Poses of n images on the map."""

    poses: Poses
    # (n, 6, 6) of (dx, dy, wx, wy, wz) and the outline's radius, px, rotations times that radius, by the images' own
    # noise alone
    covariance: Tensor
    converged: Tensor  # (n,), bool
    misfit: Tensor  # (n,): mean square of the weighted residual; 1 if an image fits as well as those that made the map

    @classmethod
    def joined(cls, parts: list[Registration]) -> Registration:
        """The images of all parts, one after the other."""
        covariance, converged, misfit = (
            torch.cat(column) for column in zip(*((p.covariance, p.converged, p.misfit) for p in parts), strict=True)
        )
        return cls(Poses.joined([part.poses for part in parts]), covariance, converged, misfit)

    def take(self, rows: Tensor) -> Registration:
        """The images of the given rows."""
        return Registration(self.poses.take(rows), self.covariance[rows], self.converged[rows], self.misfit[rows])


def register(windows: Windows, poses: Poses, ball: TexturedBall, profile: ResidualProfile) -> Registration:
    """Fit pose, gain and offset of each image, from poses with an error of up to half a speckle.

    Gain and offset are unknowns beside the pose, so that they do not take up a part of its motion, and the outline's
    radius is one if the ball grows. An image is done after its first short step.
    """
    found = _step(windows, poses, ball, profile)
    for _ in range(MAX_STEPS - 1):
        moving = torch.nonzero(found.length > LAST_STEP_PX)[:, 0]
        if len(moving) == 0:
            break
        again = _step(windows.take(moving), found.poses.take(moving), ball, profile)
        found = found.replaced(moving, again)
    return Registration(found.poses, found.covariance, found.length <= LAST_STEP_PX, found.misfit)


@dataclass(frozen=True)
class _Step:
    """One step of n images."""

    poses: Poses  # after the step
    covariance: Tensor
    length: Tensor  # (n,), px; infinite where the equations have no solution
    misfit: Tensor

    def replaced(self, rows: Tensor, other: _Step) -> _Step:
        """With the ``other`` images in the given ``rows`` (k,)."""

        def put(old: Tensor, new: Tensor) -> Tensor:
            return old.index_copy(0, rows, new)

        pairs = zip(vars(self.poses).values(), vars(other.poses).values(), strict=True)
        poses = Poses(*(put(old, new) for old, new in pairs))
        columns = ((self.covariance, other.covariance), (self.length, other.length), (self.misfit, other.misfit))
        return _Step(poses, *(put(old, new) for old, new in columns))


def _step(windows: Windows, poses: Poses, ball: TexturedBall, profile: ResidualProfile) -> _Step:
    """One Gauss-Newton step, with the visibility that the residuals suggest."""
    normal, gradient, squares, seen = _equations(windows, poses, ball, profile)
    inverse, gradient = _with_radius(torch.linalg.inv_ex(normal)[0]), _with_radius(gradient)
    step = (inverse @ gradient.unsqueeze(2))[..., 0]
    length = step[:, :6].abs().amax(1).nan_to_num(torch.inf)
    usable = length < ball.radius
    step = torch.where(usable.unsqueeze(1), step, 0.0)
    misfit = (squares - (step * gradient).sum(1)) / seen.clamp_min(1)
    moved = poses.moved(step[:, :5], ball.radius).enlarged(step[:, 5]).brightened(step[:, 6:])
    return _Step(moved, inverse[:, :6, :6], torch.where(usable, length, torch.inf), misfit)


def _with_radius(values: Tensor) -> Tensor:
    """Covariances (n, 8, 8), or gradients (n, 8), with 0 for a radius that was no unknown beside the other seven."""
    if values.shape[1] == len(GROWING):
        return values
    spread = values.new_zeros(len(values), *([len(GROWING)] * (values.ndim - 1)))
    rows = torch.tensor([GROWING.index(column) for column in COLUMNS], device=values.device)
    if values.ndim == 2:
        return spread.index_copy(1, rows, values)
    return spread.index_copy(1, rows, spread[:, : len(rows)].index_copy(2, rows, values))


def _equations(
    windows: Windows, poses: Poses, ball: TexturedBall, profile: ResidualProfile
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """`normal_equations` of a step, the sum of squares (n,) over the visible pixels, and their number (n,)."""
    pixels = windows.levels, windows.background, windows.visibility
    if windows.moments is None and suits(*pixels, ball.coefficients):
        rings = loops.Rings(*profile.ramps(), profile.variance, profile.radius)
        hidden = loops.Hidden(pixel_weights.NEIGHBOURHOOD_PX, pixel_weights.HIDDEN_FROM)
        given = (
            Model(ball.coefficients, ball.cells, rays.rule(ball)),
            forward_model.inputs_of_loops(windows, poses, ball),
        )
        columns = columns_of(ball) if windows.optics is None else GROWING
        normal, gradient, squares, seen = loops.equations(*given, windows.levels, rings, hidden, columns)
        if windows.optics is not None:
            # In the view, with a change of the radius, by the motion in the image.
            view, radii = windows.optics.view(poses.centre), poses.radii(ball.radius)
            by_pose = torch.eye(len(GROWING), dtype=normal.dtype).repeat(len(poses), 1, 1)
            by_pose[:, :5, :5], by_pose[:, 5, :2] = view.motion(radii), view.shrinking(radii)
            by_pose = by_pose[:, :, [GROWING.index(column) for column in columns_of(ball)]]
            normal, gradient = by_pose.mT @ normal @ by_pose, (by_pose.mT @ gradient.unsqueeze(2))[..., 0]
        return _with_ridge(normal), gradient, squares, seen
    model = exposure.linearise(windows, poses, ball)
    variance = profile.at(windows, poses)
    residual = windows.levels - model.levels
    plain = _without_brightness(model.levels, windows.visibility / variance, residual)
    visibility = pixel_weights.estimate_visibility(windows, variance, plain).visibility
    weights, visible = visibility / variance, visibility > 0.5
    squares = (weights * visible * residual.square()).sum((1, 2))
    return *normal_equations(model, weights, residual, columns_of(ball)), squares, visible.sum((1, 2))


def columns_of(ball: TexturedBall) -> list[int]:
    """Columns (k,) of the jacobian that a registration of that ``ball`` solves for."""
    return GROWING if ball.grows else COLUMNS


def normal_equations(
    model: Linearisation, weights: Tensor, residual: Tensor, columns: list[int]
) -> tuple[Tensor, Tensor]:
    """Normal matrix (n, k, k) and gradient (n, k) of the unknowns with these ``columns`` (k,), float64."""
    normal, gradient = model.normal(weights, residual)
    return _with_ridge(normal[:, columns][:, :, columns]), gradient[:, columns]


def _with_ridge(normal: Tensor) -> Tensor:
    ridge = RIDGE * normal.diagonal(dim1=1, dim2=2).sum(1)
    identity = torch.eye(normal.shape[1], dtype=normal.dtype, device=normal.device)
    return normal + ridge.reshape(-1, 1, 1) * identity


def _without_brightness(levels: Tensor, weights: Tensor, residual: Tensor) -> Tensor:
    """The ``residual`` (n, s, s) less the change of gain and offset that fits it best, the pose held."""

    def mean(values: Tensor) -> Tensor:
        return (weights * values).sum((1, 2), keepdim=True) / total

    total = weights.sum((1, 2), keepdim=True).clamp_min(1e-12)
    centred = levels - mean(levels)
    rest = residual - mean(residual)
    return rest - centred * (mean(centred * rest) / mean(centred.square()).clamp_min(1e-12))
