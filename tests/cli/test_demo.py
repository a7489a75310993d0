"""The command ``torchsphere demo``."""

import json
from pathlib import Path

from torchsphere.cli.main import main


def test_the_demo_recovers_its_motion_within_the_stated_uncertainty(tmp_path: Path, capsys) -> None:
    assert main(["demo", "--out", str(tmp_path / "demo"), "--quiet"]) == 0
    printed = capsys.readouterr().out
    # Of 17 quantities 95 % lie within two standard deviations, so at most two may lie outside, and none far.
    table = printed.partition("error / sd\n")[2].partition("\n\n")[0].splitlines()
    ratios = [abs(float(line.split()[-1])) for line in table]
    assert len(ratios) == 17
    assert sum(ratio > 2 for ratio in ratios) <= 2
    assert max(ratios) < 3
    # The force of 53.887 kN is known to 0.05 %.
    true, measured, _, sd, _ = next(line for line in table if line.startswith("largest force")).split()[3:]
    assert true == "53.887"
    assert abs(float(measured) - 53.887) < 0.08
    assert float(sd) < 0.04
    names = {path.name for path in (tmp_path / "demo").iterdir()}
    assert {"track.csv", "track.parquet", "kinematics.csv", "summary.json", "figures", "shot.tif", "truth.csv"} <= names
    # The images lie in a temporary folder during the measurement.
    summary = json.loads((tmp_path / "demo" / "summary.json").read_text())
    assert summary["input"]["path"] == "synthetic example shot"
    assert "<title>synthetic example shot: " in (tmp_path / "demo" / "report.html").read_text()
