"""The command ``torchsphere plan``: written files, and refusals."""

import json
from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch
from plan_setups import (
    GIVEN,
    TEST,
    planned,
    sides,
)
from refusals import refused

pytestmark = pytest.mark.usefixtures("few_recordings")


def test_the_command_writes_figure_numbers_and_advice(tmp_path: Path, capsys) -> None:
    modes = tmp_path / "modes.csv"
    modes.write_text("width_px,height_px,fps_max\n256,64,40000\n256,24,80000\n")
    image = tmp_path / "ball.tif"
    side = sides(18.0)[0]
    tifffile.imwrite(image, side.image.round().to(torch.uint8).numpy(), photometric="minisblack")
    circle = "{},{},{}".format(*side.circle)
    looks = ["--image", str(image), "--circle", circle, "--modes", str(modes), "--width", "256"]
    command = (*GIVEN, *looks, "--out", str(tmp_path / "plan"))
    assert planned(*command) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    assert any(line.startswith("blur") for line in lines)
    assert last == f"result  {tmp_path / 'plan'}"
    assert {path.name for path in (tmp_path / "plan").iterdir()} == {"plan.json", "plan.png"}
    table = json.loads((tmp_path / "plan" / "plan.json").read_text())
    assert table["advice"].startswith("Film with 256 x 64 px at 40000 frames/s")
    assert table["blur_px"] == pytest.approx(30 * 5e-6 * 1200)
    assert table["frames_in_view"] == 221
    assert [mode["reason_against"] == "" for mode in table["modes"]] == [True, False]
    assert np.array(table["increment_covariance_px_rad"]).shape == (5, 5)
    assert planned(*command, "--overwrite", "--quiet") == 0
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--speed", "-3"], "--speed -3"),
        (["--shutter-us", "100"], "longer than the 27.78 us"),
        (["--image", "there-is-none.tif"], "each image needs its circle"),
        (["--image", "there-is-none.tif", "--circle", "3,3,3"], "does not exist"),
        (["--flight", "shot.tif"], "leave one of both out"),
        (["--field-mm", "100"], "add --modes"),
        (["--restitution", "2"], "--restitution 2"),
        (["--contact-us", "-1"], "--contact-us -1"),
        (["--speckle-px", "30"], "smaller than the radius"),
        (["--grey", "200,100"], "dark one first"),
        (["--blurred"], "add --image"),
    ],
)
def test_invalid_settings_are_refused_and_nothing_is_written(tmp_path: Path, more: list[str], said: str) -> None:
    with pytest.raises((ValueError, OSError), match=said):
        planned(*GIVEN, *more, "--out", str(tmp_path / "plan"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", ["--noise", "--direction-deg"])
def test_a_number_that_is_not_finite_is_refused(tmp_path: Path, capsys, option: str) -> None:
    sentence = refused(["plan", *GIVEN, option, "nan", "--out", str(tmp_path / "plan")], capsys)
    assert f"argument {option}: 'nan': expected a finite number" in sentence
    assert list(tmp_path.iterdir()) == []


def test_the_refusal_of_an_incomplete_plan_names_the_missing_settings(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="needs --shutter-us, --noise;"):
        planned(*TEST, "--out", str(tmp_path))
