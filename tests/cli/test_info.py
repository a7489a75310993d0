"""The command ``torchsphere info``."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from torchsphere.cli.main import main


def test_info_finds_the_ball_for_a_preview_alone_and_the_help_says_so(short: Path, capsys) -> None:
    assert main(["info", str(short)]) == 0
    assert "circle" not in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["info", "--help"])
    assert "with --preview, also where the ball is" in " ".join(capsys.readouterr().out.split())


def test_without_a_ball_the_preview_is_the_image_with_a_grid_and_the_exit_code_says_so(tmp_path: Path, capsys) -> None:
    path, preview = tmp_path / "noise.npy", tmp_path / "preview.png"
    noise = np.random.default_rng(0).integers(90, 110, (4, 60, 200), dtype=np.uint8)
    np.save(path, noise)
    assert main(["info", str(path), "--preview", str(preview)]) == 4
    printed = capsys.readouterr().out
    assert "no ball was found in 4 frames" in printed
    assert "give its outline with --circle" in printed
    with Image.open(preview) as image:
        colours = np.asarray(image.convert("RGB")).reshape(-1, 3)
    # Lines in blue over grey levels.
    assert (colours[:, 2].astype(int) - colours[:, 0] > 60).sum() > 1000


def test_axes_that_seem_to_have_another_order_are_told_and_turned(tmp_path: Path, demo_shot, capsys) -> None:
    path = tmp_path / "turned.npy"
    np.save(path, np.moveaxis(demo_shot.images[:12].astype(np.uint8), 0, 2))
    assert main(["info", str(path)]) == 0
    assert "looks like (h, w, n): give --axes hwn to turn it, or --axes nhw" in capsys.readouterr().out
    assert main(["info", str(path), "--axes", "hwn"]) == 0
    printed = capsys.readouterr().out
    assert "frames      12" in printed
    assert "--axes" not in printed


def test_a_preview_that_is_no_png_is_refused_first(tmp_path: Path, short: Path, capsys) -> None:
    assert main(["info", str(short), "--preview", str(tmp_path / "preview.jpg")]) == 2
    assert capsys.readouterr().out == ""


def test_info_prints_the_facts_of_the_file_and_draws_the_circle(tmp_path: Path, short: Path, capsys) -> None:
    preview = tmp_path / "preview.png"
    assert main(["info", str(short), "--preview", str(preview)]) == 0
    printed = capsys.readouterr().out
    assert "384 x 192 px" in printed
    assert "frame rate  unknown" in printed
    circle = next(line.split()[2] for line in printed.splitlines() if line.startswith("circle"))
    np.testing.assert_allclose([float(v) for v in circle.split(",")], [64.3, 92.6, 40.0], atol=0.5)
    assert preview.stat().st_size > 10_000


def test_the_preview_is_in_the_images_as_they_are_shown(tmp_path: Path, capsys) -> None:
    path, preview = tmp_path / "noise.npy", tmp_path / "preview.png"
    np.save(path, np.random.default_rng(0).integers(90, 110, (4, 60, 200), dtype=np.uint8))
    assert main(["info", str(path), "--pixel-aspect", "11:10", "--preview", str(preview)]) == 4
    printed = capsys.readouterr().out
    assert "size        220 x 60 px" in printed
    assert "Pixels are 11:10 (width to height) as given" in printed
    assert main(["info", str(path), "--bayer", "RGGB"]) == 0
    assert "RGGB as given" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--pixel-aspect", "11:0"], "--pixel-aspect: '11:0': expected a ratio such as 11:10, or a number"),
        (["--pixel-aspect", "9"], "--pixel-aspect 9.0: expected a number from 0.25 to 4"),
        (["--bayer", "XYZ"], "expected one of RGGB, BGGR, GRBG, GBRG"),
    ],
)
def test_a_ratio_or_a_mosaic_that_does_not_exist_is_refused(given: list[str], said: str, short: Path, capsys) -> None:
    try:
        code = main(["info", str(short), *given])
    except SystemExit as end:
        code = end.code
    assert code == 2
    assert said in capsys.readouterr().err
