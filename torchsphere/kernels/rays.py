"""Share of a pixel that the ball's disc covers, and the rays that sample its footprint, in compiled loops.

The functions are those of `torchsphere.sphere_map.forward_model` on the CPU.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from torchsphere.kernels import layout
from torchsphere.kernels.jit import ONE, TWO, ZERO, Floats, Integers, compiled
from torchsphere.kernels.layout import RowMemory

#: Half the width of a blurred pixel in its standard deviations; width of its top, which it has not; and least height
#: of a footprint over that of its middle.
REACH, NO_TOP, LEAST_HEIGHT = 4.0, -1.0, 1e-5

#: Least share of the roots' variance that drawing them together leaves, and largest bend of the new roots by the old
#: ones in units of both standard deviations (docs/constants.toml).
LEAST_SQUARE, MOST_SKEW = 1e-4, 0.25

_HALF, _TINY, _LEAST, _THIN = (np.float32(v) for v in (0.5, 1e-6, 0.03, 1e-3))
_THREE, _SIX, _EIGHT, _TWELVE, _TWELFTH = (np.float32(v) for v in (3, 6, 8, 12, 1 / 12))
_REACH, _NO_TOP, _LEAST_HEIGHT = (np.float32(v) for v in (REACH, NO_TOP, LEAST_HEIGHT))
_LEAST_SQUARE, _MOST_SKEW = np.float32(LEAST_SQUARE), np.float32(MOST_SKEW)


class Rule(NamedTuple):
    """Where the limb of a sharp image begins, and the Gauss rules over its pixels.

    The first rule serves pixels at the limb; the second one those that show a longer arc of the surface. Between them,
    and before the limb, pixels have the rays of both, so that no level jumps as the ball moves.
    """

    limb_from: np.float32  # begin of the limb, radii
    limb_px: np.float32  # and px from the outline
    ramp_px: np.float32  # so far before it begin the rays of the limb
    outermost: np.float32  # distance of the outermost ray, radii
    short_arc_px: np.float32  # longest arc that the first rule alone serves
    long_arc_px: np.float32  # shortest arc that the second rule alone serves
    points: Floats  # points (2, k) of both rules, from -1 to 1
    shares: Floats  # their weights (2, k), 0 where a rule has fewer points
    counts: Integers  # (2,): numbers of points


@compiled
def footprint(x: Any, y: Any, distance: Any, blur: Any) -> tuple[Any, Any]:
    """Half the widths of a pixel, seen along the radius, at its foot and at its top; a blurred one has no top."""
    if blur > ZERO:
        return _REACH * np.sqrt(blur * blur + _TWELFTH), _NO_TOP
    a, b = abs(x) / distance, abs(y) / distance
    return _HALF * (a + b), _HALF * abs(a - b)


@compiled
def two_rays(radius: Any, blur: Any) -> tuple[Any, Any]:
    """How the two rays of a pixel before the limb are scaled apart and outwards."""
    variance = blur * blur + _TWELFTH
    return np.sqrt(variance) / radius, ONE + variance / (radius * radius)


@compiled
def begin_of_limb(radius: Any, blur: Any, rule: Rule) -> tuple[Any, Any]:
    """Distance from the centre, px, up to which two rays are enough, and the width of the ramp before it."""
    wider = np.sqrt(_TWELVE * (blur * blur + _TWELFTH))
    begin = rule.limb_from
    slope = begin / (np.sqrt(ONE - begin * begin) * wider)
    inner = slope / np.sqrt(ONE + slope * slope) * radius
    return min(inner, radius - rule.limb_px * wider), rule.ramp_px * wider


@compiled
def shares_of_rules(
    distance: Any, radius: Any, end: Any, half: Any, limb: tuple[Any, Any], rule: Rule
) -> tuple[Any, Any, Any]:
    """Shares of a pixel that its two rays and the rays of both rules have; ``limb`` is that of `begin_of_limb`."""
    at_limb = min(max(ONE - (limb[0] - distance) / limb[1], ZERO), ONE)
    if at_limb == ZERO:
        return ONE, ZERO, ZERO
    shallow, deep = limb_part(distance, end, half)
    # The arc of the surface is about the difference of the roots.
    arc = np.sqrt(TWO * radius) * (deep - shallow)
    longer = min(max((arc - rule.short_arc_px) / (rule.long_arc_px - rule.short_arc_px), ZERO), ONE)
    return ONE - at_limb, at_limb * (ONE - longer), at_limb * longer


@compiled
def end_of_disc(radius: Any, blur: Any) -> Any:
    """Distance from the centre at which the disc ends for a footprint with that blur: see `sphere_map.rays`."""
    return radius - (blur * blur + _TWELFTH) / (TWO * radius)


@compiled
def height_at(away: Any, half: Any, top: Any) -> Any:
    """Height of a pixel's footprint ``away`` from its middle, as a share of that in the middle."""
    if top < ZERO:
        far = _REACH * away / half
        height = np.exp(-_HALF * far * far)
    else:
        narrow = half - top
        height = (half - away) / (narrow if narrow > _THIN else _THIN)
    return _LEAST_HEIGHT if height < _LEAST_HEIGHT else ONE if height > ONE else height


@compiled
def rays_at_limb(
    distance: Any, end: Any, half: Any, top: Any, rule: Rule, number: int, roots: Floats, weights: Floats
) -> tuple[Any, Any, Any]:
    """Roots and weights of the rays of a pixel by the rule ``number``, before they are drawn together.

    The sum of the weights, the range of the roots, and the sum of the weights over the roots.
    """
    shallow, deep = limb_part(distance, end, half)
    whole, inverse = ZERO, ZERO
    for k in range(rule.counts[number]):
        root = shallow + (deep - shallow) * _HALF * (ONE + rule.points[number, k])
        height = rule.shares[number, k] * height_at(abs(end - root * root - distance), half, top)
        roots[k], weights[k] = root, root * height
        whole += root * height
        inverse += height
    return whole, deep - shallow, inverse


@compiled
def drawn_together(
    radius: Any, blur: Any, roots: Floats, weights: Floats, points: int, whole: Any
) -> tuple[Any, Any, Any, Any]:
    """Coefficients of the polynomial that draws roots towards their mean, and the mean: see `sphere_map.rays`."""
    middle, first, second, third = roots[points // 2], ZERO, ZERO, ZERO
    for k in range(points):
        off = roots[k] - middle
        by_weight = weights[k] * off
        first += by_weight
        second += by_weight * off
        third += by_weight * off * off
    first, second, third = first / whole, second / whole, third / whole
    mean, variance = middle + first, blur * blur + _TWELFTH
    spread = second - first * first
    third += first * (TWO * first * first - _THREE * second)
    spread = spread if spread > _TINY else _TINY
    square_cosine = ONE - mean * mean / (TWO * radius)
    left = max(ONE - variance * square_cosine / (TWO * radius * spread), _LEAST_SQUARE)
    share = np.sqrt(left)
    growth = mean / (TWO * radius * square_cosine)
    wanted = third + _THREE * growth * spread * spread * (ONE - left * left)
    b, most = (wanted - left * share * third) / (_SIX * left * spread * spread), _MOST_SKEW * share / np.sqrt(spread)
    b = min(max(b, -most), most)
    skew = b * third / spread
    a = np.sqrt(left - TWO * b * b * spread + skew * skew) - skew
    centre = mean * (ONE + variance / (_EIGHT * radius * radius))
    return centre - a * mean + b * (mean * mean - spread), a - TWO * b * mean, b, mean


@compiled
def limb_part(distance: Any, radius: Any, half: Any) -> tuple[Any, Any]:
    """Roots of the distances from the outline between which the disc covers a pixel: the nearer and the farther end."""
    near, far = distance - half, distance + half
    near = min(near, radius - _THIN)
    # No difference may round to less than nothing.
    return np.sqrt(max(radius - far, ZERO)), np.sqrt(max(radius - near, _THIN))


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
def row_of_rays(ball: Floats, rule: Rule, visibility: Floats, memory: RowMemory) -> int:
    """Put the rays of the pixels in a row, and the outline in each pixel, into the ``memory``; the number of rays."""
    outline, begins, rays = memory.outline, memory.begins, memory.rays
    radius, blur, wide = ball[layout.RADIUS], ball[layout.BLUR], ball[layout.FOOTPRINT_BLUR]
    limb, end, count = begin_of_limb(radius, wide, rule), end_of_disc(radius, wide), 0
    for column in range(len(visibility)):
        begins[column] = count
        if visibility[column] == ZERO:
            continue
        x, y = memory.across[column], memory.down[column]
        distance = np.sqrt(x * x + y * y)
        distance = distance if distance > _TINY else _TINY
        share, edge, spread = coverage(x, y, distance, radius, blur)
        # As `sphere_map.rays.bent`.
        steeper = ONE + ball[layout.EDGE_BEND] * (ONE - TWO * share)
        share, edge, spread = share + ball[layout.EDGE_BEND] * share * (ONE - share), steeper * edge, steeper * spread
        outline[column, layout.SHARE], outline[column, layout.EDGE] = share, edge
        outline[column, layout.SPREAD] = spread
        if share == ZERO and edge == ZERO:
            continue
        half, top = footprint(x, y, distance, wide)
        two, first, second = shares_of_rules(distance, radius, end, half, limb, rule)
        if two > ZERO:
            _put_two(rays, count, radius, wide, two)
            count += 2
        for number in range(2):
            part = first if number == 0 else second
            if part > ZERO:
                _put_limb(rays, count, distance, radius, wide, half, top, rule, number, part)
                count += rule.counts[number]
        for k in range(begins[column], count):
            rays[layout.PIXEL_X, k], rays[layout.PIXEL_Y, k] = x, y
    begins[len(visibility)] = count
    return count


@compiled
def _put_two(rays: Floats, count: int, radius: Any, blur: Any, share: Any) -> None:
    """The two rays of a pixel before the limb, of which they have a ``share``."""
    apart, out = two_rays(radius, blur)
    for k in range(2):
        nearer = ONE - apart if k == 0 else ONE + apart
        at = count + k
        rays[layout.SCALE, at], rays[layout.STRETCH, at] = out * nearer, ZERO
        rays[layout.WEIGHT, at], rays[layout.GAINED, at] = _HALF * share, ZERO
        rays[layout.BY_SIZE, at] = (TWO * (ONE - out) * nearer - out * (nearer - ONE)) / radius


@compiled
def _put_limb(
    rays: Floats,
    count: int,
    distance: Any,
    radius: Any,
    blur: Any,
    half: Any,
    top: Any,
    rule: Rule,
    number: int,
    share: Any,
) -> None:
    """The rays of a pixel at the limb by the rule ``number``, of which they have a ``share``."""
    points, end = rule.counts[number], end_of_disc(radius, blur)
    roots, weights = rays[layout.ROOT, count:], rays[layout.WEIGHT, count:]
    whole, span, of_mean = rays_at_limb(distance, end, half, top, rule, number, roots, weights)
    c0, c1, c2, mean = drawn_together(radius, blur, roots, weights, points, whole)
    outermost, beyond, outside = rule.outermost * radius, radius / end, ZERO
    if distance + half > end:
        outside = height_at(abs(end - distance), half, top) / (whole * span)
    of_mean = of_mean / whole + TWO * outside * (roots[0] - mean)
    for k in range(points):
        at, root = count + k, roots[k]
        moved, slope = c0 + root * (c1 + root * c2), c1 + TWO * c2 * root
        of_distance = moved * (slope / root + (ONE - slope) * of_mean)
        place, of_size = beyond * (end - moved * moved), (ONE - of_distance) / distance
        of_distance *= beyond
        if place > outermost:
            place, of_distance, of_size = outermost, ZERO, rule.outermost / distance
        scale, weight = place / distance, weights[k] / whole
        rays[layout.SCALE, at], rays[layout.BY_SIZE, at] = scale, of_size
        rays[layout.STRETCH, at] = (of_distance - scale) / (distance * distance)
        rays[layout.WEIGHT, at] = share * weight
        # The outline gives or takes what lies there: the first ray is the one nearest to it.
        rays[layout.GAINED, at] = share * outside * ((ONE if k == 0 else ZERO) - weight)
