"""Share of a pixel that the ball's disc covers, and the rays that sample its footprint, in compiled loops.

The functions are those of `torchsphere.sphere_map.forward_model` on the CPU.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from torchsphere.kernels.jit import ONE, TWO, ZERO, Floats, Integers, compiled

Array = NDArray[Any]

_HALF, _TINY, _LEAST, _THIN = (np.float32(v) for v in (0.5, 1e-6, 0.03, 1e-3))
_TWELFTH, _GAUSS = np.float32(1 / 12), np.float32(1 / math.sqrt(3))
_SIX, _EIGHT, _TWELVE = (np.float32(v) for v in (6, 8, 12))


class Rule(NamedTuple):
    """Where the limb of a sharp image begins, and the Gauss rules over its pixels.

    The first rule serves pixels at the limb; the second one those that show a longer arc of the surface.
    """

    limits: Floats  # (4,): begin of the limb, radii and px from the outline; outermost ray, radii; longest arc, px
    points: Floats  # points (2, k) of both rules, from -1 to 1
    shares: Floats  # their weights (2, k), 0 where a rule has fewer points
    counts: Integers  # (2,): numbers of points


@compiled
def trapezium(x: Any, y: Any, distance: Any, radius: Any, blur: Any) -> tuple[Any, Any]:
    """Half the widths of a blurred square pixel, seen along the radius, at its foot and at its top."""
    a, b = abs(x) / distance, abs(y) / distance
    half, top = _HALF * (a + b), _HALF * abs(a - b)
    narrow = half - top
    beyond = _HALF * (np.sqrt(narrow * narrow + _TWELVE * blur * blur) - narrow)
    tilt = min(distance / radius, ONE)
    if beyond > top:
        return tilt * np.sqrt(_HALF + _SIX * blur * blur), ZERO
    return tilt * (half + beyond), tilt * (top - beyond)


@compiled
def two_rays(radius: Any, blur: Any, rule: Rule) -> tuple[Any, Any]:
    """Distance from the centre, px, up to which two rays are enough, and how they are scaled apart."""
    wider = np.sqrt(ONE + _TWELVE * blur * blur)
    begin = rule.limits[0]
    slope = begin / (np.sqrt(ONE - begin * begin) * wider)
    inner = slope / np.sqrt(ONE + slope * slope) * radius
    return min(inner, radius - rule.limits[1] * wider), _HALF * _GAUSS * wider / radius


@compiled
def height_at(away: Any, half: Any, top: Any) -> Any:
    """Height of a pixel's trapezium ``away`` from its middle, as a share of that in the middle."""
    narrow = half - top
    height = (half - away) / (narrow if narrow > _THIN else _THIN)
    return _THIN if height < _THIN else ONE if height > ONE else height


@compiled
def limb_part(distance: Any, radius: Any, half: Any) -> tuple[Any, Any]:
    """Roots of the distances from the outline between which the disc covers a pixel: the nearer and the farther end."""
    near, far = distance - half, distance + half
    near = min(near, radius - _THIN)
    # No difference may round to less than nothing.
    return np.sqrt(max(radius - far, ZERO)), np.sqrt(max(radius - near, _THIN))


@compiled
def number_of_rule(shallow: Any, deep: Any, radius: Any, rule: Rule) -> int:
    """Number of the rule for a pixel between these roots: the arc of the surface is about their difference."""
    span = deep - shallow
    return 1 if TWO * radius * span * span > rule.limits[3] * rule.limits[3] else 0


@compiled
def coverage(x: Any, y: Any, distance: Any, radius: Any, blur: Any) -> tuple[Any, Any, Any]:
    """`sphere_map.rays.coverage` of one pixel."""
    bent = (blur * blur + _TWELFTH) / (TWO * radius)
    inwards = radius - bent - distance
    if abs(inwards) >= ONE + _EIGHT * blur:
        return (ONE if inwards > ZERO else ZERO), ZERO, ZERO
    a, b = abs(x) / distance, abs(y) / distance
    a, b = _HALF * (a if a > _LEAST else _LEAST), _HALF * (b if b > _LEAST else _LEAST)
    share, slope, spread = 0.0, 0.0, 0.0
    for k in range(4):
        corner = a + b if k == 0 else a - b if k == 1 else b - a if k == 2 else -a - b
        sign = 1.0 if k == 0 or k == 3 else -1.0
        # In double precision: the four terms nearly cancel.
        at, wide = float(inwards + corner), float(blur)
        z = at / wide
        below, density = (1.0 if z > 0.0 else 0.0), 0.0
        # Further away both functions have their limits to the last digit.
        if abs(z) < 9.0:
            below = 0.5 * math.erfc(-z * 0.7071067811865476)
            density = math.exp(-0.5 * z * z) * wide * 0.3989422804014327
        share += sign * (0.5 * (at * at + wide * wide) * below + 0.5 * at * density)
        slope += sign * (at * below + density)
        spread += sign * wide * below
    area = 4.0 * float(a) * float(b)
    by_distance = np.float32(slope / area)
    return np.float32(share / area), by_distance, np.float32(spread / area) - by_distance * blur / radius


@compiled
def row_of_rays(
    xs: Floats,
    ys: Floats,
    ball: Floats,
    rule: Rule,
    visibility: Floats,
    outline: Floats,
    begins: Array,
    rays: Floats,
) -> int:
    """Rays of the pixels in a row: offsets x and y, scale, its changes by distance and size, and weight; their number.

    Also of each pixel share, edge and spread of `coverage`, and what the outline gives or takes.
    """
    radius, blur, wide = ball[0], ball[1], ball[7]
    inner, closer = two_rays(radius, wide, rule)
    outermost = rule.limits[2] * radius
    count = 0
    for column in range(len(visibility)):
        begins[column] = count
        if visibility[column] == ZERO:
            continue
        x, y = xs[column], ys[column]
        distance = np.sqrt(x * x + y * y)
        distance = distance if distance > _TINY else _TINY
        share, edge, spread = coverage(x, y, distance, radius, blur)
        outline[column, 0], outline[column, 1], outline[column, 2], outline[column, 3] = share, edge, spread, ZERO
        if share == ZERO and edge == ZERO:
            continue
        if distance < inner:
            for k in range(2):
                sign = -ONE if k == 0 else ONE
                rays[0, count], rays[1, count], rays[2, count] = x, y, ONE + sign * closer
                rays[3, count], rays[4, count], rays[5, count] = ZERO, -sign * closer / radius, _HALF
                count += 1
            continue
        half, top = trapezium(x, y, distance, radius, wide)
        shallow, deep = limb_part(distance, radius, half)
        whole, number = ZERO, number_of_rule(shallow, deep, radius, rule)
        points, shares = rule.counts[number], rule.shares
        for k in range(points):
            root = shallow + (deep - shallow) * _HALF * (ONE + rule.points[number, k])
            at, of_distance, of_size = radius - root * root, ONE, ZERO
            weight = shares[number, k] * root * height_at(abs(at - distance), half, top)
            if at > outermost:
                at, of_distance, of_size = outermost, ZERO, rule.limits[2] / distance
            scale = at / distance
            rays[0, count + k], rays[1, count + k], rays[2, count + k] = x, y, scale
            rays[3, count + k], rays[4, count + k] = (of_distance - scale) / (distance * distance), of_size
            rays[5, count + k] = weight
            whole += weight
        for _ in range(points):
            rays[5, count] /= whole
            count += 1
        if distance + half > radius:
            outline[column, 3] = height_at(abs(radius - distance), half, top) / (whole * (deep - shallow))
    begins[len(visibility)] = count
    return count
