"""What the experiments share: their folders, the cache between runs, the style of figures, and tables of results.

An experiment has ``compute()``, which measures and caches, ``plot(found)``, which only draws, and ``main()``, which
joins both. Those of the paper also have ``rows(found)``, a list of `Row`; `experiments.paper.all` joins these in
RESULTS.md.
"""

from __future__ import annotations

import hashlib
import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import torchsphere as ts

Array = NDArray[np.float64]

HERE = Path(__file__).parent
#: Measured values and rendered shots; figures of RESULTS.md; figures that no page shows; the pages; their tables.
CACHE, FIGURES, OUTPUT, DOCS = HERE / "cache", HERE / "figures", HERE / "output", HERE.parent / "docs"
TABLES = DOCS / "tables"

#: Factors that turn an increment (dx, dy, wx, wy, wz) in px and rad into px and deg.
PX_DEG = np.array([1, 1, *3 * [180 / math.pi]])

#: Colours that colour-blind readers tell apart (Okabe and Ito), and the style of all figures.
BLUE, VERMILION, GREEN, ORANGE, SKY, PINK = "#0072B2", "#D55E00", "#009E73", "#E69F00", "#56B4E9", "#CC79A7"
YELLOW = "#F0E442"
STYLE = {"axes.grid": True, "grid.alpha": 0.3, "legend.fontsize": 8}


#: Verdict on a row that is a remark.
OTHER_CONDITION = "not the paper's condition"


@dataclass(frozen=True)
class Row:
    """The result of one experiment for one claim."""

    experiment: str  #: name of the module: "fig02", "table1"
    claim: str  #: of the paper, in one sentence
    paper: str  #: numbers with their units, or a few words
    ours: str
    holds: bool | None  #: whether our numbers confirm the claim; None where they lie too close to the limit to say
    #: In which way this row is not the paper's condition, in a few words: it is then a remark, and neither yes nor no.
    other_condition: str = ""
    reason: str = ""  #: of a claim that does not hold, in one sentence

    @property
    def verdict(self) -> str:
        """The word for it: "yes", "no", "undecided" or "not the paper's condition"."""
        if self.other_condition:
            return OTHER_CONDITION
        return "undecided" if self.holds is None else "yes" if self.holds else "no"


def key_of(kind: str, settings: Any) -> str:
    """Name of a file in the cache, by settings that JSON can hold and the version of torchsphere."""
    text = json.dumps([kind, settings, ts.__version__], sort_keys=True)
    return f"{kind}-{hashlib.sha256(text.encode()).hexdigest()[:16]}"


def cached(name: str, settings: Any, measure: Callable[[], Any]) -> Any:
    """The result of ``measure``, from the cache if the same settings and version were measured before."""
    path = CACHE / f"{key_of(name, settings)}.json"
    if not path.exists():
        print(f"measuring {name} {json.dumps(settings)}", file=sys.stderr, flush=True)
        found = measure()
        CACHE.mkdir(exist_ok=True)
        path.write_text(json.dumps(found))
    return json.loads(path.read_text())


@contextmanager
def saved_figure(path: Path, size: tuple[float, float], dpi: int = 100) -> Iterator[Figure]:
    """A figure of that size in inches, in the common style; saved as ``path`` at the end."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=size, layout="constrained")
        yield figure
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=dpi)


def table(head: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    """A Markdown table; a bar or a line break within a cell does not end the cell."""
    cells = ([" ".join(str(cell).replace("|", "\\|").split()) for cell in row] for row in rows)
    lines = (head, ["---"] * len(head), *cells)
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def claims(rows: Iterable[Row]) -> str:
    """Rows as a Markdown table."""
    cells = ((row.experiment, row.claim, row.paper, row.ours, _verdict(row)) for row in rows)
    return table(("experiment", "claim", "paper", "ours", "holds"), cells)


def _verdict(row: Row) -> str:
    word = row.verdict if row.verdict == "yes" else f"**{row.verdict}**"
    explained = row.other_condition or row.reason
    return f"{word}: {explained}" if explained else word


def decided(value: float, limit: float, margin: float) -> bool | None:
    """Whether a value exceeds a limit; None within the relative ``margin`` of it, where another machine may differ."""
    return None if abs(value / limit - 1) < margin else value > limit


def publish(name: str, module: str, *parts: str) -> None:
    """Write ``docs/tables/<name>.md``, which the pages include, with the command that measures it; and print it."""
    text = "\n".join((f"*Measured by `python -m experiments.{module}`.*\n", *parts))
    TABLES.mkdir(exist_ok=True)
    (TABLES / f"{name}.md").write_text(text, encoding="utf-8")
    print(text)
