"""Cache, tables and figures of the experiments."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from experiments import experiment
from experiments.experiment import Row, claims, key_of, saved_figure, table
from experiments.shots import frames_of, settings_of, spread
from render import preset

ROW = Row("fig00", "It is so.", "1 | 2", "3", True)


def test_frames_shown_include_both_ends() -> None:
    assert list(frames_of(3, 11)) == [0, 5, 10]


def test_the_spread_leaves_out_what_was_not_measured() -> None:
    mean, std = spread(np.array([1.0, np.nan, 3.0]))
    assert (mean, std) == pytest.approx((2.0, np.sqrt(2.0)))


def test_a_shots_key_changes_with_any_of_its_settings() -> None:
    shot = preset.load("paper-flight")
    other = preset.load("paper-flight", ["sensor.read_noise_grey=2.5"])
    assert key_of("shot", settings_of(shot)) == key_of("shot", settings_of(preset.load("paper-flight")))
    assert key_of("shot", settings_of(shot)) != key_of("shot", settings_of(other))


def test_a_bar_in_a_cell_does_not_end_it() -> None:
    assert claims([ROW]).splitlines()[-1] == r"| fig00 | It is so. | 1 \| 2 | 3 | yes |"


def test_a_figure_makes_its_folder_and_is_saved(tmp_path: Path) -> None:
    path = tmp_path / "figures" / "fig00.png"
    with saved_figure(path, (1, 1)) as figure:
        figure.subplots()
    assert path.stat().st_size > 0


def test_a_published_table_names_the_command_that_measures_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(experiment, "TABLES", tmp_path)
    experiment.publish("times", "speed.speed", table(("way", "ms"), [("ours", 1)]))
    text = (tmp_path / "times.md").read_text()
    assert text == "*Measured by `python -m experiments.speed.speed`.*\n\n| way | ms |\n| --- | --- |\n| ours | 1 |\n"
