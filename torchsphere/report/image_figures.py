"""Figures of images: residual maps, a thumbnail of a result, a preview of the circle that was found."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.report.figure_style import COLOURS, DPI, new_figure
from torchsphere.results.reader import ResultFolder
from torchsphere.results.sampled_frames import Sampled, encode_webp

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from torchsphere.geometry.circle import Circle

#: Robust standard deviations of the residuals at which the colours of their maps end.
COLOURS_END = 5.0

#: Longest side of a thumbnail, px.
THUMBNAIL_PX = 160


def residual_figure(result: ResultFolder) -> Figure:
    """Residual maps at the start, at the worst match and at the end.

    A residual map is the image minus the image before it, moved with the ball.
    """
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
        # A fixed position spares matplotlib the measuring of all labels.
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
    """Residual at which the colours of all maps end, grey levels: `COLOURS_END`, within the range of the maps."""
    with_map = np.flatnonzero(sampled.has_residual)
    if len(with_map) == 0:
        return 127 * sampled.residual_step
    few = with_map[np.unique(np.linspace(0, len(with_map) - 1, 20).round().astype(int))]
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
    """The images that a result keeps.

    Raises
    ------
    ValueError
        If the result keeps none.
    """
    if result.sampled is None:
        raise ValueError(f"{result.path}: the result keeps no images; track again without --no-report")
    return result.sampled


def preview_figure(path: Path, image: NDArray[np.float32], circle: Circle, title: str) -> None:
    """Write a PNG of the image with its circle; the title has the numbers of the circle for ``--circle``."""
    height, width = image.shape
    figure = new_figure(figsize=(8.0, 8.0 * height / width + 0.9), dpi=120)
    axis = figure.subplots()
    low, high = np.percentile(image, (0.5, 99.5))
    axis.imshow(image, cmap="gray", vmin=low, vmax=max(high, low + 1e-6))
    angle = np.linspace(0, 2 * np.pi, 361)
    x, y = circle.x + circle.radius * np.cos(angle), circle.y + circle.radius * np.sin(angle)
    axis.plot(x, y, color=COLOURS[1], lw=1.2)
    axis.plot(circle.x, circle.y, "+", color=COLOURS[1], ms=12)
    axis.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="x (px)", ylabel="y (px)")
    axis.set_title(title, fontsize=9)
    figure.savefig(path)
