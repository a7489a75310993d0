"""What the arrays of the ball's map hold, for the loops and for those who fill and read them.

The numbers of rows and columns are constants of the compiled loops.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels.jit import Floats, Integers

Numbers = NDArray[np.int32]

#: Columns of a jacobian: the motion, rotations times the radius; what all images share; and the brightness.
DX, DY, WX, WY, WZ, BY_RADIUS, BY_BLUR, BY_GAIN, BY_OFFSET = range(9)
COLUMNS = 9

#: Columns of `Images.ball`: radius and blur of the edge, px; radius over distance; terms of the light, in the axes of
#: the view; blur of the footprint, px; and bend of the edge by the camera's tone curve.
RADIUS, BLUR, NEARNESS, EVEN_LIGHT, LIGHT_X, LIGHT_Y, LIGHT_Z, FOOTPRINT_BLUR, EDGE_BEND = range(9)
BALL_COLUMNS = 9

#: Columns of `RowMemory.outline`: share, edge and spread of `rays.coverage`.
SHARE, EDGE, SPREAD = range(3)
OUTLINE_COLUMNS = 3

#: Rows of `RowMemory.rays`: offset of the pixel, px; scale to the ray, its changes by distance and size; and weight.
PIXEL_X, PIXEL_Y, SCALE, STRETCH, BY_SIZE, WEIGHT = range(6)
#: Point on the unit sphere, in the axes of the view. Before there is one, its first row holds the roots of the rays.
POINT_X, POINT_Y, POINT_Z = range(6, 9)
ROOT = POINT_X
#: Place in the cell of the map, tangents of the direction on the face, and one over the component across the face.
CELL_U, CELL_V, TANGENT_T, TANGENT_R, NEARER = range(9, 14)
#: Value of the map, and its derivatives by the place in the cell.
VALUE, BY_U, BY_V = range(14, 17)
#: Shrink and steepness of `sphere_map.forward_model`, and by how much points move with the radius.
SHRINK, STEEPNESS, INWARDS = range(17, 20)
#: Change of the weight as the outline gives or takes a part of the pixel.
GAINED = 20
RAY_ROWS = 21
#: At last, in place of the first rows: weighted level, its changes by motion and size, and the level without weight.
LIT, LIT_BY_X, LIT_BY_Y, LIT_BY_WX, LIT_BY_WY, LIT_BY_WZ, LIT_BY_SIZE, BARE = range(8)


class Images(NamedTuple):
    """Images and poses: tensors, or for the loops contiguous arrays in single precision."""

    first: Any  # offsets (n, 2) of the first pixel from the centre, px
    places: Any  # those of all pixels (n, s, s, 2), or of none (0, 0, 0, 2) in an orthographic view
    orientation: Any  # rotations (n, 3, 3), to the axes of the view
    brightness: Any  # gains and offsets (n, 2)
    visibility: Any  # (n, s, s)
    background: Any  # grey levels (n, s, s)
    ball: Any  # numbers (n, 9) of the ball: `RADIUS` to `EDGE_BEND`


class Rays(NamedTuple):
    """Tensors or arrays of t rays in each of n images."""

    corner: Any  # first of sixteen coefficients (n, t)
    offset: Any  # places (n, t, 2) in their cells
    factor: Any  # factors (n, t)
    pixel: Any  # numbers (n, t) of the pixels


class RowMemory(NamedTuple):
    """Memory for the rays of a row of s pixels with up to k rays each."""

    outline: Floats  # (s, 3)
    begins: Integers  # numbers (s + 1,) of the first rays of the pixels
    rays: Floats  # (21, s * k)
    corner: Numbers  # first of sixteen coefficients (s * k,)
    axis: Numbers  # axis across the face (s * k,)
    across: Floats  # offsets (s,) of the pixels from the ball's centre, px
    down: Floats


def contiguous(images: Images) -> Images:
    """Contiguous arrays in single precision."""
    tensors: tuple[Tensor, ...] = images
    return Images(*(tensor.float().contiguous().numpy() for tensor in tensors))
