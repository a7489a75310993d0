"""A textured ball, its pose and the window around it, for tests of the forward model; stencils written out in full."""

import torch
from shots import rotation_matrix

from torchsphere.imaging.interpolation import spline_weights
from torchsphere.sphere_map import cube_map, forward_model
from torchsphere.sphere_map.cube_map import Stencil
from torchsphere.sphere_map.forward_model import Pose, TexturedBall
from torchsphere.sphere_map.window import Window, cut_window

RADIUS = 20.0


def ball(cells: int = 8) -> TexturedBall:
    generator = torch.Generator().manual_seed(2)
    coefficients = 60 + 100 * torch.rand(cube_map.coefficient_count(cells), generator=generator, dtype=torch.float64)
    return TexturedBall(RADIUS, 0.4, cells, coefficients, forward_model.uniform_light())


def pose() -> Pose:
    orientation = rotation_matrix(torch.tensor([0.3, 0.5, -0.2], dtype=torch.float64))
    return Pose(torch.tensor([30.3, 29.6], dtype=torch.float64), orientation, 1.1, 2.0)


def window(at: Pose) -> Window:
    return cut_window(torch.zeros(60, 60, dtype=torch.float64), torch.full((60, 60), 40.0), at.centre, RADIUS, None)


def indices_and_weights(stencil: Stencil) -> tuple[torch.Tensor, torch.Tensor]:
    """Numbers (q, 16) and weights (q, 16) of the coefficients of each direction."""
    width = stencil.cells + 3
    corner = stencil.corner.long()
    index = torch.stack([corner + row * width + column for row in range(4) for column in range(4)], -1)
    x, y = (spline_weights(offset) for offset in stencil.offset)
    return index, torch.stack([across * along for across in y for along in x], -1)
