"""A textured ball, its poses and the windows around it, for tests of the forward model; look-ups in full."""

import functools
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import torch
from shots import rotation_matrix
from torch import Tensor

from torchsphere.imaging.interpolation import spline_weights
from torchsphere.sphere_map import cube_map, map_fit
from torchsphere.sphere_map.ball import Poses, TexturedBall
from torchsphere.sphere_map.cube_map import Places
from torchsphere.sphere_map.design import Design
from torchsphere.sphere_map.window import Windows, cut_windows

Result = TypeVar("Result")

RADIUS, CELLS, SIZE = 20.0, 10, 60


def random(*shape: int, seed: int = 2) -> Tensor:
    """Normal random numbers, float64."""
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def random_directions(count: int, seed: int = 0) -> Tensor:
    """Unit vectors (3, count)."""
    return torch.nn.functional.normalize(random(3, count, seed=seed), dim=0)


def indices_and_weights(places: Places) -> tuple[Tensor, Tensor]:
    """Numbers (..., 16) and weights (..., 16) of the coefficients of each direction."""
    width = places.cells + 3
    index = torch.stack([places.corner + row * width + column for row in range(4) for column in range(4)], -1)
    x, y = (spline_weights(offset) for offset in places.offset)
    return index, torch.stack([across * along for across in y for along in x], -1)


def dense_design(places: Places) -> Tensor:
    """Matrix (p, m) of the values in p directions by the coefficients of the map."""
    index, weight = indices_and_weights(places)
    count = cube_map.coefficient_count(places.cells)
    return torch.zeros(len(index), count, dtype=weight.dtype).scatter_add(1, index, weight)


def dense_rows(design: Design) -> Tensor:
    """Matrix (n * s * s, m) of the map's part of the grey levels by the coefficients."""
    offset, count = design.offset.flatten(0, 1).T, cube_map.coefficient_count(design.cells)
    index, weight = indices_and_weights(Places(design.corner.flatten().long(), offset, offset, design.cells))
    amounts = weight * design.factor.reshape(-1, 1)
    first = design.fixed[0].numel() * torch.arange(len(design.fixed)).unsqueeze(1)
    row = (first + design.pixel).reshape(-1, 1)
    rows = torch.zeros(design.fixed.numel() * count, dtype=weight.dtype)
    return rows.index_add(0, (row * count + index).flatten(), amounts.flatten()).reshape(-1, count)


def maps_without_seams(cells: int) -> Tensor:
    """Coefficients (m, k) of k maps that have one value at each node, though two or three faces share it."""
    _, free = cube_map.joined_at_seams(random(cube_map.coefficient_count(cells)), cells).unique(return_inverse=True)
    values = torch.nn.functional.one_hot(free).double()
    return map_fit.to_nodes(values, cells)


def sums_of_factors(design: Design) -> Tensor:
    """Sums (n, s, s) of the factors of each pixel's rays."""
    sums = design.factor.new_zeros(len(design.fixed), design.fixed[0].numel())
    return sums.scatter_add(1, design.pixel.long(), design.factor).reshape(design.fixed.shape)


@functools.lru_cache(maxsize=4)
def smooth_coefficients(cells: int = CELLS) -> Tensor:
    """Coefficients (m,), float64, of `smooth_texture`, by least squares in many directions."""
    directions = random_directions(8000, seed=3)
    design = dense_design(cube_map.places(directions, cells))
    regular = 1e-9 * torch.eye(design.shape[1], dtype=torch.float64)
    return torch.linalg.solve(design.T @ design + regular, design.T @ smooth_texture(directions))


def smooth_texture(directions: Tensor) -> Tensor:
    """Grey levels (...) in unit ``directions`` (3, ...): waves of about the ball's radius, between 30 and 210."""
    x, y, z = directions
    return 120 + 30 * torch.sin(4 * x + 3 * y) + 30 * torch.cos(5 * y - 2 * z) + 30 * torch.sin(4 * z + x + 1)


def smooth_ball(cells: int = CELLS, dtype: torch.dtype = torch.float64) -> TexturedBall:
    """A ball without jumps at the seams of its map, in light from one side."""
    light = torch.tensor([1.0, -0.15, 0.1, -0.2], dtype=torch.float64)
    return _ball(cells, smooth_coefficients(cells).to(dtype), light)


def rough_ball(cells: int = CELLS, dtype: torch.dtype = torch.float64) -> TexturedBall:
    """A ball with white noise of 29 grey levels as its texture, in even light."""
    coefficients = 110 + 29 * random(cube_map.coefficient_count(cells))
    return _ball(cells, coefficients.to(dtype), torch.tensor([1.0, 0, 0, 0], dtype=torch.float64))


def _ball(cells: int, coefficients: Tensor, light: Tensor) -> TexturedBall:
    radius, blur = (torch.tensor(v, dtype=torch.float64) for v in (RADIUS, 0.4))
    return TexturedBall(radius, blur, cells, coefficients, light)


def poses(n: int = 2) -> Poses:
    """Poses that differ in all unknowns."""
    at = torch.arange(n, dtype=torch.float64)
    centre = torch.stack((30.34 + 0.37 * at, 29.61 - 0.23 * at), 1)
    turns = [
        rotation_matrix(torch.tensor([0.3 + 0.2 * i, 0.5 - 0.15 * i, -0.2], dtype=torch.float64)) for i in range(n)
    ]
    return Poses(centre, torch.stack(turns), 1.1 - 0.05 * at, 2.0 + at, torch.zeros_like(at))


def grown(at: Poses) -> Poses:
    """The poses with an outline of another radius in each image, larger and smaller than that of the ball."""
    number = torch.arange(len(at), dtype=torch.float64)
    return replace(at, added_radius=0.9 - 1.6 * number)


def windows(at: Poses, dtype: torch.dtype = torch.float64) -> Windows:
    """Windows around the poses over a background that changes from pixel to pixel; the images are noise."""
    background = (40 + 5 * random(SIZE, SIZE, seed=4)).to(dtype)
    images = (90 + 9 * random(len(at), SIZE, SIZE, seed=5)).to(dtype)
    return cut_windows(images, background, at.centre, at.radii(RADIUS))


def one_share(part: Callable[[int, int], Result], n: int) -> list[Result]:
    """All images in one call, as on one thread."""
    return [part(0, n)]


def distances(seen: Windows, at: Poses) -> Tensor:
    """Distance (n, s, s) of the pixels from the centre, px."""
    x, y = seen.offsets(at.centre)
    return (x.square() + y.square()).sqrt()
