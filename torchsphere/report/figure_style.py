"""Figures with matplotlib, which is imported only when one is drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
