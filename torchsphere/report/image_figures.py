"""Figures of images: path of the ball, residual maps, a thumbnail of a result, a preview of the circle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.recording.frame_range import spread
from torchsphere.report.figure_style import COLOURS, CONTACT, DPI, LEGEND, new_figure
from torchsphere.results.reader import ResultFolder
from torchsphere.results.sampled_frames import Sampled, encode_webp
from torchsphere.runtime.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


#: Most circles along the path, as in figure 8 of the paper, and least path between two circles, radii: closer circles
#: hide the image.
MAX_CIRCLES, LEAST_SPACING = 12, 0.2

#: Largest width and height of the image of the path, least width of its figure, and margins around the image, inches.
MAX_WIDTH, MAX_HEIGHT, LEAST_WIDTH = 6.2, 6.0, 5.0
LEFT, RIGHT, TOP, BOTTOM = 0.65, 0.15, 0.62, 0.5

#: Colours of start and end; their marks differ in shape, too.
START, END = "#56B4E9", "#F0F0F0"

#: Positions of the arrows that show the direction, shares of the path's length, and their style.
ARROWS_AT = (0.25, 0.75)
ARROW = {"arrowstyle": "-|>", "fc": COLOURS[0], "ec": "white", "mutation_scale": 16}

#: Longest scale bar, and its distance from the edges, shares of the image's width.
BAR_SHARE, BAR_MARGIN = 0.25, 0.04

#: Limit of the colours of residual maps, robust standard deviations of the residuals.
COLOURS_END = 5.0

#: Longest side of a thumbnail, px.
THUMBNAIL_PX = 160

Rows = NDArray[np.int64]


def path_figure(result: ResultFolder) -> Figure:
    """Path, start, end, contact and direction over the image in the middle of the path, with circles at even times.

    Figures 8 and 15 of the paper. Raises ValueError if the result keeps no images.
    """
    sampled = kept_images(result)
    known = np.flatnonzero(result.known)
    middle = int(known[len(known) // 2]) if len(known) else 0
    i = int(np.abs(sampled.row - middle).argmin())
    left, top, width, height = sampled.box
    title = f"Path of the ball over frame {result.frame[sampled.row[i]]}"
    lost = "" if len(known) else "; the place of the ball was not measured"
    figure, axis = _layout(width / height, title + lost)
    image = np.asarray(sampled.image(i).convert("L"))
    extent = (left, left + width, top + height, top)
    axis.imshow(image, cmap="gray", vmin=0, vmax=255, extent=extent, aspect="auto")
    axis.set(xlim=(left, left + width), ylim=(top + height, top))
    if len(known):
        _circles(axis, result, *_even_rows(result, known))
        _path(axis, result, known)
        _scale_bar(axis, result)
        spacing = {"borderpad": 0.2, "handlelength": 1.6, "columnspacing": 1.2}
        axis.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=5, **spacing, **LEGEND)
    return figure


def _layout(aspect: float, title: str) -> tuple[Figure, Axes]:
    """A figure with axes for an image of this ``aspect``, width over height."""
    width, height = min(MAX_WIDTH, MAX_HEIGHT * aspect), min(MAX_HEIGHT, MAX_WIDTH / aspect)
    whole_width, whole_height = max(width + LEFT + RIGHT, LEAST_WIDTH), height + TOP + BOTTOM
    figure = new_figure(figsize=(whole_width, whole_height), dpi=DPI, layout=None)
    box = (LEFT / whole_width, BOTTOM / whole_height, width / whole_width, height / whole_height)
    axis = figure.add_axes(box)
    axis.set_xlabel("x (px)", fontsize=9)
    axis.set_ylabel("y (px)", fontsize=9)
    axis.tick_params(labelsize=9)
    figure.text(LEFT / whole_width, 1 - 0.1 / whole_height, title, fontsize=10, va="top")
    return figure, axis


def _even_rows(result: ResultFolder, known: Rows) -> tuple[Rows, int]:
    """Known rows at even times, and the frames from one to the next."""
    steps = np.diff(result.position[known], axis=0)
    length = float(np.hypot(*steps.T).sum()) / float(np.nanmedian(result.radius))
    count = min(MAX_CIRCLES, max(2, int(length / LEAST_SPACING)))
    stride = max(int(known[-1] - known[0]) // (count - 1), 1)
    return np.intersect1d(np.arange(known[0], known[-1] + 1, stride), known), stride


def _circles(axis: Axes, result: ResultFolder, rows: Rows, stride: int) -> None:
    from matplotlib.collections import LineCollection

    rate = result.summary.get("frame_rate")
    every = f"{stride} frame{'s' if stride > 1 else ''}" if rate is None else f"{1e3 * stride / rate:.3g} ms"
    label = f"ball every {every}" if len(rows) > 1 else "ball"
    angle = np.linspace(0, 2 * np.pi, 121)
    unit = np.stack((np.cos(angle), np.sin(angle)), 1)
    outlines = result.position[rows, None] + result.radius[rows, None, None] * unit
    axis.add_collection(LineCollection(list(outlines), colors=COLOURS[1], lw=1.0, label=label))
    axis.plot(*result.position[rows].T, "+", color=COLOURS[1], ms=7, mew=1.3, zorder=2.5)


def _path(axis: Axes, result: ResultFolder, known: Rows) -> None:
    path = result.position
    axis.plot(*path.T, "-", color="white", lw=2.6, alpha=0.7)
    contact = _contact_path(result)
    if len(contact):
        axis.plot(*contact.T, "-", color=CONTACT, lw=5, alpha=0.8, label="contact")
    axis.plot(*path.T, "-", color=COLOURS[0], lw=1.3, label="path")
    _arrows(axis, path[known], float(np.nanmedian(result.radius)))
    for name, row, mark, colour in (("start", known[0], "o", START), ("end", known[-1], "s", END)):
        axis.plot(*path[row], mark, color=colour, mec="black", mew=1.0, ms=7, ls="none", label=name)


def _contact_path(result: ResultFolder) -> Array:
    """The path (m, 2) in contact; its start and end are interpolated between frames."""
    if result.contact_s is None:
        return np.zeros((0, 2))
    time, (start, end) = result.time_s, result.contact_s
    moments = np.concatenate(([start], time[(time > start) & (time < end)], [end]))
    return np.stack([np.interp(moments, time, column) for column in result.position.T], 1)


def _arrows(axis: Axes, path: Array, radius: float) -> None:
    """Arrow heads along the path; none on a path shorter than half a radius, which has no clear direction."""
    length = np.concatenate(([0.0], np.hypot(*np.diff(path, axis=0).T).cumsum()))
    if length[-1] < 0.5 * radius:
        return
    for share in ARROWS_AT:
        tip = share * length[-1]
        (x0, x), (y0, y) = (np.interp((tip - 0.05 * radius, tip), length, column) for column in path.T)
        axis.annotate("", (x, y), (x0, y0), arrowprops=ARROW)


def _scale_bar(axis: Axes, result: ResultFolder) -> None:
    """A bar of a round length, in the lower corner that is farther from the path; none without a scale."""
    scale = result.summary.get("scale")
    if not scale:
        return
    (left, right), (bottom, top) = axis.get_xlim(), axis.get_ylim()
    mm_per_px = 1e3 * scale["m_per_px"]
    length_mm = round_below(BAR_SHARE * (right - left) * mm_per_px)
    length, margin = length_mm / mm_per_px, BAR_MARGIN * (right - left)
    corners = {x: np.array([x + length / 2, bottom]) for x in (left + margin, right - margin - length)}
    x = max(corners, key=lambda x: float(np.nanmin(np.hypot(*(result.position - corners[x]).T))))
    y = bottom - 0.05 * (bottom - top)
    axis.plot((x, x + length), (y, y), color="black", lw=5, solid_capstyle="butt")
    axis.plot((x, x + length), (y, y), color="white", lw=3, solid_capstyle="butt")
    style = {"facecolor": "black", "alpha": 0.6, "lw": 0, "pad": 1.5}
    place: dict[str, Any] = {"xytext": (0, 5), "textcoords": "offset points", "ha": "center"}
    axis.annotate(f"{length_mm:g} mm", (x + length / 2, y), **place, fontsize=8, color="white", bbox=style)


def round_below(length: float) -> float:
    """The largest length of at most ``length`` that is 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(length))
    return max(m * power for m in (1, 2, 5) if m * power <= length * (1 + 1e-9))


def residual_figure(result: ResultFolder) -> Figure:
    """Residual maps at the start, at the worst match and at the end: image minus the moved image before it."""
    sampled = kept_images(result)
    with_map = np.flatnonzero(sampled.has_residual)
    figure = new_figure(figsize=(7.0, 3.0), dpi=DPI, layout=None)
    if len(with_map) == 0:
        figure.text(0.5, 0.5, "No residual map: the motion was measured in no frame.", ha="center", fontsize=10)
        return figure
    limit = residual_limit(sampled)
    worst = with_map[np.nan_to_num(result.zncc[sampled.row[with_map]], nan=np.inf).argmin()]
    axes = figure.subplots(1, 3, sharey=True)
    figure.subplots_adjust(0.08, 0.12, 0.88, 0.9, wspace=0.08)
    half = 0.5 * sampled.residual.shape[-1] * sampled.residual_bin
    extent = (-half, half, half, -half)
    shown: Any = None
    for axis, i, name in zip(axes, (with_map[0], worst, with_map[-1]), ("start", "worst match", "end"), strict=True):
        shown = axis.imshow(sampled.residual_levels(i), cmap="RdBu_r", vmin=-limit, vmax=limit, extent=extent)
        row = sampled.row[i]
        axis.set_title(f"{name}: frame {result.frame[row]}\nZNCC {result.zncc[row]:.5f}", fontsize=8, y=1.0)
        axis.set_xlabel("x from the centre (px)", fontsize=8)
        # With a fixed position matplotlib need not measure all labels.
        axis.xaxis.set_label_coords(0.5, -0.14)
        axis.tick_params(labelsize=8)
    for axis in axes[1:]:
        axis.yaxis.set_visible(False)
    axes[0].set_ylabel("y from the centre (px)", fontsize=8)
    bar = figure.colorbar(shown, cax=figure.add_axes((0.905, 0.2, 0.018, 0.62)))
    bar.set_label("residual (grey levels)", fontsize=8)
    bar.ax.tick_params(labelsize=8)
    return figure


def residual_limit(sampled: Sampled) -> float:
    """Limit of the colours of all maps, grey levels, within the range of the maps."""
    with_map = np.flatnonzero(sampled.has_residual)
    if len(with_map) == 0:
        return 127 * sampled.residual_step
    few = spread(with_map, 20)
    sizes = np.abs(np.concatenate([sampled.residual_levels(i).ravel() for i in few]))
    # The standard deviation of Gaussian noise is 1.4826 times its median absolute value.
    robust = 1.4826 * float(np.nanmedian(sizes))
    return float(np.clip(COLOURS_END * robust, 4 * sampled.residual_step, 127 * sampled.residual_step))


def thumbnail(result: ResultFolder) -> bytes:
    """A small WebP of the first frame in which the ball is known, with its circle; else of the first frame."""
    from PIL import ImageDraw

    sampled = kept_images(result)
    known = result.known[sampled.row]
    i = int(known.argmax())
    image = sampled.image(i).convert("RGB")
    image.thumbnail((THUMBNAIL_PX, THUMBNAIL_PX))
    if known.any():
        scale = image.width / sampled.box[2]
        (x, y), r = result.position[sampled.row[i]], result.radius[sampled.row[i]]
        corners = [scale * v for v in (x - r - sampled.box[0], y - r - sampled.box[1])]
        ImageDraw.Draw(image).ellipse((*corners, *(v + 2 * r * scale for v in corners)), outline=COLOURS[1], width=2)
    return encode_webp(image, quality=60)


def kept_images(result: ResultFolder) -> Sampled:
    """The images that a result keeps; raises ValueError if there are none."""
    if result.sampled is None:
        raise ValueError(
            f"{result.path}: the result keeps no images, as it was made without a report; make it again with one"
        )
    return result.sampled
