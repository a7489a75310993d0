"""Video through PyAV."""

import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from writers import write_mov

from torchsphere.recording import open_recording, video
from torchsphere.recording.matroska import contents

av = pytest.importorskip("av", reason="PyAV is not installed")
RNG = np.random.default_rng(9)


def write_video(path: Path, images: np.ndarray, pixels: str, codec: str = "ffv1") -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=Fraction(25))
        stream.height, stream.width = images.shape[1:3]
        stream.pix_fmt = pixels
        for image in images:
            frame = av.VideoFrame.from_ndarray(image, format="gray" if pixels == "yuv420p" else pixels)
            container.mux(stream.encode(frame.reformat(format=pixels)))
        container.mux(stream.encode(None))
    return path


@pytest.mark.parametrize(("pixels", "depth"), [("gray", 8), ("gray10le", 10), ("gray12le", 12), ("gray16le", 16)])
@pytest.mark.parametrize("suffix", [".mkv", ".avi"])
def test_grey_video_is_bit_exact_forwards_and_backwards(tmp_path: Path, pixels: str, depth: int, suffix: str) -> None:
    images = RNG.integers(0, 2**depth, (9, 32, 50)).astype(np.uint8 if depth == 8 else np.uint16)
    with open_recording(write_video(tmp_path / f"a{suffix}", images, pixels)) as recording:
        assert (recording.shape, recording.bit_depth, recording.frame_rate) == (images.shape, depth, None)
        for start, stop in ((0, 3), (6, 9), (2, 5)):
            np.testing.assert_array_equal(recording.images(start, stop), images[start:stop])
        assert "25 frames/s" in " ".join(recording.notes)


@pytest.mark.parametrize(
    ("pixels", "first", "shift", "suffix"),
    [
        *(("yuyv422", 0, 0, suffix) for suffix in (".avi", ".mkv", ".mov")),
        *(("uyvy422", 1, 0, suffix) for suffix in (".avi", ".mkv", ".mov")),
        *(("yvyu422", 0, 0, suffix) for suffix in (".avi", ".mkv")),
        *(("y210le", 0, 6, suffix) for suffix in (".avi", ".mkv")),
    ],
)
def test_video_that_packs_colour_between_the_levels_keeps_them(
    tmp_path: Path, pixels: str, first: int, shift: int, suffix: str
) -> None:
    dtype = "<u2" if shift else "u1"
    depth = 10 if shift else 8
    levels = RNG.integers(0, 2**depth, (5, 32, 50)).astype(dtype)
    path = tmp_path / f"a{suffix}"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("rawvideo", rate=Fraction(25))
        stream.height, stream.width, stream.pix_fmt = 32, 50, pixels
        for image in levels:
            frame = av.VideoFrame(50, 32, pixels)
            words = np.full((32, frame.planes[0].line_size // image.itemsize), 2 ** (depth - 1) << shift, dtype)
            words[:, first : 2 * 50 + first : 2] = image << shift
            frame.planes[0].update(words.tobytes())
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with open_recording(path) as recording:
        assert (recording.kind, recording.bit_depth) == (f"video, rawvideo, {pixels}", depth)
        for start, stop in ((0, 3), (2, 5)):
            np.testing.assert_array_equal(recording.images(start, stop), levels[start:stop])
        assert "brightness (luma)" in " ".join(recording.notes)


def test_the_refusal_of_pixels_that_cannot_be_read_names_them(tmp_path: Path) -> None:
    path = tmp_path / "a.avi"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("rawvideo", rate=Fraction(25))
        stream.height, stream.width, stream.pix_fmt = 32, 48, "uyyvyy411"
        container.mux(stream.encode(av.VideoFrame(48, 32, "uyyvyy411")))
        container.mux(stream.encode(None))
    with pytest.raises(ValueError, match="the pixels are uyyvyy411, expected grey, YUV or RGB; convert the video"):
        open_recording(path)


@pytest.fixture(params=[0, 2**28], ids=["no cache", "cache"])
def cache_bytes(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """Limit of the cache of decoded images, bytes."""
    monkeypatch.setattr(video, "CACHE_BYTES", request.param)
    return int(request.param)


def test_steps_back_to_recent_images_do_not_decode_from_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cache_bytes: int
) -> None:
    images = RNG.integers(0, 256, (150, 16, 16)).astype(np.uint8)
    with open_recording(write_video(tmp_path / "long.avi", images, "gray")) as recording:
        opened = []
        original = av.open
        monkeypatch.setattr(av, "open", lambda *args, **options: opened.append(1) or original(*args, **options))
        for start, stop in ((0, 32), (31, 63), (40, 41), (10, 20), (62, 140), (100, 150), (90, 95)):
            np.testing.assert_array_equal(recording.images(start, stop), images[start:stop])
        assert len(opened) == 1
        np.testing.assert_array_equal(recording.images(3, 5), images[3:5])
        assert len(opened) == (1 if cache_bytes else 2)


def test_images_are_decoded_once_until_the_cache_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    images = RNG.integers(0, 256, (300, 16, 16)).astype(np.uint8)
    path = write_video(tmp_path / "long.avi", images, "gray")
    decoded = []
    original = video.Cursor._advance

    def advance(self: video.Cursor) -> object:
        decoded.append(self._next)
        return original(self)

    monkeypatch.setattr(video.Cursor, "_advance", advance)
    monkeypatch.setattr(video, "CACHE_BYTES", 200 * 16 * 16)
    with open_recording(path) as recording:
        for start, stop in ((0, 300), (100, 101), (30, 90), (195, 199), (5, 105), (0, 200)):
            np.testing.assert_array_equal(recording.images(start, stop), images[start:stop])
        assert decoded == list(range(300))
        # Images that are neither in the cache nor recent are decoded again.
        np.testing.assert_array_equal(recording.images(190, 210), images[190:210])
        assert len(decoded) > 300
        recording.close()
        np.testing.assert_array_equal(recording.images(7, 9), images[7:9])
        assert decoded.count(8) == 2


def drift(n: int) -> np.ndarray:
    """Images (n, 32, 48) that an encoder predicts from each other."""
    ramp = np.add.outer(np.arange(32), 3 * np.arange(48)) % 251
    return np.stack([np.roll(ramp, i, 1) for i in range(n)]).astype(np.uint8)


@pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".avi"])
def test_images_read_out_of_order_equal_images_read_in_order(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch, cache_bytes: int
) -> None:
    path = write_video(tmp_path / f"a{suffix}", drift(200), "yuv420p", "mpeg4")
    in_order = open_recording(path).images(0, 200)
    assert len(np.unique(in_order, axis=0)) > 40
    with open_recording(path) as recording:
        opened = []
        original = av.open
        monkeypatch.setattr(av, "open", lambda *args, **options: opened.append(1) or original(*args, **options))
        for start in RNG.integers(0, 198, 40):
            np.testing.assert_array_equal(recording.images(start, start + 2), in_order[start : start + 2])
        # Key images are the start, except for the first dozen images.
        assert len(opened) < 10


@pytest.mark.usefixtures("cache_bytes")
def test_a_video_without_the_requested_key_image_is_decoded_from_its_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_video(tmp_path / "a.mp4", drift(200), "yuv420p", "mpeg4")
    in_order = open_recording(path).images(0, 200)
    monkeypatch.setattr("torchsphere.recording.video.INTRA", -1)
    with open_recording(path) as recording:
        for start in (150, 20, 190):
            np.testing.assert_array_equal(recording.images(start, start + 2), in_order[start : start + 2])


class InOrder:
    """A container that refuses to seek."""

    def __init__(self, container: object) -> None:
        self._container = container

    def seek(self, *_: object, **__: object) -> None:
        raise ValueError("cannot seek")

    def __getattr__(self, name: str) -> object:
        return getattr(self._container, name)


@pytest.mark.usefixtures("cache_bytes")
def test_a_video_without_seeking_is_decoded_from_its_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_video(tmp_path / "a.mp4", drift(200), "yuv420p", "mpeg4")
    in_order = open_recording(path).images(0, 200)
    name = "torchsphere.recording.video.Cursor"
    original = video.Cursor._open
    with open_recording(path) as recording:
        monkeypatch.setattr(f"{name}._open", lambda self: InOrder(original(self)))
        for start in (150, 20, 190):
            np.testing.assert_array_equal(recording.images(start, start + 2), in_order[start : start + 2])


def test_rgb_becomes_grey(tmp_path: Path) -> None:
    colour = RNG.integers(0, 256, (2, 32, 48, 3)).astype(np.uint8)
    recording = open_recording(write_video(tmp_path / "a.avi", colour, "bgr24", "rawvideo"))
    np.testing.assert_allclose(recording.images(0, 2), colour @ [0.114, 0.587, 0.299], rtol=1e-5)


@pytest.mark.parametrize("keep", [500, 0.5, 0.95])
@pytest.mark.parametrize("suffix", [".avi", ".mp4"])
def test_a_cut_video_is_refused(tmp_path: Path, suffix: str, keep: float) -> None:
    images = RNG.integers(0, 256, (9, 32, 48)).astype(np.uint8)
    codec = {"codec": "mpeg4", "pixels": "yuv420p"} if suffix == ".mp4" else {"pixels": "gray"}
    path = write_video(tmp_path / f"a{suffix}", images, **codec)
    data = path.read_bytes()
    path.write_bytes(data[: int(keep if keep > 1 else keep * len(data))])
    with pytest.raises((ValueError, OSError), match="a" + suffix):
        open_recording(path)


def test_a_missing_library_names_the_extra_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_video(tmp_path / "a.mkv", np.zeros((1, 32, 32), np.uint8), "gray")
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(OSError, match=r"torchsphere\[video\]") as refusal:
        open_recording(path)
    assert "damaged" not in str(refusal.value)


@pytest.mark.parametrize(("name", "shape"), [("sample.mp4", (300, 288, 384)), ("3axis0.avi", (100, 640, 640))])
def test_real_videos_give_the_facts_of_their_headers(shared_data: Path, name: str, shape: tuple[int, int, int]) -> None:
    with open_recording(shared_data / "fictrac" / name) as recording:
        assert recording.shape == shape
        assert recording.frame_rate is None
        last = recording.images(shape[0] - 1, shape[0])
        assert last.std() > 1


CONTAINERS = [("mkv", "ffv1", "gray"), ("mkv", "mpeg4", "yuv420p"), ("webm", "libvpx", "yuv420p")]


@pytest.mark.parametrize(("suffix", "codec", "pixels"), CONTAINERS)
def test_a_cut_matroska_video_is_damaged_or_has_all_its_images(
    tmp_path: Path, suffix: str, codec: str, pixels: str
) -> None:
    data = write_video(tmp_path / f"whole.{suffix}", drift(60), pixels, codec).read_bytes()
    cut = tmp_path / f"cut.{suffix}"
    refused = []
    for part in range(1, 25):
        cut.write_bytes(data[: len(data) * part // 25])
        try:
            with open_recording(cut) as recording:
                assert len(recording) == 60
                assert "bytes of the file are missing" in " ".join(recording.notes)
        except OSError as error:
            refused.append(str(error))
    assert len(refused) >= 23
    assert all("cut" in sentence for sentence in refused)


@pytest.mark.parametrize(("suffix", "codec", "pixels"), CONTAINERS)
def test_a_cut_matroska_video_that_states_no_duration_is_damaged(
    tmp_path: Path, suffix: str, codec: str, pixels: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_video(tmp_path / f"a.{suffix}", drift(60), pixels, codec)
    monkeypatch.setattr(video, "_stated_duration", lambda container, stream: None)
    assert len(open_recording(path)) == 60
    path.write_bytes(path.read_bytes()[:-5])
    with pytest.raises(OSError, match="5 bytes at the end are missing"):
        open_recording(path)


@pytest.mark.parametrize(("suffix", "codec", "pixels"), CONTAINERS)
@pytest.mark.parametrize("damage", ["overwritten", "inserted", "removed"])
def test_images_lost_to_damage_of_a_matroska_video_that_states_no_duration_are_missed(
    tmp_path: Path, suffix: str, codec: str, pixels: str, damage: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = write_video(tmp_path / f"a.{suffix}", drift(60), pixels, codec).read_bytes()
    monkeypatch.setattr(video, "_stated_duration", lambda container, stream: None)
    path, refused = tmp_path / f"b.{suffix}", 0
    for at in range(40, len(data) - 8, len(data) // 40):
        piece = {"overwritten": b"\xa3" * 8, "inserted": b"\x81" * 5 + data[at : at + 8], "removed": b""}[damage]
        path.write_bytes(data[:at] + piece + data[at + 8 :])
        try:
            with open_recording(path) as recording:
                assert len(recording) == 60
        except (OSError, ValueError):
            refused += 1
    assert refused > (0 if damage == "overwritten" else 35)


def test_laced_images_and_groups_of_a_matroska_file_are_counted(tmp_path: Path) -> None:
    def element(code: str, body: bytes) -> bytes:
        return bytes.fromhex(code) + (0x4000 | len(body)).to_bytes(2, "big") + body

    tracks = element("1654ae6b", element("ae", element("d7", b"\1") + element("83", b"\1")))
    laced, plain = b"\x81\0\0\x04\x02" + bytes(9), b"\x81\0\0\0" + bytes(3)
    blocks = element("a3", laced) + element("a0", element("9b", b"\1") + element("a1", plain)) + element("a3", plain)
    unknown_size = bytes.fromhex("1f43b675ff") + element("e7", b"\0") + blocks
    body = tracks + element("ec", b"") + unknown_size + element("1f43b675", blocks)
    path = tmp_path / "a.mkv"
    path.write_bytes(element("1a45dfa3", b"") + element("18538067", body))
    found = contents(path)
    assert (found.images, found.end, found.damaged_at) == (10, path.stat().st_size, None)
    # A block of a track that is not there.
    path.write_bytes(path.read_bytes()[:-7] + b"\x82" + path.read_bytes()[-6:])
    assert contents(path).damaged_at is not None


def test_images_missing_in_the_middle_are_noted(tmp_path: Path) -> None:
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=Fraction(25))
        stream.height, stream.width, stream.pix_fmt = 32, 48, "gray"
        for k, image in enumerate(drift(20)):
            for packet in stream.encode(av.VideoFrame.from_ndarray(image, format="gray")):
                if k not in (7, 8):
                    container.mux(packet)
    with open_recording(path) as recording:
        assert len(recording) == 18
        assert "leave room for 2 more, the first before image 7" in " ".join(recording.notes)


@pytest.mark.parametrize(("first", "count"), [(3, 9), (0, 5), (4, 4)])
def test_a_trimmed_video_has_the_images_that_a_player_shows_and_says_how_many_it_hides(
    tmp_path: Path, first: int, count: int
) -> None:
    images = RNG.integers(0, 256, (12, 16, 24)).astype(np.uint8)
    with open_recording(write_mov(tmp_path / "a.mov", images, trim=(first, count))) as recording:
        np.testing.assert_array_equal(recording.images(0, len(recording)), images[first : first + count])
        assert f"hides {12 - count} of the 12 images" in " ".join(recording.notes)
        np.testing.assert_array_equal(recording.images(2, 3)[0], images[first + 2])


def test_a_trimmed_video_whose_images_depend_on_each_other_says_how_many_are_hidden(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mp4", drift(40), "yuv420p", "mpeg4")
    whole = open_recording(path).images(0, 40)
    data = bytearray(path.read_bytes())
    scale = int.from_bytes(data[data.index(b"mdhd") + 16 :][:4], "big")
    at = data.index(b"elst") + 16
    data[at : at + 4] = (17 * scale // 25).to_bytes(4, "big")
    path.write_bytes(data)
    with open_recording(path) as recording:
        assert len(recording) == 23
        np.testing.assert_array_equal(recording.images(0, 23), whole[17:])
        assert "hides 17 of the 40 images" in " ".join(recording.notes)


def test_an_untrimmed_video_hides_nothing(tmp_path: Path) -> None:
    with open_recording(write_mov(tmp_path / "a.mov", RNG.integers(0, 256, (4, 16, 24)))) as recording:
        assert "hides" not in " ".join(recording.notes)
