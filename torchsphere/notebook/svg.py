"""Small drawings in SVG for a notebook, in the colours of its text, so that they suit a light and a dark one."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torchsphere.correlation.frame_status import STATUSES
from torchsphere.recording.frame_range import spread
from torchsphere.report.figure_style import STATUS_COLOURS

Array = NDArray[np.float64]

#: Blue, vermilion and green as in the figures of the report, in tones for a white and for a black ground.
COLOURS = ("#1f8fd6", "#e0692a", "#12a67c")

#: Size of a chart and its margins, px.
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 330, 120, 46, 8, 18, 18

#: Most points of a curve, and of the stripes of a status strip.
MOST_POINTS = 300

_QUIET = 'stroke="currentColor" stroke-opacity="0.35" fill="none"'


@dataclass(frozen=True)
class Curve:
    """Values (n,) and their standard deviations, with a name."""

    name: str
    values: Array
    sd: Array


def drawing(width: float, height: float, label: str, parts: Sequence[str]) -> str:
    """An SVG of this size with its description."""
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}" height="{height:g}" '
        f'viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{html.escape(label)}" '
        f'style="max-width:100%;color:inherit" font-family="sans-serif" font-size="10">{"".join(parts)}</svg>'
    )


def text(x: float, y: float, words: str, anchor: str = "start", colour: str = "currentColor") -> str:
    """Words at a place; "start", "middle" or "end" of them."""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{colour}">{html.escape(words)}</text>'


def chart(
    title: str, x: Array, curves: Sequence[Curve], x_label: str, shaded: tuple[float, float] | None = None
) -> str:
    """Curves with bands of two standard deviations over ``x``, and a span of it ``shaded``."""
    rows = spread(np.arange(len(x)), MOST_POINTS)
    known = [curve for curve in curves if np.isfinite(curve.values).any()]
    if not known or len(x) < 2:
        return ""
    low, high = _limits(known)
    first, last = float(x[0]), float(x[-1])

    def across(values: Array | float) -> Array:
        return LEFT + (np.asarray(values) - first) / (last - first) * (WIDTH - LEFT - RIGHT)

    def up(values: Array | float) -> Array:
        return HEIGHT - BOTTOM - (np.asarray(values) - low) / (high - low) * (HEIGHT - TOP - BOTTOM)

    parts = [f'<rect x="{LEFT}" y="{TOP}" width="{WIDTH - LEFT - RIGHT}" height="{HEIGHT - TOP - BOTTOM}" {_QUIET}/>']
    if shaded is not None:
        left, right = (float(v) for v in np.clip(across(np.array(shaded)), LEFT, WIDTH - RIGHT))
        size = f'width="{max(right - left, 1):.1f}" height="{HEIGHT - TOP - BOTTOM}"'
        parts.append(f'<rect x="{left:.1f}" y="{TOP}" {size} fill="#F0E442" fill-opacity="0.28"/>')
    for k, curve in enumerate(known):
        parts += _curve(across(x[rows]), curve.values[rows], curve.sd[rows], up, (low, high), COLOURS[k % 3])
    parts += [text(LEFT - 4, float(up(v)) + 3, f"{v:.3g}", "end") for v in _ticks(low, high)]
    parts += [text(LEFT, HEIGHT - 5, f"{first:.4g}"), text(WIDTH - RIGHT, HEIGHT - 5, f"{last:.4g}", "end")]
    parts.append(text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 5, x_label, "middle"))
    parts.append(text(LEFT, 12, title))
    for k, curve in enumerate(reversed(known)):
        colour = COLOURS[(len(known) - 1 - k) % 3]
        parts.append(text(WIDTH - RIGHT - 14 * k, 12, curve.name, "end", colour))
    return drawing(WIDTH, HEIGHT, title, parts)


def _limits(curves: Sequence[Curve]) -> tuple[float, float]:
    """Limits of the values with their bands; the bands add at most the span of the values on each side."""
    low, high = (float(f([f(curve.values) for curve in curves])) for f in (np.nanmin, np.nanmax))
    span = (high - low) or abs(high) or 1.0
    widest = max(2 * float(np.nanmax(np.nan_to_num(curve.sd), initial=0.0)) for curve in curves)
    spare = min(widest, span) + 0.06 * span
    return low - spare, high + spare


def _ticks(low: float, high: float) -> list[float]:
    """Two to five round numbers within the limits."""
    rough = (high - low) / 3
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= rough)
    return [k * step for k in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _curve(x: Array, values: Array, sd: Array, up: object, limits: tuple[float, float], colour: str) -> list[str]:
    """The band and the line of each run of known values."""
    assert callable(up)
    known = np.flatnonzero(np.isfinite(values))
    parts = []
    for run in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1) if len(known) else ():
        reach = 2 * np.nan_to_num(sd[run])
        edges = [up(np.clip(values[run] + sign * reach, *limits)) for sign in (1, -1)]
        outline = [*zip(x[run], edges[0], strict=True), *zip(x[run][::-1], edges[1][::-1], strict=True)]
        parts.append(f'<polygon points="{_points(outline)}" fill="{colour}" fill-opacity="0.25"/>')
        line = zip(x[run], up(values[run]), strict=True)
        parts.append(f'<polyline points="{_points(line)}" fill="none" stroke="{colour}" stroke-width="1.3"/>')
    return parts


def _points(pairs: object) -> str:
    return " ".join(f"{float(a):.1f},{float(b):.1f}" for a, b in pairs)  # type: ignore[attr-defined]


def path(position: Array, radius: float, title: str) -> str:
    """The path of a ball's centre (n, 2), px, with its outline at the start and at the end."""
    known = position[np.isfinite(position[:, 0])]
    if not len(known):
        return ""
    low, high = known.min(0) - 1.15 * radius, known.max(0) + 1.15 * radius
    scale = min(WIDTH / (high[0] - low[0]), 170 / (high[1] - low[1]))
    width, height = (high - low) * scale
    places = (known - low) * scale
    points = _points(spread(places, MOST_POINTS))
    line = f'<polyline points="{points}" fill="none" stroke="{COLOURS[0]}" stroke-width="1.6"/>'
    rings = [
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius * scale:.1f}" fill="{colour}" fill-opacity="0.15" '
        f'stroke="{colour}"/>'
        for (x, y), colour in ((places[0], COLOURS[2]), (places[-1], COLOURS[1]))
    ]
    below = 0.6 * radius * scale
    words = [
        text(float(x), float(y) + below, name, "middle", colour)
        for (x, y), name, colour in ((places[0], "start", COLOURS[2]), (places[-1], "end", COLOURS[1]))
    ]
    return drawing(width, height, title, [*rings, line, *words])


def strip(status: NDArray[np.str_]) -> str:
    """A strip with the status of every frame."""
    n, height = len(status), 10
    codes = np.array([STATUSES.index(name) for name in status])
    starts = np.flatnonzero(np.diff(codes, prepend=-1))
    ends = [*starts[1:], n]
    parts = [
        f'<rect x="{start * WIDTH / n:.2f}" y="0" width="{(end - start) * WIDTH / n:.2f}" height="{height}" '
        f'fill="{STATUS_COLOURS[STATUSES[codes[start]]]}"><title>{html.escape(STATUSES[codes[start]])}</title></rect>'
        for start, end in zip(starts, ends, strict=True)
    ]
    return drawing(WIDTH, height, "status of every frame", parts[:MOST_POINTS])
