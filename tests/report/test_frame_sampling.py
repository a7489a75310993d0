"""Images that are kept for the report, against the track of the same frames."""

import numpy as np

from torchsphere.results.reader import ResultFolder


def test_a_kept_image_shows_the_ball_where_the_track_has_it(result: ResultFolder) -> None:
    assert result.sampled is not None
    left, top, width, _ = result.sampled.box
    image = np.asarray(result.sampled.image(0).convert("L")).astype(float)
    scale = image.shape[1] / width
    rows, columns = np.indices(image.shape)
    # The ball's pattern alone varies; the background is even and the bar's edge is more than two radii away.
    x, y = (columns + 0.5) / scale + left, (rows + 0.5) / scale + top
    away = np.hypot(x - result.position[0, 0], y - result.position[0, 1])
    assert image[away < 38].std() > 50
    assert image[(away > 44) & (away < 60)].std() < 6
