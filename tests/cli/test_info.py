"""The command ``torchsphere info``."""

from pathlib import Path

import numpy as np
import pytest

from torchsphere.cli.main import main


def test_info_finds_the_ball_only_for_its_preview_and_its_help_says_so(short: Path, capsys) -> None:
    assert main(["info", str(short)]) == 0
    assert "circle" not in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["info", "--help"])
    assert "with --preview, also where the ball is" in " ".join(capsys.readouterr().out.split())


def test_info_says_what_the_file_knows_and_draws_the_circle(tmp_path: Path, short: Path, capsys) -> None:
    preview = tmp_path / "preview.png"
    assert main(["info", str(short), "--preview", str(preview)]) == 0
    printed = capsys.readouterr().out
    assert "384 x 192 px" in printed
    assert "frame rate  unknown" in printed
    circle = next(line.split()[2] for line in printed.splitlines() if line.startswith("circle"))
    np.testing.assert_allclose([float(v) for v in circle.split(",")], [64.3, 92.6, 40.0], atol=0.5)
    assert preview.stat().st_size > 10_000
