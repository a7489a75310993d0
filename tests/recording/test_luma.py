"""Where frames of a video hold the brightness of their pixels."""

import numpy as np
import pytest

from torchsphere.recording.luma import _MIXED, Luma

av = pytest.importorskip("av", reason="the extra 'video' is not installed")
#: Rows of whole vectors: FFmpeg's conversion may write beyond the end of others, and so into the next row.
WIDTH, HEIGHT = 128, 6
#: Layouts in one plane, and in several, that fill the high or the low bits of a word, in both orders of bytes.
LAYOUTS = (
    *sorted(name for name in av.video.format.names if name.removesuffix("le") in _MIXED),
    *("ya16be", "xv36be"),
    *("gray", "gray10be", "gray12le", "gray16le", "yuv422p", "yuv422p10le", "yuv420p12be", "nv12", "nv16", "nv20le"),
    *("p010le", "p010be", "p210le", "p216le", "p416be"),
)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_brightness_is_that_which_ffmpeg_puts_into_the_layout(layout: str) -> None:
    bits = av.VideoFormat(layout).components[0].bits
    is_grey = layout.startswith(("gray", "ya"))
    plain, levels = _frame(("gray" if is_grey else "yuv444p") + ("" if bits == 8 else f"{bits}le"), bits, WIDTH)
    try:
        frame = plain.reformat(format=layout)
    except (ValueError, OSError) as error:
        pytest.skip(f"this build of FFmpeg does not write {layout}: {error}")
    luma = Luma.of(layout, bits)
    assert luma is not None
    np.testing.assert_array_equal(luma.levels(frame), levels)


@pytest.mark.parametrize(("layout", "bits"), [("gray", 8), ("gray10le", 10), ("yuv422p", 8), ("yuv420p12le", 12)])
def test_what_pads_the_rows_is_left_out(layout: str, bits: int) -> None:
    frame, levels = _frame(layout, bits, 37)
    assert frame.planes[0].line_size > levels.nbytes // HEIGHT
    luma = Luma.of(layout, bits)
    assert luma is not None
    np.testing.assert_array_equal(luma.levels(frame), levels)


def _frame(layout: str, bits: int, width: int):
    """A frame with random levels in its first plane and a middle level in the others, and these levels (h, w)."""
    levels = np.random.default_rng(0).integers(0, 1 << bits, (HEIGHT, width)).astype("u1" if bits == 8 else "<u2")
    frame = av.VideoFrame(width, HEIGHT, layout)
    for number, plane in enumerate(frame.planes):
        rows = np.full((plane.height, plane.line_size // levels.itemsize), 1 << (bits - 1), levels.dtype)
        if number == 0:
            rows[:, :width] = levels
        plane.update(rows.tobytes())
    return frame, levels


@pytest.mark.parametrize(
    "layout", ["rgb24", "gbrp", "pal8", "bayer_rggb8", "uyyvyy411", "monob", "grayf32le", "xyz12le"]
)
def test_a_layout_without_brightness_of_its_own_has_none(layout: str) -> None:
    assert Luma.of(layout, av.VideoFormat(layout).components[0].bits) is None
