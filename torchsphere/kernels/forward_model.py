"""The forward model in compiled loops, one ray after the other: `torchsphere.sphere_map.forward_model` on the CPU.

The torch functions there say what is computed. Here nothing is stored between the steps of a ray, and pixels without
weight are left out.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchsphere.kernels.cube_map import place, slopes, sum_with_slopes, weights
from torchsphere.kernels.jit import ONE, TWO, ZERO, Floats, Integers, arrays, compiled
from torchsphere.kernels.rays import (
    Rule,
    coverage,
    drawn_together,
    end_of_disc,
    footprint,
    limb_part,
    number_of_rule,
    rays_at_limb,
    row_of_rays,
    two_rays,
)

Array = NDArray[Any]
Numbers = NDArray[np.int32]

_HALF, _TINY = np.float32(0.5), np.float32(1e-6)
_FIVE, _THREE, _EIGHT, _QUARTER = (np.float32(v) for v in (5, 3, 8, 0.25))

#: Number of columns of the jacobian.
COLUMNS = 9


def contiguous(
    offset: Tensor,
    places: Tensor,
    orientation: Tensor,
    brightness: Tensor,
    visibility: Tensor,
    background: Tensor,
    ball: Tensor,
) -> tuple[Any, ...]:
    """What the loops read, as contiguous arrays in single precision."""
    tensors = offset, places, orientation, brightness, visibility, background, ball
    return tuple(tensor.to(torch.float32).contiguous().numpy() for tensor in tensors)


def linearise(coefficients: Tensor, cells: int, rule: Rule, *images: Tensor) -> tuple[Tensor, Tensor]:
    """Levels (n, s, s) and jacobian (n, s * s, 9); ``images`` as for `contiguous`.

    Offsets (n, 2) of the first pixel from the centre, or those of all pixels (n, s, s, 2), without images in an
    orthographic view; orientations (n, 3, 3), gains and offsets (n, 2), visibility and background (n, s, s); radius,
    blur, nearness, light and blur of the footprint (n, 8), in the axes of the view.
    """
    given = contiguous(*images)
    levels = torch.zeros_like(images[4])
    jacobian = levels.new_zeros(len(levels), levels[0].numel(), COLUMNS)
    _linearise(coefficients.contiguous().numpy(), cells, rule, *given, levels.numpy(), jacobian.numpy())
    return levels, jacobian


def design(cells: int, rule: Rule, *images: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    """Corners, offsets, factors and pixels of the rays, and fixed levels, of `sphere_map.design.Design`."""
    given = contiguous(*images)
    fixed = torch.zeros_like(images[4])
    n, side, _ = fixed.shape
    begins = torch.empty(n, side * side + 1, dtype=torch.int64)
    _count(rule, given[0], given[1], given[4], given[6], begins.numpy())
    most = int(begins[:, -1].max())
    corner, pixel = (torch.zeros(n, most, dtype=torch.int32) for _ in range(2))
    offset, factor = fixed.new_zeros(n, most, 2), fixed.new_zeros(n, most)
    _design(cells, rule, *given, begins.numpy(), *arrays(corner, offset, factor, pixel, fixed))
    return corner, offset, factor, pixel, fixed


@compiled
def _linearise(
    coefficients: Floats,
    cells: int,
    rule: Rule,
    first: Floats,
    places: Floats,
    turns: Floats,
    brightness: Floats,
    visibility: Floats,
    background: Floats,
    ball: Floats,
    levels: Floats,
    jacobian: Floats,
) -> None:
    n, side, _ = visibility.shape
    room, line = room_for_rows(side, rule.points.shape[1]), np.empty((COLUMNS, side), np.float32)
    for i in range(n):
        given = coefficients, cells, rule, turns[i], brightness[i], ball[i]
        for row in range(side):
            find_places(first[i], places, i, row, room)
            linearise_row(given, visibility[i, row], background[i, row], room, levels[i, row], line)
            for column in range(side):
                found = jacobian[i, row * side + column]
                for k in range(COLUMNS):
                    found[k] = line[k, column]


@compiled
def room_for_rows(side: int, points: int) -> tuple[Array, ...]:
    """Memory for the rays of a row of ``side`` pixels: see `row_of_rays` and `_meet`."""
    outline, begins = np.empty((side, 4), np.float32), np.empty(side + 1, np.int64)
    rays, corner = np.empty((20, side * points), np.float32), np.empty(side * points, np.int32)
    across, down = np.empty(side, np.float32), np.empty(side, np.float32)
    return outline, begins, rays, corner, np.empty(side * points, np.int32), across, down


@compiled
def find_places(first: Floats, places: Floats, image: int, row: int, room: tuple[Array, ...]) -> None:
    """Offsets of a row of pixels from the ball's centre, into the last two parts of the ``room``."""
    across, down = room[5], room[6]
    if len(places) == 0:
        x, y = first[0], first[1] + np.float32(row)
        for column in range(len(across)):
            across[column], down[column] = x + np.float32(column), y
    else:
        for column in range(len(across)):
            across[column], down[column] = places[image, row, column, 0], places[image, row, column, 1]


@compiled
def linearise_row(
    given: tuple[Any, ...],
    visibility: Floats,
    background: Floats,
    room: tuple[Array, ...],
    levels: Floats,
    line: Floats,
) -> None:
    """Levels (s,) and derivatives (9, s) of a row of pixels.

    Both are 0 for pixels without weight. ``given`` are the map, its cells, the rule, the turn, the brightness and the
    ball; ``room`` is that of `room_for_rows` with the places of the pixels.
    """
    coefficients, cells, rule, turn, brightness, ball = given
    outline, begins, rays, corner, axis, xs, ys = room
    per_px = ONE / ball[0]
    gain, dark = brightness[0], brightness[1]
    # Step by step over the rays of the row: the steps without look-ups run on several rays at once.
    count = row_of_rays(xs, ys, ball, rule, visibility, outline, begins, rays)
    _touch(rays, count, per_px, ball[2])
    _meet(rays, corner, axis, count, turn, cells)
    _look_up(coefficients, np.uint64(cells + 3), corner, rays, count)
    _move(rays, axis, count, turn, ball, cells)
    for column in range(len(visibility)):
        lit, dx, dy, wx, wy, wz, wider = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
        start, stop = begins[column], begins[column + 1]
        for k in range(start, stop):
            lit += rays[0, k]
            dx += rays[1, k]
            dy += rays[2, k]
            wx += rays[3, k]
            wy += rays[4, k]
            wz += rays[5, k]
            wider += rays[6, k]
        behind, part, steep, outwards, blurred, share = background[column], ZERO, ZERO, ZERO, ZERO, ZERO
        x, y = xs[column], ys[column]
        contrast = lit - behind
        if stop > start:
            share, edge, spread, gained = outline[column]
            part, steep, blurred = gain * share, gain * edge * contrast, gain * spread * contrast
            # The outline gives or takes what lies there: the first ray is the one nearest to it.
            steep += part * gained * (rays[7, start] - lit)
            distance = np.sqrt(x * x + y * y)
            outwards = steep / (distance if distance > _TINY else _TINY)
            part *= per_px
        shown = ZERO if visibility[column] == ZERO else ONE
        unit = shown * (behind + share * contrast)
        line[0, column], line[1, column] = part * dx + outwards * x, part * dy + outwards * y
        line[2, column], line[3, column], line[4, column] = part * wx, part * wy, part * wz
        line[5, column], line[6, column] = part * wider + steep, blurred
        line[7, column], line[8, column] = unit, shown
        levels[column] = gain * unit + shown * dark


@compiled
def _touch(rays: Floats, count: int, per_px: Any, near: Any) -> None:
    """Where the rays meet a ball of that nearness.

    Shrink and steepness of `sphere_map.forward_model` follow there, and by how much points move with the radius.
    """
    for i in range(count):
        wide = rays[2, i] * per_px
        x, y = wide * rays[0, i], wide * rays[1, i]
        square = x * x + y * y
        height, upright = np.sqrt(ONE - square), np.sqrt(ONE - near * near * square)
        shrink = upright - near * height
        rays[6, i], rays[7, i], rays[8, i] = shrink * x, shrink * y, -(height * upright + near * square)
        steepness = ONE / height - near / upright
        rays[17, i], rays[18, i], rays[19, i] = shrink, steepness, ONE / (height * steepness)


@compiled
def _meet(rays: Floats, corner: Numbers, axis: Numbers, count: int, turn: Floats, cells: int) -> None:
    """Where the points of the rays lie on the map."""
    half, last, width = np.float32(cells) / TWO, np.float32(cells - 1), np.int32(cells + 3)
    for i in range(count):
        px, py, pz = rays[6, i], rays[7, i], rays[8, i]
        # Axes of the ball.
        x = turn[0, 0] * px + turn[1, 0] * py + turn[2, 0] * pz
        y = turn[0, 1] * px + turn[1, 1] * py + turn[2, 1] * pz
        z = turn[0, 2] * px + turn[1, 2] * py + turn[2, 2] * pz
        along, across, inwards = abs(x), abs(y), abs(z)
        by_x = along >= across and along >= inwards
        by_y = not by_x and across >= inwards
        ahead = x if by_x else y if by_y else z
        nearer = ONE / ahead
        size = abs(nearer)
        t, r = (y if by_x else z if by_y else x) * size, (z if by_x else x if by_y else y) * size
        u, v = (t * (_FIVE - t * t) * _QUARTER + ONE) * half, (r * (_FIVE - r * r) * _QUARTER + ONE) * half
        # NaN goes to the first cell.
        column, row = np.floor(u), np.floor(v)
        column, row = column if column > ZERO else ZERO, row if row > ZERO else ZERO
        column, row = column if column < last else last, row if row < last else last
        number = np.int32(0) if by_x else np.int32(1) if by_y else np.int32(2)
        axis[i] = number
        face = number + (np.int32(0) if ahead > ZERO else np.int32(3))
        corner[i] = (face * width + np.int32(row)) * width + np.int32(column)
        rays[9, i], rays[10, i], rays[11, i], rays[12, i] = u - column, v - row, t, r
        rays[13, i] = nearer


@compiled
def _look_up(coefficients: Floats, width: Any, corner: Numbers, rays: Floats, count: int) -> None:
    """Values of the map at the rays, and derivatives by the places in the cells."""
    for i in range(count):
        u, v = rays[9, i], rays[10, i]
        at = np.uint64(np.uint32(corner[i]))
        value, by_u, by_v = sum_with_slopes(coefficients, at, width, weights(u), weights(v), slopes(u), slopes(v))
        rays[14, i], rays[15, i], rays[16, i] = value, by_u, by_v


@compiled
def _move(rays: Floats, axis: Numbers, count: int, turn: Floats, ball: Floats, cells: int) -> None:
    """Weighted levels of the rays, their changes by the motion and by the radius, and the levels themselves.

    They replace the first rows; lengths are in radii.
    """
    per_px, near, same, lx, ly, lz = ONE / ball[0], ball[2], ball[3], ball[4], ball[5], ball[6]
    steepest = np.float32(cells) / _EIGHT
    for i in range(count):
        x, y, scale, stretch, of_size, weight = rays[0, i], rays[1, i], rays[2, i], rays[3, i], rays[4, i], rays[5, i]
        px, py, pz, t, r, nearer = rays[6, i], rays[7, i], rays[8, i], rays[11, i], rays[12, i], rays[13, i]
        size = abs(nearer) * steepest
        by_u, by_v = rays[15, i] * size * (_FIVE - _THREE * t * t), rays[16, i] * size * (_FIVE - _THREE * r * r)
        by_height = by_u * t + by_v * r
        by_height = -by_height if nearer > ZERO else by_height
        by_x, by_y = axis[i] == 0, axis[i] == 1
        gx = by_height if by_x else by_v if by_y else by_u
        gy = by_u if by_x else by_height if by_y else by_v
        gz = by_v if by_x else by_u if by_y else by_height
        # Axes of the view.
        bright = same + lx * px + ly * py + lz * pz
        light, value = weight * bright, weight * rays[14, i]
        sx = light * (turn[0, 0] * gx + turn[0, 1] * gy + turn[0, 2] * gz)
        sy = light * (turn[1, 0] * gx + turn[1, 1] * gy + turn[1, 2] * gz)
        sz = light * (turn[2, 0] * gx + turn[2, 1] * gy + turn[2, 2] * gz)
        wx, wy, shrink = sx + value * lx, sy + value * ly, rays[17, i]
        tilt = rays[18, i] * (sz + value * lz + near * (wx * px + wy * py) / (shrink * shrink))
        tx, ty = shrink * wx + tilt * px, shrink * wy + tilt * py
        radial = tx * x + ty * y
        stretch *= radial
        rays[0, i], rays[1, i], rays[2, i] = bright * value, -scale * tx - stretch * x, -scale * ty - stretch * y
        rays[3, i], rays[4, i], rays[5, i] = sy * pz - sz * py, sz * px - sx * pz, sx * py - sy * px
        # With its radius the ball's nearness grows: points move inwards by more than their share of the radius.
        rays[6, i], rays[7, i] = radial * (of_size - scale * per_px * rays[19, i]), bright * rays[14, i]


@compiled
def _count(rule: Rule, first: Floats, places: Floats, visibility: Floats, ball: Floats, begins: Integers) -> None:
    """Number of rays before each pixel, and in all: none where the ball cannot be seen."""
    n, side, _ = visibility.shape
    room = room_for_rows(side, 1)
    for i in range(n):
        radius, blur, wide = ball[i, 0], ball[i, 1], ball[i, 7]
        inner, _, _ = two_rays(radius, wide, rule)
        beyond, count = radius + ONE + _EIGHT * blur, 0
        for row in range(side):
            find_places(first[i], places, i, row, room)
            for column in range(side):
                begins[i, row * side + column] = count
                x, y = room[5][column], room[6][column]
                distance = np.sqrt(x * x + y * y)
                if visibility[i, row, column] == ZERO or distance >= beyond:
                    continue
                if distance < inner:
                    count += 2
                else:
                    half, _ = footprint(x, y, distance, wide)
                    shallow, deep = limb_part(distance, end_of_disc(radius, wide), half)
                    count += rule.counts[number_of_rule(shallow, deep, radius, rule)]
        begins[i, side * side] = count


@compiled
def _design(
    cells: int,
    rule: Rule,
    first: Floats,
    places: Floats,
    turns: Floats,
    brightness: Floats,
    visibility: Floats,
    background: Floats,
    ball: Floats,
    begins: Integers,
    corners: Numbers,
    offsets: Floats,
    factor: Floats,
    pixel: Numbers,
    fixed: Floats,
) -> None:
    n, side, _ = visibility.shape
    room = room_for_rows(side, 1)
    roots, weights = np.empty((2, rule.points.shape[1]), np.float32)
    for i in range(n):
        radius, blur, near, same, lx, ly, lz, wide = ball[i]
        inner, apart, out = two_rays(radius, wide, rule)
        outermost, per_px, end = rule.limits[2] * radius, ONE / radius, end_of_disc(radius, wide)
        turn, gain, dark = turns[i], brightness[i, 0], brightness[i, 1]
        for row in range(side):
            find_places(first[i], places, i, row, room)
            for column in range(side):
                if visibility[i, row, column] == ZERO:
                    continue
                number = row * side + column
                start, stop = begins[i, number], begins[i, number + 1]
                x, y = room[5][column], room[6][column]
                distance = np.sqrt(x * x + y * y)
                distance = distance if distance > _TINY else _TINY
                share, _, _ = coverage(x, y, distance, radius, blur)
                fixed[i, row, column] = gain * (ONE - share) * background[i, row, column] + dark
                is_inner = distance < inner
                whole, c0, c1, c2 = ONE, ZERO, ONE, ZERO
                if not is_inner:
                    half, top = footprint(x, y, distance, wide)
                    points, whole, _, _ = rays_at_limb(distance, radius, wide, half, top, rule, roots, weights)
                    c0, c1, c2, _ = drawn_together(radius, wide, roots, weights, points, whole)
                for k in range(start, stop):
                    if is_inner:
                        weight, scale = _HALF, out * (ONE - apart if k == start else ONE + apart)
                    else:
                        weight, root = weights[k - start] / whole, roots[k - start]
                        moved = c0 + root * (c1 + root * c2)
                        scale = min(radius / end * (end - moved * moved), outermost) / distance
                    px, py = scale * per_px * x, scale * per_px * y
                    square = px * px + py * py
                    height, upright = np.sqrt(ONE - square), np.sqrt(ONE - near * near * square)
                    shrink = upright - near * height
                    px, py, pz = shrink * px, shrink * py, -(height * upright + near * square)
                    ax = turn[0, 0] * px + turn[1, 0] * py + turn[2, 0] * pz
                    ay = turn[0, 1] * px + turn[1, 1] * py + turn[2, 1] * pz
                    az = turn[0, 2] * px + turn[1, 2] * py + turn[2, 2] * pz
                    corner, _, _, u, v, _, _ = place(ax, ay, az, cells)
                    corners[i, k], pixel[i, k] = np.int32(corner), np.int32(number)
                    offsets[i, k, 0], offsets[i, k, 1] = u, v
                    factor[i, k] = gain * share * weight * (same + lx * px + ly * py + lz * pz)
