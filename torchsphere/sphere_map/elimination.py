"""The map eliminated from the equations of map and poses: the covariance of poses whose map is not known.

The Schur complement is the poses' normal matrix less what the map can take up. The map's matrix is nearly diagonal for
the map's values at its nodes (`map_fit`), so that no equations have to be solved.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.kernels.layout import BY_GAIN, BY_OFFSET, BY_RADIUS, COLUMNS, WZ
from torchsphere.sphere_map import cube_map, map_fit
from torchsphere.sphere_map.ball import Poses
from torchsphere.sphere_map.forward_model import SHARED, Linearisation
from torchsphere.sphere_map.map_fit import MapEquations

#: Unknowns of each image: motion, added radius, gain, offset; how many of these are its place, and no brightness; and
#: unknowns of all images, at the end: radius and edge blur. Between them are those of `shared_unknown`, if there are
#: any.
PER_IMAGE, PLACE, GEOMETRY, COMMON = 8, 2, 6, 2

#: Columns of a jacobian for the unknowns of an image.
OWN = [*range(WZ + 1), BY_RADIUS, BY_GAIN, BY_OFFSET]

#: Standard deviations of the mean gain and of the mean offset, grey levels: the map scales as they do, and the
#: background, a mean of the images, holds them.
MEAN_GAIN_SD, MEAN_OFFSET_SD = 1e-6, 1e-4

#: Standard deviation of an added radius, px, that is held, and of the mean of those that are not: the ball's own radius
#: is an unknown.
HELD_RADIUS_SD_PX = 1e-6

#: Standard deviation of a centre, px, from the mean of all of a ball that turns in its place.
HELD_PLACE_SD_PX = 1e-6

#: Standard deviation of a change of the edge's blur, px: where the outline has no contrast, nothing else holds it
#: (docs/constants.toml).
BLUR_SD_PX = 0.1

#: Least share of the normal matrix that the map leaves, where it would leave less than nothing (docs/constants.toml).
LEAST_LEFT = 1e-4


#: Factor in the stiffness of an unknown that is held (docs/constants.toml).
HELD = 1e6

#: Conjugate gradients that tell whether a step has settled, and the share of the step by which they may still move it
#: (docs/constants.toml).
CALM_STEPS, CALM_SHARE = 5, 0.1


@dataclass(frozen=True)
class JointEquations:
    """Gauss-Newton equations of map (m,) and u = 8 n + k + 2 other unknowns, and their approximate solution."""

    map: MapEquations
    normal: Tensor  # (u, u), float64, of the other unknowns, with constraints on what the images leave open
    seen: Tensor  # numbers (r,) of the coefficients that an image shows
    coupling: Tensor  # (r, u): normal matrix between these coefficients and the unknowns
    taken_up: Tensor  # (u, u): what the map takes up of the normal matrix, were its own matrix diagonal at its nodes
    covariance: Tensor  # (u, u), float64: inverse of the Schur complement

    def times(self, of_map: Tensor, step: Tensor) -> tuple[Tensor, Tensor]:
        """Product (m,) and (u,) of the matrix with changes of the map (m,) and of the other unknowns (u,)."""
        by_map = self.map.times(of_map) + self._by_map(step.to(self.coupling))
        return by_map, self._by_unknowns(of_map).double() + self.normal @ step

    def solve(
        self, by_map: Tensor, by_unknowns: Tensor, steps: int, settled: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Solution (m,) and (u,) after ``steps`` of conjugate gradients from the approximate one.

        It ends before, where `CALM_STEPS` have moved no unknown by more than its ``settled`` (u,), or by `CALM_SHARE`
        of the longest move so far, measured by these.
        """
        scale = torch.zeros_like(by_unknowns) if settled is None else 1 / settled
        rest, wanted = by_map, by_unknowns
        of_map, step = torch.zeros_like(by_map), torch.zeros_like(by_unknowns)
        at = self.approximate(rest, wanted)
        square = (rest @ at.of_map).double() + wanted @ at.step
        moves = [step]
        for _ in range(steps):
            mp = self.map.times(at.of_map) + at.coupled
            mq = at.coupled_back.double() + self.normal @ at.step
            length = square / ((at.of_map @ mp).double() + at.step @ mq).clamp_min(1e-30)
            of_map, step = of_map + length.to(mp) * at.of_map, step + length * at.step
            moves.append(scale * step)
            if settled is not None and _is_calm(moves):
                break
            rest, wanted = rest - length.to(mp) * mp, wanted - length * mq
            new = self.approximate(rest, wanted)
            before, square = square, (rest @ new.of_map).double() + wanted @ new.step
            at = new.plus(square / before.clamp_min(1e-30), at)
        return of_map, step

    def approximate(self, by_map: Tensor, by_unknowns: Tensor) -> Direction:
        """Solution as if the map's matrix were diagonal at its nodes."""
        alone = self.map.approximate_inverse(by_map)
        back = self._by_unknowns(alone)
        step = self.covariance @ (by_unknowns - back.double())
        single = step.to(back)
        coupled = self._by_map(single)
        of_map = alone - self.map.approximate_inverse(coupled)
        return Direction(of_map, step, coupled, back - self.taken_up @ single)

    def with_map(self, of_map: Tensor, change: Tensor) -> Tensor:
        """The change ``of_map`` (m,) as the map follows a further ``change`` (u,) of the other unknowns."""
        return of_map - self.map.approximate_inverse(self._by_map(change.to(self.coupling)))

    def with_blur_held(self) -> JointEquations:
        """The equations of a blur that stays as it is."""
        normal = self.normal.clone()
        normal[-1, -1] *= HELD
        return replace(self, normal=normal, covariance=_inverse_of_rest(normal, self.taken_up.double()))

    def _by_map(self, step: Tensor) -> Tensor:
        """Product (m,) of the coupling with a ``step`` (u,)."""
        parts = self.map.shared(lambda a, b: self.coupling[a:b] @ step, len(self.seen))
        return step.new_zeros(len(self.map.density)).index_copy_(0, self.seen, torch.cat(parts))

    def _by_unknowns(self, of_map: Tensor) -> Tensor:
        """Product (u,) of the transposed coupling with a change of the map (m,)."""
        shown = of_map[self.seen]
        parts = self.map.shared(lambda a, b: self.coupling[a:b].T @ shown[a:b], len(shown))
        return torch.stack(parts).sum(0)


def _is_calm(moves: list[Tensor]) -> bool:
    """Whether the last of the ``moves`` (u,) hardly differ; a move of 1 is one that counts as settled."""
    if len(moves) <= CALM_STEPS:
        return False
    rest = float((moves[-1] - moves[-1 - CALM_STEPS]).abs().max())
    return rest < max(1.0, CALM_SHARE * float(moves[-1].abs().max()))


class Direction(NamedTuple):
    """A direction of the conjugate gradients, with its products with the coupling, which is the largest array.

    The products of a sum are the sums of the products, so that each step reads the coupling twice instead of four
    times.
    """

    of_map: Tensor  # (m,)
    step: Tensor  # (u,), float64
    coupled: Tensor  # (m,): coupling with ``step``
    coupled_back: Tensor  # (u,): transposed coupling with ``of_map``

    def plus(self, share: Tensor, other: Direction) -> Direction:
        """The direction plus a ``share`` () of the ``other``."""
        return Direction(*(a + share.to(a) * b for a, b in zip(self, other, strict=True)))


def joint_equations(
    model: Linearisation,
    equations: MapEquations,
    poses: Poses,
    precisions: tuple[float, ...] = (),
    *,
    grows: bool = False,
    stays: bool = False,
) -> JointEquations:
    """Set up the equations and eliminate the map; the outlines' radii are unknowns of the images if the ball ``grows``.

    Their centres move together if it ``stays``. Columns of the ``model`` beyond those of poses and outline are unknowns
    that all images share, with these ``precisions`` of their priors.
    """
    design, n = equations.design, len(poses)
    shared = _shared_columns(model.jacobian.shape[-1])
    order = torch.tensor([*OWN, *shared], device=model.jacobian.device)

    def part(a: int, b: int) -> tuple[Tensor, Tensor]:
        weights = equations.weights[a:b]
        weighted = model.jacobian[a:b].index_select(-1, order).mul_(weights.flatten(1).unsqueeze(-1))
        return model.rows(a, b).normal(weights, weights)[0], design.rows(a, b).coupling(weighted, PER_IMAGE)

    blocks, columns = zip(*equations.shared(part, n), strict=True)
    coupling = _joined(columns, len(shared))
    normal = spread_normal(torch.cat(blocks))
    # Multiplied in place: these are the largest arrays of an adjustment.
    faces = cube_map.faces_of_nodes(equations.density, design.cells)
    at_nodes = cube_map.joined_at_seams(map_fit.to_nodes(coupling, design.cells), design.cells)
    at_nodes.mul_((faces * equations.density).rsqrt().unsqueeze(1))
    products = equations.shared(lambda a, b: at_nodes[a:b].T @ at_nodes[a:b], len(at_nodes))
    taken_up = torch.stack(products).sum(0)
    seen = _seen(equations)
    normal = normal + _gauge(poses, normal, grows=grows, stays=stays)
    normal[-1, -1] += 1 / BLUR_SD_PX**2
    first = PER_IMAGE * n
    for number, precision in enumerate(precisions):
        normal[first + number, first + number] += precision
    covariance = _inverse_of_rest(normal, taken_up.double())
    return JointEquations(equations, normal, seen, coupling[seen], taken_up, covariance)


def _joined(columns: tuple[Tensor, ...], common: int) -> Tensor:
    """Columns (m, u) of all images from those of shares of the images, whose last ``common`` ones are summed."""
    if len(columns) == 1:
        return columns[0]
    of_all = torch.stack([part[:, -common:] for part in columns]).sum(0)
    return torch.cat((*(part[:, :-common] for part in columns), of_all), 1)


def _seen(equations: MapEquations) -> Tensor:
    """Numbers (r,) of the coefficients that an image shows; all on a GPU, which would have to wait."""
    if equations.density.is_cpu:
        faces = cube_map.faces_of_nodes(equations.density, equations.design.cells)
        return torch.nonzero(equations.density > faces * equations.prior_density)[:, 0]
    return torch.arange(len(equations.density), device=equations.density.device)


def _inverse_of_rest(normal: Tensor, taken_up: Tensor) -> Tensor:
    """Inverse of what the map leaves of the ``normal`` matrix (u, u), positive definite.

    Where images tell little, the map takes up nearly all, and with its diagonal matrix even more than there is.
    """
    rest, root = normal - taken_up, torch.linalg.cholesky(normal)
    share = torch.linalg.solve_triangular(root, (rest + rest.T) / 2, upper=False)
    left, along = torch.linalg.eigh(torch.linalg.solve_triangular(root, share.T, upper=False))
    back = torch.linalg.solve_triangular(root.T, along, upper=True)
    return back / left.clamp_min(LEAST_LEFT) @ back.T


def _shared_columns(count: int) -> list[int]:
    """Those of ``count`` columns of a jacobian that all images share, in the order of the unknowns."""
    outline = list(range(count))[SHARED]
    return [*range(COLUMNS, count), *outline]


def spread_normal(blocks: Tensor) -> Tensor:
    """Normal matrix (8 n + k + 2, 8 n + k + 2) from the ``blocks`` (n, 9 + k, 9 + k) of the images."""
    shared = _shared_columns(blocks.shape[-1])
    own = torch.block_diag(*blocks[:, OWN][:, :, OWN])
    across = blocks[:, OWN][:, :, shared].reshape(-1, len(shared))
    common = blocks[:, shared][:, :, shared].sum(0)
    return torch.cat((torch.cat((own, across), 1), torch.cat((across.T, common), 1)))


def spread_gradient(parts: Tensor) -> Tensor:
    """Gradient (8 n + k + 2,) from that of the images (n, 9 + k)."""
    return torch.cat((parts[:, OWN].flatten(), parts[:, _shared_columns(parts.shape[-1])].sum(0)))


def _gauge(poses: Poses, normal: Tensor, *, grows: bool, stays: bool) -> Tensor:
    """Constraints on what the images leave open: a common rotation of poses and map, and mean gain, offset and radius.

    The radius added in each image is held unless the ball ``grows``, and its centre at that of all if the ball
    ``stays``.
    """
    n, device = len(poses), normal.device
    open_ = torch.zeros(6, len(normal), dtype=torch.float64, device=device)
    own = open_[:, : PER_IMAGE * n].view(6, n, PER_IMAGE)
    stiffness = normal.diagonal()[:5].max()
    own[:3, :, 2:5] = poses.orientation.permute(2, 0, 1) * (stiffness / n).sqrt()
    own[3, :, GEOMETRY] = 1 / (MEAN_GAIN_SD * n)
    own[4, :, GEOMETRY + 1] = 1 / (MEAN_OFFSET_SD * n)
    own[5, :, GEOMETRY - 1] = 1 / (HELD_RADIUS_SD_PX * n)
    gauge = open_.T @ open_
    if not grows:
        gauge.diagonal()[: PER_IMAGE * n].view(n, PER_IMAGE)[:, GEOMETRY - 1] += HELD_RADIUS_SD_PX**-2
    if stays:
        off_mean = torch.eye(n, dtype=gauge.dtype, device=device) - 1 / n
        for axis in range(PLACE):
            gauge[axis : PER_IMAGE * n : PER_IMAGE, axis : PER_IMAGE * n : PER_IMAGE] += HELD_PLACE_SD_PX**-2 * off_mean
    return gauge
