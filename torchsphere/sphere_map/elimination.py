"""The map eliminated from the equations of map and poses: the covariance of poses whose map is not known.

The Schur complement is the poses' normal matrix less what the map can take up. The map's matrix is nearly diagonal for
the map's values at its nodes (`map_fit`), so that no equations have to be solved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from torchsphere.sphere_map import map_fit
from torchsphere.sphere_map.ball import Poses
from torchsphere.sphere_map.forward_model import BRIGHTNESS, MOTION, SHARED, Linearisation
from torchsphere.sphere_map.map_fit import MapEquations

#: Unknowns of each image: motion, gain, offset; and of all images: radius and edge blur.
PER_IMAGE, COMMON = 7, 2

#: Standard deviations of the mean gain and of the mean offset, grey levels: the map scales as they do, and the
#: background, a mean of the images, holds them.
MEAN_GAIN_SD, MEAN_OFFSET_SD = 1e-6, 1e-4

#: Standard deviation of a change of the edge's blur, px: where the outline has no contrast, nothing else holds it
#: (docs/constants.toml).
BLUR_SD_PX = 0.1

#: Least share of the normal matrix that the map leaves, where it would leave less than nothing (docs/constants.toml).
LEAST_LEFT = 1e-4


#: Conjugate gradients that tell whether a step has settled, and the share of the step by which they may still move it
#: (docs/constants.toml).
CALM_STEPS, CALM_SHARE = 4, 0.1


@dataclass(frozen=True)
class JointEquations:
    """Gauss-Newton equations of map (m,) and u = 7 n + 2 other unknowns, and their approximate solution."""

    map: MapEquations
    normal: Tensor  # (u, u), float64, of the other unknowns, with constraints on what the images leave open
    coupling: Tensor  # (m, u): normal matrix between the map's nodes and the unknowns
    taken_up: Tensor  # (u, u): what the map takes up of the normal matrix, were its own matrix diagonal at its nodes
    covariance: Tensor  # (u, u), float64: inverse of the Schur complement

    def times(self, of_map: Tensor, step: Tensor) -> tuple[Tensor, Tensor]:
        """Product (m,) and (u,) of the matrix with changes of the map (m,) and of the other unknowns (u,)."""
        cells = self.map.design.cells
        by_map = self.map.times(of_map) + map_fit.from_nodes(self.coupling @ step.to(self.coupling), cells)
        return by_map, self._by_unknowns(map_fit.from_nodes(of_map, cells)).double() + self.normal @ step

    def solve(
        self, by_map: Tensor, by_unknowns: Tensor, steps: int, settled_px: float = 0.0
    ) -> tuple[Tensor, Tensor]:
        """Solution (m,) and (u,) after ``steps`` of conjugate gradients from the approximate one.

        It ends before, where `CALM_STEPS` have moved no pose, nor the radius, by more than ``settled_px`` or by
        `CALM_SHARE` of the move so far.
        """
        cells = self.map.design.cells
        rest, wanted = by_map, by_unknowns
        of_map, step = torch.zeros_like(by_map), torch.zeros_like(by_unknowns)
        at = self.approximate(rest, wanted)
        square = (rest @ at.of_map).double() + wanted @ at.step
        moves = [_in_px(step)]
        for _ in range(steps):
            mp = self.map.times(at.of_map) + map_fit.from_nodes(at.coupled, cells)
            mq = at.coupled_back.double() + self.normal @ at.step
            length = square / ((at.of_map @ mp).double() + at.step @ mq).clamp_min(1e-30)
            of_map, step = of_map + length.to(mp) * at.of_map, step + length * at.step
            moves.append(_in_px(step))
            if len(moves) > CALM_STEPS:
                rest_px = float((moves[-1] - moves[-1 - CALM_STEPS]).abs().max())
                if rest_px < max(settled_px, CALM_SHARE * float(moves[-1].abs().max())):
                    break
            rest, wanted = rest - length.to(mp) * mp, wanted - length * mq
            new = self.approximate(rest, wanted)
            before, square = square, (rest @ new.of_map).double() + wanted @ new.step
            at = new.plus(square / before.clamp_min(1e-30), at)
        return of_map, step

    def approximate(self, by_map: Tensor, by_unknowns: Tensor) -> Direction:
        """Solution as if the map's matrix were diagonal at its nodes."""
        cells = self.map.design.cells
        at_nodes = map_fit.to_nodes(by_map, cells) / self.map.density
        back = self._by_unknowns(at_nodes)
        step = self.covariance @ (by_unknowns - back.double())
        single = step.to(back)
        coupled = torch.cat(self.map.shared(lambda a, b: self.coupling[a:b] @ single, len(at_nodes)))
        of_map = map_fit.to_nodes(at_nodes - coupled / self.map.density, cells)
        return Direction(of_map, step, coupled, back - self.taken_up @ single)

    def _by_unknowns(self, at_nodes: Tensor) -> Tensor:
        """Product (u,) of the transposed coupling with values at the map's nodes (m,)."""
        parts = self.map.shared(lambda a, b: self.coupling[a:b].T @ at_nodes[a:b], len(at_nodes))
        return torch.stack(parts).sum(0)


def _in_px(step: Tensor) -> Tensor:
    """The part (6 n,) of a step (7 n + 2,) that moves poses or the outline, px."""
    own = step[:-COMMON].unflatten(0, (-1, PER_IMAGE))[:, :5]
    return torch.cat((own.flatten(), step[-COMMON:-1]))


class Direction(NamedTuple):
    """A direction of the conjugate gradients, with its products with the coupling, which is the largest array.

    The products of a sum are the sums of the products, so that each step reads the coupling twice instead of four
    times.
    """

    of_map: Tensor  # (m,)
    step: Tensor  # (u,), float64
    coupled: Tensor  # (m,): coupling with ``step``, at the nodes
    coupled_back: Tensor  # (u,): transposed coupling with ``of_map``

    def plus(self, share: Tensor, other: Direction) -> Direction:
        """The direction plus a ``share`` () of the ``other``."""
        return Direction(*(a + share.to(a) * b for a, b in zip(self, other, strict=True)))


def joint_equations(model: Linearisation, equations: MapEquations, poses: Poses) -> JointEquations:
    """Set up the equations and eliminate the map."""
    design, n = equations.design, len(poses)
    coupling = model.jacobian.new_empty(len(equations.density), PER_IMAGE * n + COMMON)
    own = coupling[:, :-COMMON].unflatten(1, (n, PER_IMAGE))

    def part(a: int, b: int) -> tuple[Tensor, Tensor]:
        jacobian, weights = model.jacobian[a:b], equations.weights[a:b]
        weighted = weights.flatten(1).unsqueeze(-1) * jacobian
        columns = design.rows(a, b).adjoint_columns(weighted).movedim(0, 1)
        # Straight to their places: these are the largest arrays of an adjustment.
        own[:, a:b, :5], own[:, a:b, 5:] = columns[..., MOTION], columns[..., BRIGHTNESS]
        return model.rows(a, b).normal(weights, weights)[0], columns[..., SHARED].sum(1)

    blocks, common = zip(*equations.shared(part, n), strict=True)
    coupling[:, -COMMON:] = torch.stack(common).sum(0)
    normal = spread_normal(torch.cat(blocks))
    coupling = map_fit.to_nodes(coupling, design.cells)
    density = equations.density.unsqueeze(1)
    products = equations.shared(lambda a, b: coupling[a:b].T @ (coupling[a:b] / density[a:b]), len(density))
    taken_up = torch.stack(products).sum(0)
    normal = normal + _gauge(poses, normal)
    normal[-1, -1] += 1 / BLUR_SD_PX**2
    return JointEquations(equations, normal, coupling, taken_up, _inverse_of_rest(normal, taken_up.double()))


def _inverse_of_rest(normal: Tensor, taken_up: Tensor) -> Tensor:
    """Inverse of what the map leaves of the ``normal`` matrix (u, u), positive definite.

    Where images tell little, the map takes up nearly all, and with its diagonal matrix even more than there is.
    """
    rest, root = normal - taken_up, torch.linalg.cholesky(normal)
    share = torch.linalg.solve_triangular(root, (rest + rest.T) / 2, upper=False)
    left, along = torch.linalg.eigh(torch.linalg.solve_triangular(root, share.T, upper=False))
    back = torch.linalg.solve_triangular(root.T, along, upper=True)
    return back / left.clamp_min(LEAST_LEFT) @ back.T


def spread_normal(blocks: Tensor) -> Tensor:
    """Normal matrix (7 n + 2, 7 n + 2) from the ``blocks`` (n, 9, 9) of the images."""
    order = [*range(5), 7, 8]
    own = torch.block_diag(*blocks[:, order][:, :, order])
    across = blocks[:, order, SHARED].reshape(-1, COMMON)
    common = blocks[:, SHARED, SHARED].sum(0)
    return torch.cat((torch.cat((own, across), 1), torch.cat((across.T, common), 1)))


def spread_gradient(parts: Tensor) -> Tensor:
    """Gradient (7 n + 2,) from that of the images (n, 9)."""
    own = torch.cat((parts[:, MOTION], parts[:, BRIGHTNESS]), 1)
    return torch.cat((own.flatten(), parts[:, SHARED].sum(0)))


def _gauge(poses: Poses, normal: Tensor) -> Tensor:
    """Constraints on what the images leave open: a common rotation of poses and map, mean gain and mean offset."""
    n, device = len(poses), normal.device
    open_ = torch.zeros(5, 7 * n + COMMON, dtype=torch.float64, device=device)
    own = open_[:, :-COMMON].view(5, n, PER_IMAGE)
    stiffness = normal.diagonal()[:5].max()
    own[:3, :, 2:5] = poses.orientation.permute(2, 0, 1) * (stiffness / n).sqrt()
    own[3, :, 5] = 1 / (MEAN_GAIN_SD * n)
    own[4, :, 6] = 1 / (MEAN_OFFSET_SD * n)
    return open_.T @ open_
