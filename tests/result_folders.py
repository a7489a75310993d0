"""Result folders of the demo's impact, in SI units and without."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import tifffile

from torchsphere.measure import Measurement, Request, measure
from torchsphere.results.reader import ResultFolder
from torchsphere.synthetic import demo_shot


def measured_impact(folder: Path) -> tuple[Path, Measurement]:
    """Result folder and measurement of the demo's impact, frames 20 to 45."""
    tifffile.imwrite(folder / "shot.tif", demo_shot.make_shot().images[20:46], photometric="minisblack")
    request = Request(
        input=folder / "shot.tif",
        out=folder / "result",
        fps=36_000.0,
        diameter_mm=30.0,
        mass_g=110.0,
        circle=(170.3, 98.6, 40.0),
        map="off",
    )
    return folder / "result", measure(request)


def in_px(result: ResultFolder) -> ResultFolder:
    """The same result without frame rate and scale."""
    summary = result.summary | {"frame_rate": None, "scale": None, "contact_s": None, "differentiation": None}
    unknown = np.full_like(result.time_s, np.nan)
    return dataclasses.replace(result, motion=None, time_s=unknown, summary=summary)
