"""Closed forms of the models `rigid` and `finite` and their modes for a whole batch.

Measured at 7000 points: 0.01 ms per pair instead of 0.5 for the displacement, 0.02 instead of 1.1 for the modes.
"""

from __future__ import annotations

import torch
from torch import Tensor

from torchsphere.kernels import jit, rotation


def surface(points: Tensor, radius: Tensor) -> Tensor:
    """Points (n, 3, p) of the ball's front at the pixels ``points`` (n, 2, p), px from its centre; ``radius`` (n,)."""
    squared = points.square().sum(1)
    depth = (radius.square()[:, None] - squared).clamp_min_(0.0).sqrt_()
    return torch.cat((points, -depth[:, None]), 1)


#: Matrices of the cross product with the three axes from the left, (3, 9).
_CROSS = torch.tensor(
    [[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]], dtype=torch.float64
)


def cross_matrices(vectors: Tensor) -> Tensor:
    """Matrices (n, 3, 3) of the cross product with ``vectors`` (n, 3) from the left."""
    return (vectors @ _CROSS.to(vectors)).unflatten(-1, (3, 3))


@jit.in_loops(rotation.matrices)
def rotations(vectors: Tensor) -> Tensor:
    """Rotation matrices (n, 3, 3) of rotation vectors (n, 3), rad: Rodrigues' formula, its quotients as sinc."""
    cross = cross_matrices(vectors)
    half_turns = vectors.norm(dim=-1)[:, None, None] / torch.pi
    sine, versine = torch.sinc(half_turns), 0.5 * torch.sinc(0.5 * half_turns).square()
    return torch.eye(3, dtype=vectors.dtype, device=vectors.device) + sine * cross + versine * (cross @ cross)


@jit.in_loops(rotation.tangents)
def tangents(vectors: Tensor) -> Tensor:
    """Left Jacobians (n, 3, 3) of SO(3): ``I + (1 - cos t) / t^2 [w]x + (t - sin t) / t^3 [w]x^2``.

    They map a change of the rotation vectors (n, 3) to the small rotation that follows the old one.
    """
    cross = cross_matrices(vectors)
    half_turns = vectors.norm(dim=-1)[:, None, None] / torch.pi
    versine = 0.5 * torch.sinc(0.5 * half_turns).square()
    squared = (torch.pi * half_turns).square()
    # Near 0 the quotient loses digits and its series does not: the next term is below 1e-8 up to 0.2 rad.
    quotient = (1 - torch.sinc(half_turns)) / squared.clamp_min(1e-12)
    rest = torch.where(squared < 0.04, 1 / 6 - squared / 120 + squared.square() / 5040, quotient)
    return torch.eye(3, dtype=vectors.dtype, device=vectors.device) + versine * cross + rest * (cross @ cross)


def moved(q: Tensor, places: Tensor, *, exact: bool) -> Tensor:
    """Points (n, 3, p) of the ball after the rotation in ``q`` (n, k), from `surface` (n, 3, p); no translation."""
    return matrices(q, exact=exact) @ places


def matrices(q: Tensor, *, exact: bool) -> Tensor:
    """Matrices (n, 3, 3) of the rotation in ``q`` (n, k), ``exact`` or linearised."""
    vectors = q[:, 2:5]
    return rotations(vectors) if exact else torch.eye(3).to(q) + cross_matrices(vectors)


def slopes(q: Tensor, places: Tensor, gradient: Tensor, *, exact: bool) -> Tensor:
    """Change of grey level (n, 5, p) per px and per rad: the modes' product with ``gradient`` (n, 2, p).

    A small rotation ``v`` moves a point ``P`` by ``v x P``, of which the image shows x and y.
    """
    x, y, z = (moved(q, places, exact=True) if exact else places).unbind(1)
    gx, gy = gradient.unbind(1)
    turned = torch.stack((-gy * z, gx * z, gy * x - gx * y), 1)
    if exact:
        turned = tangents(q[:, 2:5]).mT @ turned
    return torch.cat((gradient, turned), 1)


#: Displacement in x and y per unknown from (1, x, y, z) of a point: (2, 5, 4).
_MODES = torch.tensor(
    [
        [[1, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1], [0, 0, -1, 0]],
        [[0, 0, 0, 0], [1, 0, 0, 0], [0, 0, 0, -1], [0, 0, 0, 0], [0, 1, 0, 0]],
    ],
    dtype=torch.float64,
)


def gram(q: Tensor, places: Tensor, weights: Tensor, *, exact: bool, every: int = 1) -> Tensor:
    """Weighted sum (n, 5, 5), float64, of the products of the modes, over every ``every``-th point."""
    moments = _moments(places, weights, every).double()
    modes = _MODES.to(moments.device)
    if exact:
        turn, change = torch.eye(5, dtype=torch.float64, device=moments.device).repeat(2, len(moments), 1, 1)
        turn = turn[:, :4, :4]
        turn[:, 1:, 1:], change[:, 2:, 2:] = rotations(q[:, 2:5]), tangents(q[:, 2:5])
        moments = turn @ moments @ turn.mT
    total = (modes @ moments[:, None] @ modes.mT).sum(1)
    return change.mT @ total @ change if exact else total


@jit.in_loops(rotation.moments)
def _moments(places: Tensor, weights: Tensor, every: int) -> Tensor:
    """Weighted sums (n, 4, 4) of the products of 1 and the ``places`` (n, 3, p), at every ``every``-th point."""
    at = torch.cat((torch.ones_like(places[:, :1, ::every]), places[..., ::every]), 1)
    return (at * weights[:, None, ::every]) @ at.mT
