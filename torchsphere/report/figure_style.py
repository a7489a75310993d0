"""The style that all figures share; matplotlib is imported when the first figure is made."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Blue, vermilion and green of Okabe and Ito, which colour-blind readers can tell apart, and a line style for each.
COLOURS = ("#0072B2", "#D55E00", "#009E73")
STYLES = ("-", "--", "-.")

#: Colour of each status, from the same palette.
STATUS_COLOURS = {
    "ok": "#009E73",
    "weak_texture": "#56B4E9",
    "low_correlation": "#E69F00",
    "not_converged": "#CC79A7",
    "out_of_frame": "#999999",
    "lost": "#D55E00",
}

#: Colours of the contact and of frames that were not measured.
CONTACT, MISSING = "#F0E442", "0.87"

#: Style of a legend above its axes.
LEGEND: dict[str, Any] = {"fontsize": 8, "frameon": False, "borderaxespad": 0.1}

#: Dots per inch of a PNG, as journals ask for; the PDF beside it has no pixels.
DPI = 300


def new_figure(**settings: Any) -> Figure:
    """A figure without a window, whatever backend the user has set; ``settings`` go to matplotlib's Figure."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(**{"layout": "constrained"} | settings)
    FigureCanvasAgg(figure)
    return figure
