"""The figure of force against penetration, its curve in the page, and its files."""

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest

from torchsphere.measure import Measurement
from torchsphere.report import draw, force_figure, pages
from torchsphere.results.reader import ResultFolder, read


def test_both_branches_are_drawn_in_physical_units_and_meet_at_the_deepest_loading_frame(result: ResultFolder) -> None:
    path = result.force_path
    assert path is not None
    axis = force_figure.force_figure(result).axes[0]
    assert axis.get_ylabel() == "normal force (kN)"
    assert "(mm)" in axis.get_xlabel()
    loading, unloading = axis.lines[:2]
    np.testing.assert_allclose(loading.get_xdata(), 1e3 * path.penetration_m[path.is_loading])
    np.testing.assert_allclose(loading.get_ydata(), 1e-3 * path.force_N[path.is_loading])
    np.testing.assert_allclose(unloading.get_xydata()[0], loading.get_xydata()[-1])
    np.testing.assert_allclose(unloading.get_ydata()[1:], 1e-3 * path.force_N[~path.is_loading])
    names = [text.get_text() for text in axis.get_legend().get_texts()]
    assert names[:2] == ["loading", "unloading"]
    # The force of the demo is a half-sine of time with half of its speed lost: no contact of Hertz.
    assert "does not describe" in names[2]


def test_the_law_is_drawn_from_its_onset_to_the_deepest_frame(result: ResultFolder) -> None:
    assert result.force_path is not None
    law = {"stiffness": {"value": 4e7}, "onset": {"value": 1e-3}}
    found = force_figure.law_curve(result.force_path, {"contact_law": law})
    assert found is not None
    depth, force = found
    assert depth[0] == -1e-3
    assert depth[-1] == result.force_path.penetration_m[result.force_path.is_loading].max()
    np.testing.assert_allclose(force, 4e7 * (depth + 1e-3).clip(0) ** 1.5)
    assert force_figure.law_curve(result.force_path, {}) is None


def test_a_weak_force_is_in_newtons(result: ResultFolder) -> None:
    assert result.force_path is not None
    weak = dataclasses.replace(result.force_path, force_N=1e-3 * result.force_path.force_N)
    figure = force_figure.force_figure(dataclasses.replace(result, force_path=weak))
    assert figure.axes[0].get_ylabel() == "normal force (N)"


def test_the_page_has_the_path_and_without_it_neither_plot_nor_figure(result: ResultFolder, tmp_path: Path) -> None:
    text = pages.report_html(result)
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    shown = json.loads(found[1])["forcePath"]
    assert result.force_path is not None
    assert shown["depth"] == pytest.approx((1e3 * result.force_path.penetration_m).tolist(), rel=1e-4)
    assert '<canvas id="force-path"' in text
    without = pages.report_html(dataclasses.replace(result, force_path=None))
    assert '<canvas id="force-path"' not in without


def test_the_figure_is_among_the_files_of_the_result(measured: tuple[Path, Measurement], tmp_path: Path) -> None:
    folder, _ = measured
    assert (folder / "figures" / "force_path.png").is_file()
    assert (folder / "figures" / "force_path.pdf").is_file()
    assert "force_path" in draw.NUMBER_FIGURES
    assert read(folder).force_path is not None
