"""The overlay video: directions of the axes, and a file that a browser plays."""

import dataclasses
import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from torchsphere.report.overlay import ball_axes, draw_frame, write_overlay
from torchsphere.results.reader import ResultFolder
from torchsphere.results.sampled_frames import NO_RESIDUAL, Sampled

HALF = np.sqrt(0.5)


def seen(path: Path) -> ResultFolder:
    """A ball of 20 px that moves by 30 px to the right and turns a quarter about +y; in the last frame it is lost."""
    n = 3
    stream = io.BytesIO()
    Image.new("L", (101, 80), 40).save(stream, "WEBP")
    sampled = Sampled(
        row=np.arange(n),
        webp=n * (stream.getvalue(),),
        box=(-0.5, -0.5, 101.0, 80.0),
        residual=np.full((n, 1, 1), NO_RESIDUAL, dtype=np.int8),
        residual_step=1.0,
        residual_bin=1,
    )
    return ResultFolder(
        path=path,
        summary={"settings": {}},
        frame=np.arange(n),
        time_s=np.full(n, np.nan),
        status=np.array(["ok", "ok", "lost"]),
        position=np.array([[30.0, 40.0], [60.0, 40.0], [np.nan, np.nan]]),
        radius=np.array([20.0, 20.0, np.nan]),
        increment=np.full((n, 5), np.nan),
        sd_increment=np.full((n, 5), np.nan),
        zncc=np.ones(n),
        quaternion=np.array([[1.0, 0, 0, 0], [HALF, 0, HALF, 0], [np.nan] * 4]),
        motion=None,
        sampled=sampled,
    )


def test_a_quarter_turn_about_y_points_x_at_the_viewer_and_z_to_the_right() -> None:
    # The front turns to the left: the right side comes to the front, the back comes to the right.
    turned = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    x, y, z = ball_axes(np.array([60.0, 40.0]), 20.0, turned)
    np.testing.assert_allclose(x.tip, [60, 40], atol=1e-12)
    assert x.in_front
    np.testing.assert_allclose(y.tip, [60, 58], atol=1e-12)
    np.testing.assert_allclose(z.tip, [78, 40], atol=1e-12)


def test_an_axis_that_points_away_is_behind() -> None:
    assert [arrow.in_front for arrow in ball_axes(np.zeros(2), 1.0, np.eye(3))] == [True, True, False]


def test_without_a_rotation_no_axes_are_drawn() -> None:
    assert ball_axes(np.zeros(2), 1.0, np.full((3, 3), np.nan)) == []


def test_the_circle_is_drawn_at_the_ball_and_not_drawn_for_a_lost_ball(tmp_path: Path) -> None:
    result = seen(tmp_path)
    assert result.sampled is not None
    pictures = [np.asarray(draw_frame(result, result.sampled, k)).astype(int) for k in range(3)]
    # The box of 101 px is shown 720 px wide, below two lines of text.
    zoom, below = 720 / 101, 56
    orange = np.array([230, 159, 0])
    for k, x in ((0, 30), (1, 60)):
        left = round(zoom * (x - 20 + 0.5)), round(zoom * 40.5) + below
        around = pictures[k][left[1] - 2 : left[1] + 3, left[0] - 3 : left[0] + 4]
        assert np.abs(around - orange).sum(-1).min() == 0
    assert np.abs(pictures[2][below:] - orange).sum(-1).min() > 0


def test_the_video_has_every_kept_frame_in_colours_that_browsers_play(tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="PyAV (extra 'video') is not installed")
    path = write_overlay(seen(tmp_path))
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        frames = list(container.decode(stream))
        assert stream.codec_context.name == "h264"
        assert stream.codec_context.pix_fmt == "yuv420p"
    assert len(frames) == 3
    assert frames[0].width % 2 == frames[0].height % 2 == 0
    assert [p.name for p in tmp_path.iterdir()] == ["overlay.mp4"]


def test_a_result_without_images_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="keeps no images"):
        write_overlay(dataclasses.replace(seen(tmp_path), sampled=None))
