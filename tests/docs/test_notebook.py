"""The notebook docs/tutorial.ipynb: its cells run in order, and print what stands below them.

The cells are run here one after the other in one namespace, without a Jupyter kernel. After a change of the notebook,
run it in Jupyter ("restart and run all") and save it, so that its outputs are those of its cells.
"""

import contextlib
import io
import json
import re
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

NOTEBOOK = Path(__file__).resolve().parents[2] / "docs" / "tutorial.ipynb"


def cells() -> list[dict[str, Any]]:
    return json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]


def shape(text: str) -> list[str]:
    """Lines without their numbers and blanks: the last digits differ between machines."""
    return [re.sub(r"[\s\d.+-]+|e(?=[+-])", " ", line).strip() for line in text.splitlines()]


def test_every_cell_runs_and_prints_what_stands_below_it(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pandas", reason="pandas is not installed (extra 'dev')")
    drawn: list[int] = []
    monkeypatch.setattr(plt, "show", lambda: (drawn.extend(plt.get_fignums()), plt.close("all")))
    names: dict[str, Any] = {}
    with mpl.rc_context({"backend": "agg"}):
        for cell in cells():
            if cell["cell_type"] != "code":
                continue
            printed, before = io.StringIO(), len(drawn)
            with contextlib.redirect_stdout(printed):
                exec(compile("".join(cell["source"]), cell["id"], "exec"), names)
            kept = "".join("".join(output.get("text", ())) for output in cell["outputs"])
            assert shape(printed.getvalue()) == shape(kept), cell["id"]
            pictures = sum("image/png" in output.get("data", ()) for output in cell["outputs"])
            assert len(drawn) - before == pictures, cell["id"]
    # The impact of the synthetic shot, whose force peaks at 54 kN (110 g, 0.375 mm/px, half a sine over 12 frames).
    for name, true in names["demo_shot"].true_impact().items():
        estimate = getattr(names["impact"], name)
        assert (np.abs(estimate.value - true) < 3 * estimate.sd).all(), name
    assert (names["track"].status == "ok").all()


def test_the_notebook_is_whole() -> None:
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    ids = [cell["id"] for cell in notebook["cells"]]
    assert len(set(ids)) == len(ids)
    for page in re.findall(r"\]\((\w+\.md)\)", NOTEBOOK.read_text(encoding="utf-8")):
        assert (NOTEBOOK.parent / page).is_file()
