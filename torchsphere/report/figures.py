"""Figures with matplotlib, which is imported only when one is drawn."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from torchsphere.geometry.circle import Circle

#: Blue, vermilion, green of Okabe and Ito, which colour-blind readers tell apart; also by line style.
COLOURS = ("#0072B2", "#D55E00", "#009E73")
STYLES = ("-", "--", "-.")

#: Dots per inch of a PNG, which is for screens; the PDF beside it is for print.
DPI = 120


def new_figure(**settings: Any) -> Figure:
    """A figure without a window, whatever the user's matplotlib is set to; ``settings`` as matplotlib's Figure."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(**{"layout": "constrained"} | settings)
    FigureCanvasAgg(figure)
    return figure


def preview_figure(path: Path, image: NDArray[np.float32], circle: Circle, title: str) -> None:
    """The image with the circle drawn on it and its numbers, ready to paste into ``--circle``, as PNG."""
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
