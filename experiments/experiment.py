"""What the experiments share: their folders, what they keep between runs, and the rows of their results.

Every experiment of the paper has a function ``rows() -> list[Row]``; `experiments.paper.all` joins these in RESULTS.md.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torchsphere as ts

HERE = Path(__file__).parent
#: Measured values and rendered shots; figures of the paper in RESULTS.md; figures that no page shows; the pages.
CACHE, FIGURES, OUTPUT, DOCS = HERE / "cache", HERE / "figures", HERE / "output", HERE.parent / "docs"


@dataclass(frozen=True)
class Row:
    """What one experiment says about one claim."""

    experiment: str  #: name of the module: "fig02", "table1"
    claim: str  #: what the paper says, in one sentence
    paper: str  #: numbers with their units, or a few words
    ours: str
    holds: bool  #: whether ours confirms the claim


def cached(name: str, settings: Any, measure: Callable[[], Any]) -> Any:
    """What ``measure`` returns, from the cache if it was measured with the same settings and version before."""
    key = json.dumps([name, settings, ts.__version__], sort_keys=True)
    path = CACHE / f"{name}-{hashlib.sha256(key.encode()).hexdigest()[:16]}.json"
    if not path.exists():
        print(f"measuring {key}", file=sys.stderr, flush=True)
        found = measure()
        CACHE.mkdir(exist_ok=True)
        path.write_text(json.dumps(found))
    return json.loads(path.read_text())
