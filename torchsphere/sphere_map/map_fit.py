"""The fit of the texture map with the poses held fixed: conjugate gradients on its sparse equations.

The grey levels are linear in the map. Its equations are never set up: each step draws the map into all images and sums
the result over the coefficients. Seen by the map's values at its nodes instead of its spline coefficients, the matrix
is close to its diagonal, so that a few steps are enough.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchsphere.imaging.interpolation import spline_weights
from torchsphere.kernels import cube_map as loops
from torchsphere.kernels.jit import suits
from torchsphere.runtime.threads import RowRunner
from torchsphere.sphere_map import cube_map
from torchsphere.sphere_map.design import Design

#: Prior weight of the map's second differences, against the heaviest pixel, where noise is weak: a heavy prior flattens
#: the map and pulls at the radius; and weight of its coefficients, against those (docs/constants.toml).
SMOOTHNESS, RIDGE = 4e-4, 0.25

#: Prior weight over the square of noise over texture, both as variances, where that is more: a map that may follow the
#: noise holds each image where it was (docs/constants.toml).
SMOOTHNESS_IN_NOISE, MAX_SMOOTHNESS = 17.0, 1.0

#: Half of the prior's largest eigenvalue at the nodes, over its weight: second differences have squares of up to 16
#: along either axis, and coefficients are up to 3 times the values. A part of the ball that no image shows has the
#: prior alone: with a mean of all its eigenvalues here, conjugate gradients take twice as many steps.
PRIOR_AT_NODES = (2 * 16 + 3**4 * RIDGE) / 2

#: Mean square of a spline that is 1 at its node and 0 at all others, and largest leverage of a pixel: the variance of
#: the noise is not divided by less than what is left (docs/constants.toml).
NODE_SHARE, MAX_LEVERAGE = 0.764, 0.8


@dataclass(frozen=True)
class MapEquations:
    """Normal equations of the map's m coefficients."""

    design: Design  # the model in all images
    weights: Tensor  # weights (n, s, s) of the pixels
    shared: RowRunner  # shares the images out among threads
    density: Tensor  # (m,): sum of the weights of the rays around each node, with the prior, of all faces that share it
    heaviest: Tensor  # largest weight () of a pixel
    smoothness: float = SMOOTHNESS  # weight of the prior against that pixel

    @classmethod
    def of(cls, design: Design, weights: Tensor, shared: RowRunner, smoothness: float = SMOOTHNESS) -> MapEquations:
        """The equations of images with ``weights``."""
        # The prior has nothing against a map that is even: these are the sums of the matrix's rows.
        rows = _summed(design, weights * design.even, shared)
        alone = cls(design, weights, shared, rows, weights.max(), smoothness)
        density = cube_map.joined_at_seams(rows.clamp_min(0) + alone.prior_density, design.cells)
        return replace(alone, density=density)

    @property
    def prior_density(self) -> Tensor:
        """The prior's part () of the `density`."""
        return self.heaviest * self.smoothness * PRIOR_AT_NODES

    def prior(self, coefficients: Tensor) -> Tensor:
        """Product (m, ...) of the prior's matrix with ``coefficients`` (m, ...)."""
        return self.heaviest * self.smoothness * prior_gradient(coefficients, self.design.cells)

    def times(self, coefficients: Tensor) -> Tensor:
        """Product (m,) of the matrix with ``coefficients`` (m,)."""

        def part(a: int, b: int) -> Tensor:
            design = self.design.rows(a, b)
            return design.adjoint(self.weights[a:b] * design.map_levels(coefficients))

        products = torch.stack(self.shared(part, len(self.weights))).sum(0)
        return products + self.prior(coefficients)

    def leverage(self) -> Tensor:
        """Share (n, s, s) of each pixel's noise that the map takes up, nearly."""
        of_node = NODE_SHARE / self.density
        drawn = self.shared(lambda a, b: self.design.rows(a, b).map_levels(of_node), len(self.weights))
        return (self.weights * self.design.even * torch.cat(drawn)).clamp(0, MAX_LEVERAGE)

    def gradient(self, coefficients: Tensor, residual: Tensor) -> Tensor:
        """Descent direction (m,) of the squares at ``coefficients`` (m,), which leave a ``residual`` (n, s, s)."""
        return _summed(self.design, self.weights * residual, self.shared) - self.prior(coefficients)

    def approximate_inverse(self, values: Tensor) -> Tensor:
        """The matrix's inverse times ``values`` (m, ...), as if the matrix were diagonal at the nodes.

        Nodes that faces share have one value, and so has all that conjugate gradients find with this inverse.
        """
        cells = self.design.cells
        at_nodes = cube_map.joined_at_seams(to_nodes(values, cells), cells)
        scale = self.density.reshape(-1, *(1 for _ in values.shape[1:]))
        return to_nodes(at_nodes / scale, cells)

    def solve(self, right: Tensor, steps: int) -> tuple[Tensor, Tensor]:
        """Solution for the ``right`` side (m,) or (m, k) after ``steps`` of conjugate gradients, and what is left.

        Columns are solved for independently of each other.
        """
        solution, residual = torch.zeros_like(right), right
        scaled = self.approximate_inverse(residual)
        direction, square = scaled, (residual * scaled).sum(0)
        for _ in range(steps):
            product = self.times(direction)
            # Without a right side the solution is zero, and nothing may be divided by zero.
            length = square / (direction * product).sum(0).clamp_min(1e-30)
            solution, residual = solution + length * direction, residual - length * product
            scaled = self.approximate_inverse(residual)
            before, square = square, (residual * scaled).sum(0)
            direction = scaled + (square / before.clamp_min(1e-30)) * direction
        return solution, residual


def _summed(design: Design, values: Tensor, shared: RowRunner) -> Tensor:
    """`Design.adjoint` (m,) of ``values`` (n, s, s)."""
    parts = shared(lambda a, b: design.rows(a, b).adjoint(values[a:b]), len(values))
    return torch.stack(parts).sum(0)


def smoothness_for(noise_variance: float, texture_variance: float) -> float:
    """Prior weight for images with that variance of their noise and of their grey levels."""
    share = noise_variance / max(texture_variance - noise_variance, noise_variance)
    return min(max(SMOOTHNESS, SMOOTHNESS_IN_NOISE * share**2), MAX_SMOOTHNESS)


def to_nodes(values: Tensor, cells: int) -> Tensor:
    """Values (m, ...) through the inverse of the splines' sums at the nodes, which is its own transpose, face by face.

    It takes values at nodes to coefficients, and sums over coefficients to sums over nodes.
    """
    if suits(values):
        return loops.to_nodes(values, cells + cube_map.BORDER)
    return _on_faces(_prefilter(cells, values.dtype, values.device), values)


def from_nodes(values: Tensor, cells: int) -> Tensor:
    """The inverse of `to_nodes`."""
    if suits(values):
        return loops.from_nodes(values, cells + cube_map.BORDER)
    return _on_faces(_values_at_nodes(cells).to(values), values)


def _on_faces(matrix: Tensor, values: Tensor) -> Tensor:
    """The symmetric ``matrix`` applied along both axes of the faces to ``values`` (m, ...)."""
    width = len(matrix)
    across = matrix @ values.reshape(6, width, -1)
    return _along(across, matrix, width).reshape(values.shape)


def _along(rows: Tensor, matrix: Tensor, width: int) -> Tensor:
    """The symmetric ``matrix`` applied along the rows of the faces (6, width, width * k)."""
    if rows.shape[-1] == width:
        # One column: a product of matrices, not of a matrix and many vectors.
        return rows @ matrix
    return (matrix @ rows.reshape(6 * width, width, -1)).reshape(rows.shape)


@functools.lru_cache(maxsize=8)
def _prefilter(cells: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """Inverse of the symmetric matrix of the cubic B-splines' values at the nodes of a face, along one axis."""
    return torch.linalg.inv(_values_at_nodes(cells)).to(device, dtype)


@functools.lru_cache(maxsize=8)
def _values_at_nodes(cells: int) -> Tensor:
    """Symmetric matrix of the values of the cubic B-splines of a line at its nodes, the outermost ones folded back."""
    ones = torch.ones(cells + cube_map.BORDER, dtype=torch.float64)
    matrix = torch.diag(ones * 4 / 6) + torch.diag(ones[1:] / 6, 1) + torch.diag(ones[1:] / 6, -1)
    matrix[0, 0] = matrix[-1, -1] = 5 / 6
    return matrix


def refined(coefficients: Tensor, cells: int, fine: int) -> Tensor:
    """Coefficients of a map with ``fine`` cells along a face, equal to a map with ``cells`` at the nodes of the new.

    A map that does not jump at the seams stays one.
    """
    width = cells + cube_map.BORDER
    nodes = (torch.arange(fine + cube_map.BORDER, dtype=torch.float64) - 1) * (cells / fine)
    cell = nodes.floor().clamp(0, cells - 1)
    # The outermost nodes lie beyond the cells; there the last cell's values go on.
    weights = torch.stack(spline_weights((nodes - cell).clamp(0, 1)), 1)
    at_nodes = torch.zeros(len(nodes), width, dtype=torch.float64)
    at_nodes.scatter_(1, cell.long().unsqueeze(1) + torch.arange(4), weights)
    prefilter = _prefilter(fine, torch.float64, torch.device("cpu"))
    matrix = (prefilter @ at_nodes).to(coefficients)
    return (matrix @ coefficients.reshape(6, width, width) @ matrix.T).flatten()


def prior_gradient(coefficients: Tensor, cells: int) -> Tensor:
    """Half the gradient (m, ...) of the prior: squared second differences of the map at its nodes, and squares.

    The differences are those along both axes of every face.
    """
    ridge = RIDGE * (coefficients - coefficients.mean(0))
    width = cells + cube_map.BORDER
    if coefficients.ndim == 1 and suits(coefficients):
        return loops.roughness_gradient(coefficients, width) + ridge
    rough, smooth = _roughness(cells, coefficients.dtype, coefficients.device)
    rows = coefficients.reshape(6, width, -1)
    differences = _along(rough @ rows, smooth, width) + _along(smooth @ rows, rough, width)
    return differences.reshape(coefficients.shape) + ridge


@functools.lru_cache(maxsize=8)
def _roughness(cells: int, dtype: torch.dtype, device: torch.device) -> tuple[Tensor, Tensor]:
    """Matrices of the squared second differences of the splines' values at a line's nodes, and of their squares."""
    values = _values_at_nodes(cells)
    second = torch.diff(torch.eye(len(values), dtype=torch.float64), n=2, dim=0) @ values
    return (second.T @ second).to(device, dtype), (values.T @ values).to(device, dtype)
