"""Figures of images: residual maps on one scale, and the thumbnail."""

from pathlib import Path

import numpy as np
from PIL import Image

from torchsphere.report import image_figures
from torchsphere.results.reader import ResultFolder


def test_residual_maps_show_the_start_the_worst_and_the_end_on_one_scale(result: ResultFolder) -> None:
    axes = image_figures.residual_figure(result).axes
    assert result.sampled is not None
    worst = int(np.nanargmin(result.zncc))
    titles = [axis.get_title() for axis in axes[:3]]
    for title, row in zip(titles, (1, worst, len(result.frame) - 1), strict=True):
        assert f"frame {result.frame[row]}\n" in title
    assert len({axis.images[0].get_clim() for axis in axes[:3]}) == 1
    # Five standard deviations of a noise of 2 grey levels in both images, less what the blur takes.
    assert 2 < axes[0].images[0].get_clim()[1] < 10
    assert axes[3].get_ylabel() == "residual (grey levels)"


def test_the_small_picture_is_small_and_shows_the_circle(result: ResultFolder, tmp_path: Path) -> None:
    (tmp_path / "small.webp").write_bytes(image_figures.thumbnail(result))
    image = np.asarray(Image.open(tmp_path / "small.webp").convert("RGB")).astype(int)
    assert max(image.shape) <= image_figures.THUMBNAIL_PX
    assert result.sampled is not None
    scale = image.shape[1] / result.sampled.box[2]
    centre = (result.position[0] - result.sampled.box[:2]) * scale
    rows, columns = np.nonzero(image[..., 0] - image[..., 2] > 80)
    away = np.hypot(columns + 0.5 - centre[0], rows + 0.5 - centre[1])
    # The line is 2 px wide and compressed.
    np.testing.assert_allclose(away, result.radius[0] * scale, atol=4)
    assert len(away) > 50
