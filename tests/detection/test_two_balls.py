"""Two balls in one image: both circles are told, and a lonely ball has no others."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
import torch
from shots import noisy, speckle

import torchsphere as ts
from torchsphere.cli.main import main
from torchsphere.synthetic import ray_caster

RADIUS, SHAPE, FRAMES = 20.0, (90, 220), 4


def footage(*, two: bool) -> torch.Tensor:
    """A ball that moves right, and another that moves left."""
    images = []
    for i in range(FRAMES):
        image: torch.Tensor | float = 90.0
        for seed, x in ((1, 34.0 + 3 * i), (2, 170.0 - 2 * i))[: 2 if two else 1]:
            pose = torch.tensor([[x, 45.0]]), torch.eye(3)[None]
            image = ray_caster.render(speckle(seed, RADIUS), pose[0], RADIUS, pose[1], image, shape=SHAPE)[0]
        images.append(image)
    return noisy(torch.stack(images), 2.0, 3)


def test_a_track_says_that_another_ball_is_in_the_image() -> None:
    found = ts.track(footage(two=True), log=False)
    centres = sorted([found.circle.x, found.circle.others[0][0]])
    assert len(found.circle.others) == 1
    np.testing.assert_allclose(centres, [34.0, 170.0], atol=1.0)
    assert found.circle.others[0][2] == pytest.approx(RADIUS, abs=1.0)
    other = f"{found.circle.others[0][0]:.1f}"
    assert any("2 round objects" in sentence and other in sentence for sentence in found.warnings)


def test_a_lonely_ball_has_no_others() -> None:
    found = ts.track(footage(two=False), log=False)
    assert found.circle.others == ()
    assert not any("round objects" in sentence for sentence in found.warnings)


def test_the_preview_has_both_circles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tifffile.imwrite(tmp_path / "two.tif", footage(two=True).to(torch.uint8).numpy(), photometric="minisblack")
    assert main(["info", str(tmp_path / "two.tif"), "--preview", str(tmp_path / "two.png")]) == 0
    printed = capsys.readouterr().out
    assert "circle 2" in printed
    assert "2 round objects" in printed
    assert (tmp_path / "two.png").stat().st_size > 1000
