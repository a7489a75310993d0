"""The image of a preview: the circle that was found and other candidates, or a grid to read a circle off."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from torchsphere.geometry.circle import Circle
from torchsphere.report.figure_style import COLOURS, new_figure
from torchsphere.report.image_figures import round_below

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Dots per inch of a preview, which is looked at on a screen.
DPI = 120

#: Number of lines of a grid along the longer side, least number along the other, and their colour.
GRID_LINES, LEAST_LINES, GRID = 16, 4, "#56B4E9"


def _number(axis: Any, number: int, x: float, y: float, colour: str) -> None:
    """Write a number at (x, y) on a white disc, to be read on any texture."""
    disc = {"boxstyle": "circle", "facecolor": "white", "edgecolor": colour, "alpha": 0.85}
    axis.text(x, y, str(number), color=colour, ha="center", va="center", fontsize=12, fontweight="bold", bbox=disc)


def preview_figure(path: Path, image: NDArray[np.float32], circle: Circle, title: str) -> None:
    """Write a PNG of the image with its circle and all others that may be the ball; a circle in doubt has a grid."""
    figure, axis = _drawn(image, title)
    angle = np.linspace(0, 2 * np.pi, 361)
    x, y = circle.x + circle.radius * np.cos(angle), circle.y + circle.radius * np.sin(angle)
    axis.plot(x, y, color=COLOURS[1], lw=1.2)
    axis.plot(circle.x, circle.y, "+", color=COLOURS[1], ms=12)
    for number, (u, v, radius) in enumerate(circle.others, 2):
        axis.plot(u + radius * np.cos(angle), v + radius * np.sin(angle), color=COLOURS[2], lw=1.2, ls="--")
        _number(axis, number, u, v, COLOURS[2])
    if circle.doubt:
        # The right circle may have to be read off.
        _grid(axis, image.shape)
    if circle.others:
        _number(axis, 1, circle.x, circle.y, COLOURS[1])
    figure.savefig(path)


def grid_figure(path: Path, image: NDArray[np.float32], title: str) -> None:
    """Write a PNG of the image with a grid of pixels, to read a circle off it."""
    figure, axis = _drawn(image, title)
    _grid(axis, image.shape)
    figure.savefig(path)


def _grid(axis: Axes, shape: tuple[int, ...]) -> None:
    """Lines at even pixels; every second one has its number."""
    for along, size in ((axis.xaxis, shape[1]), (axis.yaxis, shape[0])):
        step = round_below(max(min(max(shape) / GRID_LINES, size / LEAST_LINES), 1.0))
        along.set_ticks(np.arange(0, size, 2 * step))
        along.set_ticks(np.arange(0, size, step), minor=True)
    axis.tick_params(axis="x", labelrotation=90)
    # Images are grey, so that a colour is seen on all of them.
    axis.grid(True, which="major", color=GRID, lw=0.9, alpha=0.9)
    axis.grid(True, which="minor", color=GRID, lw=0.6, alpha=0.6)


def _drawn(image: NDArray[np.float32], title: str) -> tuple[Figure, Axes]:
    """A figure of the image, h x w px, at the right size for a screen."""
    height, width = image.shape
    # A long strip of an image needs a figure that is not a line.
    figure = new_figure(figsize=(8.0, min(max(8.0 * height / width, 1.5), 16.0) + 0.9), dpi=DPI)
    axis = figure.subplots()
    low, high = np.percentile(image, (0.5, 99.5))
    axis.imshow(image, cmap="gray", vmin=low, vmax=max(high, low + 1e-6))
    axis.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="x (px)", ylabel="y (px)")
    axis.set_title(title, fontsize=9)
    return figure, axis
