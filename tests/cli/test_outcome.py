"""What ``torchsphere track`` prints, and its exit code for a result without a motion."""

import json
from pathlib import Path

import numpy as np
import pytest

from torchsphere.cli.main import main
from torchsphere.cli.outcome import outcome_lines

IMPACT = {
    "speed_before": {"value": 71.6512, "sd": 0.151},
    "contact_start": {"value": 7.274e-4, "sd": 5e-7},
    "peak_force": {"value": 53890.0, "sd": 150.0},
    "restitution_normal": {"value": 0.4559, "sd": 0.0004},
}

SUMMARY = {
    "frames_per_status": {"ok": 70, "lost": 1},
    "circle": {"x": 64.3, "y": 92.6, "radius": 40.01, "frame": 0, "sd_radius": 0.081, "sd_guessed": False},
    "impact": IMPACT,
    "warnings": ["A sentence."],
    "mean_motion": {
        "increment_px_rad": [5.3, 0.3, None, None, None],
        "sd_increment_px_rad": [0.01, 0.01, None, None, None],
    },
}


def values(lines: list[str]) -> dict[str, str]:
    """Label -> value of the lines."""
    return {line[:18].strip(): line[20:] for line in lines}


@pytest.fixture
def blind(tmp_path: Path) -> list[str]:
    """Arguments for twelve images of noise with a circle in which no ball is."""
    path = tmp_path / "noise.npy"
    np.save(path, np.random.default_rng(0).integers(0, 255, (12, 100, 120), dtype=np.uint8))
    return ["track", str(path), "--circle", "60,50,30", "--out", str(tmp_path / "out")]


def test_the_answer_has_the_impact_with_units_and_standard_deviations(tmp_path: Path) -> None:
    found = values(outcome_lines(SUMMARY, tmp_path))
    assert found["frames"] == "71 (70 ok, 1 lost)"
    assert found["circle"] == "64.30,92.60,40.01 px in frame 0, radius ± 0.081 px"
    assert found["speed before"] == "71.65 ± 0.15 m/s"
    assert found["contact begins"] == "0.72740 ± 0.00050 ms"
    assert found["largest force"] == "53.89 ± 0.15 kN"
    assert found["restitution"] == "0.45590 ± 0.00040"
    assert found["caution"] == "A sentence."
    # Quantities that were not measured have no line.
    assert "spin before" not in found


def test_without_an_impact_the_answer_has_the_mean_motion_that_was_measured(tmp_path: Path) -> None:
    found = values(outcome_lines({**SUMMARY, "impact": None}, tmp_path))
    assert found["mean step x, y"] == "(5.300, 0.300) ± (0.010, 0.010) px per frame"
    assert "mean turn x, y, z" not in found


def test_what_makes_numbers_wrong_stands_before_them_and_remarks_stand_last(tmp_path: Path) -> None:
    warnings = {"warnings": ["Wrong.", "Mind.", "Given."], "warning_levels": ["severe", "caution", "note"]}
    lines = outcome_lines({**SUMMARY, **warnings}, tmp_path)
    assert lines[0].split(maxsplit=1) == ["WARNING", "Wrong."]
    assert lines[-1].split(maxsplit=1) == ["note", "Given."]
    assert lines[-3].split(maxsplit=1) == ["caution", "Mind."]


def test_noise_under_a_given_circle_ends_with_code_4_and_one_sentence_first(blind: list[str], capsys) -> None:
    assert main([*blind, "--quiet"]) == 4
    printed = capsys.readouterr()
    assert printed.err.startswith("torchsphere: nothing usable was measured: the motion is known in 0 of 11 frames")
    assert printed.out == ""
    page = (Path(blind[-1]) / "report.html").read_text()
    assert 'class="verdict bad"' in page
    assert "What makes numbers wrong" in page
    summary = json.loads((Path(blind[-1]) / "summary.json").read_text())
    assert summary["unusable"] == "nothing usable was measured: the motion is known in 0 of 11 frames after the first"
    assert summary["warning_levels"][0] == "severe"
    assert "was not confirmed" in summary["warnings"][0]


def test_json_is_the_summary_and_nothing_else(blind: list[str], capsys) -> None:
    assert main([*blind, "--json", "--no-report"]) == 4
    printed = capsys.readouterr().out
    assert printed == (Path(blind[-1]) / "summary.json").read_text()
    assert sum(json.loads(printed)["frames_per_status"].values()) == 12
