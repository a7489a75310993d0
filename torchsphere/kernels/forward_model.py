"""The forward model in compiled loops, one ray after the other: `torchsphere.sphere_map.forward_model` on the CPU.

The torch functions there say what is computed. Here nothing is stored between the steps of a ray, and pixels without
weight are left out.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchsphere.kernels import layout
from torchsphere.kernels.cube_map import place
from torchsphere.kernels.jit import ONE, ZERO, Floats, Integers, arrays, compiled
from torchsphere.kernels.layout import Images, Numbers, Rays, RowMemory, contiguous
from torchsphere.kernels.rays import Rule, begin_of_limb, end_of_disc, footprint, row_of_rays, shares_of_rules
from torchsphere.kernels.sixteen import sum_with_slopes

_TINY = np.float32(1e-6)
_FIVE, _THREE, _EIGHT = (np.float32(v) for v in (5, 3, 8))


class Model(NamedTuple):
    """The map and the rule of its rays."""

    coefficients: Any  # tensor, or array for the loops (m,)
    cells: int
    rule: Rule

    def of_arrays(self) -> Model:
        """As the loops read it."""
        return self._replace(coefficients=self.coefficients.contiguous().numpy())


def linearise(model: Model, images: Images) -> tuple[Tensor, Tensor]:
    """Levels (n, s, s) and jacobian (n, s * s, 9)."""
    levels = torch.empty_like(images.visibility)
    jacobian = levels.new_empty(len(levels), levels[0].numel(), layout.COLUMNS)
    _linearise(model.of_arrays(), contiguous(images), levels.numpy(), jacobian.numpy())
    return levels, jacobian


def design(cells: int, rule: Rule, images: Images) -> tuple[Rays, Tensor]:
    """The rays of `sphere_map.design.Design`, and its fixed levels."""
    given, fixed = contiguous(images), torch.zeros_like(images.visibility)
    n, side, _ = fixed.shape
    begins = torch.empty(n, side * side + 1, dtype=torch.int64)
    _count(rule, given, begins.numpy())
    most = int(begins[:, -1].max())
    corner, pixel = (torch.zeros(n, most, dtype=torch.int32) for _ in range(2))
    rays = Rays(corner, fixed.new_zeros(n, most, 2), fixed.new_zeros(n, most), pixel)
    _design(cells, rule, given, begins.numpy(), Rays(*arrays(*rays)), fixed.numpy())
    return rays, fixed


@compiled
def _linearise(model: Model, images: Images, levels: Floats, jacobian: Floats) -> None:
    n, side, _ = levels.shape
    memory = memory_for_row(side, model.rule)
    line = np.empty((layout.COLUMNS, side), np.float32)
    for i in range(n):
        for row in range(side):
            linearise_row(model, images, i, row, memory, levels[i, row], line)
            for column in range(side):
                found = jacobian[i, row * side + column]
                for k in range(layout.COLUMNS):
                    found[k] = line[k, column]


@compiled
def memory_for_row(side: int, rule: Rule) -> RowMemory:
    """Memory for the rays of a row of ``side`` pixels, which may have two rays and those of both Gauss rules."""
    points = 2 + rule.counts[0] + rule.counts[1]
    outline, begins = np.empty((side, layout.OUTLINE_COLUMNS), np.float32), np.empty(side + 1, np.int64)
    rays, corner = np.empty((layout.RAY_ROWS, side * points), np.float32), np.empty(side * points, np.int32)
    across, down = np.empty(side, np.float32), np.empty(side, np.float32)
    return RowMemory(outline, begins, rays, corner, np.empty(side * points, np.int32), across, down)


@compiled
def _find_places(first: Floats, places: Floats, image: int, row: int, memory: RowMemory) -> None:
    """Put the offsets of a row of pixels from the ball's centre into the ``memory``."""
    # ``first`` is an argument of its own, which overlaps no other: read from its images, last digits change.
    across, down = memory.across, memory.down
    if len(places) == 0:
        x, y = first[0], first[1] + np.float32(row)
        for column in range(len(across)):
            across[column], down[column] = x + np.float32(column), y
    else:
        for column in range(len(across)):
            across[column], down[column] = places[image, row, column, 0], places[image, row, column, 1]


@compiled
def linearise_row(
    model: Model, images: Images, image: int, row: int, memory: RowMemory, levels: Floats, line: Floats
) -> None:
    """Levels (s,) and derivatives (9, s) of a row of pixels, and their places in the ``memory``.

    Both are 0 for pixels without weight.
    """
    _find_places(images.first[image], images.places, image, row, memory)
    visibility, background = images.visibility[image, row], images.background[image, row]
    turn, ball, cells = images.orientation[image], images.ball[image], model.cells
    gain, dark = images.brightness[image, 0], images.brightness[image, 1]
    outline, begins, rays, xs, ys = memory.outline, memory.begins, memory.rays, memory.across, memory.down
    per_px = ONE / ball[layout.RADIUS]
    # Step by step over the rays of the row: the steps without look-ups run on several rays at once.
    count = row_of_rays(ball, model.rule, visibility, memory)
    _touch(rays, count, per_px, ball[layout.NEARNESS])
    _meet(rays, memory.corner, memory.axis, count, turn, cells)
    _look_up(model.coefficients, np.uint64(cells + 3), memory.corner, rays, count)
    _move(rays, memory.axis, count, turn, ball, cells)
    for column in range(len(visibility)):
        lit, dx, dy, wx, wy, wz, wider, gained = ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO, ZERO
        start, stop = begins[column], begins[column + 1]
        for k in range(start, stop):
            lit += rays[layout.LIT, k]
            dx += rays[layout.LIT_BY_X, k]
            dy += rays[layout.LIT_BY_Y, k]
            wx += rays[layout.LIT_BY_WX, k]
            wy += rays[layout.LIT_BY_WY, k]
            wz += rays[layout.LIT_BY_WZ, k]
            wider += rays[layout.LIT_BY_SIZE, k]
            gained += rays[layout.GAINED, k] * rays[layout.BARE, k]
        behind, part, steep, outwards, blurred, share = background[column], ZERO, ZERO, ZERO, ZERO, ZERO
        x, y = xs[column], ys[column]
        contrast = lit - behind
        if stop > start:
            share, edge, spread = outline[column]
            part, blurred = gain * share, gain * spread * contrast
            steep = gain * edge * contrast + part * gained
            distance = np.sqrt(x * x + y * y)
            outwards = steep / (distance if distance > _TINY else _TINY)
            part *= per_px
        shown = ZERO if visibility[column] == ZERO else ONE
        unit = shown * (behind + share * contrast)
        line[layout.DX, column], line[layout.DY, column] = part * dx + outwards * x, part * dy + outwards * y
        line[layout.WX, column], line[layout.WY, column], line[layout.WZ, column] = part * wx, part * wy, part * wz
        line[layout.BY_RADIUS, column], line[layout.BY_BLUR, column] = part * wider + steep, blurred
        line[layout.BY_GAIN, column], line[layout.BY_OFFSET, column] = unit, shown
        levels[column] = gain * unit + shown * dark


@compiled
def _touch(rays: Floats, count: int, per_px: Any, near: Any) -> None:
    """Where the rays meet a ball of that nearness.

    Shrink and steepness of `sphere_map.forward_model` follow there, and by how much points move with the radius.
    """
    for i in range(count):
        wide = rays[layout.SCALE, i] * per_px
        x, y = wide * rays[layout.PIXEL_X, i], wide * rays[layout.PIXEL_Y, i]
        square = x * x + y * y
        height, upright = np.sqrt(ONE - square), np.sqrt(ONE - near * near * square)
        shrink = upright - near * height
        rays[layout.POINT_X, i], rays[layout.POINT_Y, i] = shrink * x, shrink * y
        rays[layout.POINT_Z, i] = -(height * upright + near * square)
        steepness = ONE / height - near / upright
        rays[layout.SHRINK, i], rays[layout.STEEPNESS, i] = shrink, steepness
        rays[layout.INWARDS, i] = ONE / (height * steepness)


@compiled
def _meet(rays: Floats, corner: Numbers, axis: Numbers, count: int, turn: Floats, cells: int) -> None:
    """Where the points of the rays lie on the map."""
    for i in range(count):
        px, py, pz = rays[layout.POINT_X, i], rays[layout.POINT_Y, i], rays[layout.POINT_Z, i]
        # Axes of the ball.
        x = turn[0, 0] * px + turn[1, 0] * py + turn[2, 0] * pz
        y = turn[0, 1] * px + turn[1, 1] * py + turn[2, 1] * pz
        z = turn[0, 2] * px + turn[1, 2] * py + turn[2, 2] * pz
        corner[i], axis[i], nearer, u, v, t, r = place(x, y, z, cells)
        rays[layout.CELL_U, i], rays[layout.CELL_V, i] = u, v
        rays[layout.TANGENT_T, i], rays[layout.TANGENT_R, i], rays[layout.NEARER, i] = t, r, nearer


@compiled
def _look_up(coefficients: Floats, width: Any, corner: Numbers, rays: Floats, count: int) -> None:
    """Values of the map at the rays, and derivatives by the places in the cells."""
    for i in range(count):
        u, v, at = rays[layout.CELL_U, i], rays[layout.CELL_V, i], np.uint64(np.uint32(corner[i]))
        value, by_u, by_v = sum_with_slopes(coefficients, at, width, u, v)
        rays[layout.VALUE, i], rays[layout.BY_U, i], rays[layout.BY_V, i] = value, by_u, by_v


@compiled
def _move(rays: Floats, axis: Numbers, count: int, turn: Floats, ball: Floats, cells: int) -> None:
    """Weighted levels of the rays, their changes by the motion and by the radius, and the levels themselves.

    They replace the first rows; lengths are in radii.
    """
    per_px, near, same = ONE / ball[layout.RADIUS], ball[layout.NEARNESS], ball[layout.EVEN_LIGHT]
    lx, ly, lz = ball[layout.LIGHT_X], ball[layout.LIGHT_Y], ball[layout.LIGHT_Z]
    steepest = np.float32(cells) / _EIGHT
    for i in range(count):
        x, y, scale = rays[layout.PIXEL_X, i], rays[layout.PIXEL_Y, i], rays[layout.SCALE, i]
        stretch, of_size, weight = rays[layout.STRETCH, i], rays[layout.BY_SIZE, i], rays[layout.WEIGHT, i]
        px, py, pz = rays[layout.POINT_X, i], rays[layout.POINT_Y, i], rays[layout.POINT_Z, i]
        t, r, nearer = rays[layout.TANGENT_T, i], rays[layout.TANGENT_R, i], rays[layout.NEARER, i]
        size = abs(nearer) * steepest
        by_u = rays[layout.BY_U, i] * size * (_FIVE - _THREE * t * t)
        by_v = rays[layout.BY_V, i] * size * (_FIVE - _THREE * r * r)
        by_height = by_u * t + by_v * r
        by_height = -by_height if nearer > ZERO else by_height
        by_x, by_y = axis[i] == 0, axis[i] == 1
        gx = by_height if by_x else by_v if by_y else by_u
        gy = by_u if by_x else by_height if by_y else by_v
        gz = by_v if by_x else by_u if by_y else by_height
        # Axes of the view.
        bright = same + lx * px + ly * py + lz * pz
        light, value = weight * bright, weight * rays[layout.VALUE, i]
        sx = light * (turn[0, 0] * gx + turn[0, 1] * gy + turn[0, 2] * gz)
        sy = light * (turn[1, 0] * gx + turn[1, 1] * gy + turn[1, 2] * gz)
        sz = light * (turn[2, 0] * gx + turn[2, 1] * gy + turn[2, 2] * gz)
        wx, wy, shrink = sx + value * lx, sy + value * ly, rays[layout.SHRINK, i]
        tilt = rays[layout.STEEPNESS, i] * (sz + value * lz + near * (wx * px + wy * py) / (shrink * shrink))
        tx, ty = shrink * wx + tilt * px, shrink * wy + tilt * py
        radial = tx * x + ty * y
        stretch *= radial
        rays[layout.LIT, i] = bright * value
        rays[layout.LIT_BY_X, i], rays[layout.LIT_BY_Y, i] = -scale * tx - stretch * x, -scale * ty - stretch * y
        rays[layout.LIT_BY_WX, i], rays[layout.LIT_BY_WY, i] = sy * pz - sz * py, sz * px - sx * pz
        rays[layout.LIT_BY_WZ, i] = sx * py - sy * px
        # With its radius the ball's nearness grows: points move inwards by more than their share of the radius.
        rays[layout.LIT_BY_SIZE, i] = radial * (of_size - scale * per_px * rays[layout.INWARDS, i])
        rays[layout.BARE, i] = bright * rays[layout.VALUE, i]


@compiled
def _count(rule: Rule, images: Images, begins: Integers) -> None:
    """Number of rays before each pixel, and in all: none where the ball cannot be seen."""
    visibility, ball = images.visibility, images.ball
    n, side, _ = visibility.shape
    memory = memory_for_row(side, rule)
    for i in range(n):
        radius, blur, wide = ball[i, layout.RADIUS], ball[i, layout.BLUR], ball[i, layout.FOOTPRINT_BLUR]
        limb, end = begin_of_limb(radius, wide, rule), end_of_disc(radius, wide)
        beyond, count = radius + ONE + _EIGHT * blur, 0
        for row in range(side):
            _find_places(images.first[i], images.places, i, row, memory)
            for column in range(side):
                begins[i, row * side + column] = count
                x, y = memory.across[column], memory.down[column]
                distance = np.sqrt(x * x + y * y)
                if visibility[i, row, column] == ZERO or distance >= beyond:
                    continue
                distance = distance if distance > _TINY else _TINY
                half, _ = footprint(x, y, distance, wide)
                two, first, second = shares_of_rules(distance, radius, end, half, limb, rule)
                count += 2 if two > ZERO else 0
                count += rule.counts[0] if first > ZERO else 0
                count += rule.counts[1] if second > ZERO else 0
        begins[i, side * side] = count


@compiled
def _design(cells: int, rule: Rule, images: Images, begins: Integers, found: Rays, fixed: Floats) -> None:
    visibility, background, brightness = images.visibility, images.background, images.brightness
    corners, offsets, factor, pixel = found
    n, side, _ = visibility.shape
    memory = memory_for_row(side, rule)
    rays, outline = memory.rays, memory.outline
    for i in range(n):
        ball, turn, gain, dark = images.ball[i], images.orientation[i], brightness[i, 0], brightness[i, 1]
        same, lx, ly, lz = ball[layout.EVEN_LIGHT], ball[layout.LIGHT_X], ball[layout.LIGHT_Y], ball[layout.LIGHT_Z]
        for row in range(side):
            _find_places(images.first[i], images.places, i, row, memory)
            count = row_of_rays(ball, rule, visibility[i, row], memory)
            _touch(rays, count, ONE / ball[layout.RADIUS], ball[layout.NEARNESS])
            _meet(rays, memory.corner, memory.axis, count, turn, cells)
            for column in range(side):
                if visibility[i, row, column] == ZERO:
                    continue
                number, share = row * side + column, outline[column, layout.SHARE]
                fixed[i, row, column] = gain * (ONE - share) * background[i, row, column] + dark
                start, first = begins[i, number], memory.begins[column]
                # A ray whose share rounds to nothing may be counted in one of both.
                most = min(begins[i, number + 1] - start, memory.begins[column + 1] - first)
                for k in range(most):
                    at, ray = start + k, first + k
                    px, py, pz = rays[layout.POINT_X, ray], rays[layout.POINT_Y, ray], rays[layout.POINT_Z, ray]
                    corners[i, at], pixel[i, at] = memory.corner[ray], np.int32(number)
                    offsets[i, at, 0], offsets[i, at, 1] = rays[layout.CELL_U, ray], rays[layout.CELL_V, ray]
                    light = same + lx * px + ly * py + lz * pz
                    factor[i, at] = gain * share * rays[layout.WEIGHT, ray] * light
