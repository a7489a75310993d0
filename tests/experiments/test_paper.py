"""The parts of the paper's experiments that measure nothing: geometry, simulated instruments, and the page."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from experiments.experiment import Row, claims, decided
from experiments.paper import all as everything
from experiments.paper.bar.history import Peak
from experiments.paper.fig05 import accelerometer, lobe
from experiments.paper.fig09 import angles_deg, mean_spin_rev_s
from experiments.paper.fig11 import matched
from experiments.paper.fig15 import hidden_share
from experiments.paper.table1 import RISE_S, SPACING_M, barrier_light, gate_signals
from render import preset
from render.trajectory import DropWeight

ROW = Row("fig00", "It is so.", "1 | 2", "3", True)


def test_half_of_a_disc_is_hidden_where_the_edge_passes_its_centre() -> None:
    np.testing.assert_allclose(hidden_share(np.array([-1.0, 0.0, 1.0, 2.0, 3.0])), [0, 0, 0.5, 1, 1], atol=1e-15)


def test_hidden_shares_of_both_sides_of_an_edge_add_up_to_the_disc() -> None:
    depth = np.linspace(0, 2, 41)
    np.testing.assert_allclose(hidden_share(depth) + hidden_share(2 - depth), 1, atol=1e-12)


def test_without_lag_a_barrier_is_half_dark_when_an_edge_of_the_ball_is_in_its_middle() -> None:
    # Steps of a second, against which the receiver's lag is nothing.
    time = np.array([-1.1, -1.0, 0.0, 1.0, 1.1]) * 1e3
    light = barrier_light(time, 15e-6, 0.0, 15e-3)
    np.testing.assert_allclose(light, [1, 0.5, 0, 0.5, 1], atol=1e-9)


def test_a_receiver_lags_by_its_time_constant() -> None:
    time = np.arange(2000) * 1e-7
    light = barrier_light(time, 1000.0, 1.0, 10.0)
    # The ball's edge is far past the beam: darkness from the first sample on, which the receiver follows.
    np.testing.assert_allclose(light, np.exp(-(time + 1e-7) / RISE_S), rtol=1e-9, atol=1e-12)


def test_the_second_barrier_shows_the_first_ones_light_later_by_the_spacing_over_the_velocity() -> None:
    time = np.arange(3000) * 1e-6
    velocity = 80.0
    first, second = (barrier_light(time - 1e-3, velocity, place, 15e-3) for place in (0.0, SPACING_M))
    later = round(SPACING_M / velocity / 1e-6)
    np.testing.assert_allclose(second[later:], first[:-later], atol=1e-9)


def test_both_passages_are_within_the_gates_signals() -> None:
    _, volts = gate_signals(70.0, 15e-3, seed=1)
    bright, dark = volts.max(1), volts.min(1)
    ends = volts[:, [0, -1]]
    assert (ends > (0.8 * bright + 0.2 * dark)[:, None]).all()


def test_a_half_sine_lobe_has_its_height_and_two_thirds_of_its_length() -> None:
    time = np.linspace(0, 3, 301)
    values = np.where((time > 1) & (time < 2), 7 * np.sin(np.pi * (time - 1)), 0)
    peak, width = lobe(time, values)
    assert peak == pytest.approx(7, abs=1e-4)
    assert width == pytest.approx(2 / 3, abs=1e-3)


def test_a_lobe_that_does_not_end_has_no_width() -> None:
    assert np.isnan(lobe(np.arange(5.0), np.arange(5.0))[1])


def test_an_accelerometer_in_free_fall_shows_its_offset_alone() -> None:
    motion = preset.load("paper-drop-weight").trajectory
    assert isinstance(motion, DropWeight)
    _, signal = accelerometer(motion, 9e-3, seed=0)
    peak = accelerometer(motion, 29e-3, seed=0)[1].max()
    # Standard error of 450 samples with noise of a twentieth of the peak: 0.24 % of it, of which five are allowed.
    assert abs(signal.mean() - 15.0) < 0.012 * peak


def test_angles_are_sums_of_the_rotations_and_the_spin_is_their_mean_rate() -> None:
    increment = np.zeros((10, 5))
    increment[:, 3] = 2 * np.pi / 100
    np.testing.assert_allclose(angles_deg(increment)[:, 1], 3.6 * np.arange(11), atol=1e-12)
    np.testing.assert_allclose(mean_spin_rev_s(increment, 1000.0), [0, 10, 0], atol=1e-12)


def test_every_wanted_peak_gets_the_nearest_one() -> None:
    found = (Peak(1.0, 5.0), Peak(4.0, 3.0))
    pairs = matched(found, (Peak(1.2, 5.0), Peak(3.0, 3.0)))
    assert [p.time_s for p, _ in pairs] == [1.0, 4.0]
    assert matched((), (Peak(1.0, 1.0),)) == []


def test_an_experiment_that_fails_gets_a_row_that_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(name: str) -> ModuleType:
        raise ValueError(f"no such shot: {name}")

    monkeypatch.setattr(everything.importlib, "import_module", broken)
    (row,) = everything.run("fig02")
    assert not row.holds
    assert row.ours == "failed: ValueError: no such shot: experiments.paper.fig02"


def test_the_page_counts_the_claims_and_shows_the_figures_that_are_there(tmp_path: Path) -> None:
    folder = tmp_path / "figures"
    folder.mkdir()
    (folder / "fig00.png").touch()
    other = Row("fig01", "It is not.", "1", "2", False)
    text = everything.page([ROW, other], folder, {ROW.experiment: 61.4, other.experiment: 2.2})
    assert "1 of 2 claims hold." in text
    assert "![fig00](figures/fig00.png)" in text
    assert "fig01.png" not in text
    assert "| fig00 | 61 |" in text
    assert "| all | 64 |" in text


def test_the_times_are_those_of_the_runs_that_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(everything, "CACHE", tmp_path / "cache")
    assert everything.kept_times({"fig02": 100.0, "fig03": 5.0}) == {"fig02": 100.0, "fig03": 5.0}
    assert everything.kept_times({"fig02": 0.1, "fig03": 7.0}) == {"fig02": 100.0, "fig03": 7.0}


def test_an_unknown_name_is_refused_with_the_known_ones(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        everything.main(["fig99"])
    assert "'fig99' is no experiment of the paper; expected one of fig02" in capsys.readouterr().err


def test_a_row_of_another_condition_counts_neither_for_nor_against_the_paper() -> None:
    remark = Row("fig01", "It is so.", "1", "2", False, other_condition="with rounding")
    open_ = Row("fig01", "It grows.", "1.5 times", "1.49", decided(1.49, 1.5, 0.05))
    refuted = Row("fig01", "It is not.", "1", "2", False, reason="The two differ.")
    assert everything.count([ROW, remark, open_, refuted]) == (
        "1 of 3 claims hold; too close to the limit to say: 1; rows of another condition than the paper's: 1."
    )
    text = claims([remark, open_, refuted])
    assert "**not the paper's condition**: with rounding" in text
    assert "**undecided**" in text
    assert "**no**: The two differ." in text


@pytest.mark.parametrize(("value", "expected"), [(1.0, False), (1.45, None), (1.55, None), (2.0, True)])
def test_a_verdict_near_its_limit_is_left_open(value: float, expected: bool | None) -> None:
    assert decided(value, 1.5, 0.05) is expected
