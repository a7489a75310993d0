"""The command ``torchsphere track`` with a camera that is very near, or very far."""

import csv
from pathlib import Path

import numpy as np
import pytest
import scipy.ndimage
import tifffile
from refusals import refused

from torchsphere.cli.main import main
from torchsphere.synthetic import demo_shot as demo

#: Neither a page nor a map of the ball, where the test is about neither.
FAST = ("--quiet", "--no-report", "--map", "off")


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory, demo_shot: demo.Shot) -> Path:
    """Four frames of a ball with a radius of 20 px."""
    path = tmp_path_factory.mktemp("near") / "small.tif"
    smooth = scipy.ndimage.gaussian_filter(demo_shot.images[:4].astype(float), (0, 0.8, 0.8))
    images = scipy.ndimage.zoom(smooth, (1, 0.5, 0.5), order=1)
    tifffile.imwrite(path, images.round().astype(np.uint8), photometric="minisblack")
    return path


@pytest.mark.parametrize("focal_px", ["5", "1e-3"])
def test_a_camera_within_the_ball_is_refused(
    small: Path, tmp_path: Path, focal_px: str, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["track", str(small), "--out", str(tmp_path / "out"), "--focal-px", focal_px, *FAST]
    assert "is then seen from 1.0" in refused(arguments, capsys)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("focal_px", ["50", "1e9"])
def test_a_camera_at_two_radii_or_almost_at_infinity_gives_a_result(small: Path, tmp_path: Path, focal_px: str) -> None:
    out = tmp_path / "out"
    options = [
        "--focal-px",
        focal_px,
        "--fps",
        "36000",
        "--diameter-mm",
        "30",
        "--no-report",
        "--map",
        "off",
        "--quiet",
    ]
    assert main(["track", str(small), "--out", str(out), *options]) == 0
    with (out / "track.csv").open(newline="") as stream:
        steps = [float(row["dx_px"]) for row in csv.DictReader(stream)][1:]
    assert np.isfinite(steps).all()
