"""Multi-page TIFF."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from torchsphere.recording import open_recording, tiff

IMAGES = np.random.default_rng(5).integers(0, 4096, (6, 16, 24)).astype(np.uint16)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"imagej": True},
        {"metadata": None},
        {"bigtiff": True},
        {"byteorder": ">"},
        {"compression": "zlib", "predictor": True},
        {"compression": "lzw"},
        {"tile": (16, 16)},
        {"rowsperstrip": 4, "contiguous": False},
    ],
    ids=str,
)
def test_every_layout_gives_the_written_levels(tmp_path: Path, options: dict[str, Any]) -> None:
    tifffile.imwrite(tmp_path / "a.tif", IMAGES, photometric="minisblack", **options)
    with open_recording(tmp_path / "a.tif") as recording:
        assert recording.shape == IMAGES.shape
        np.testing.assert_array_equal(recording.images(1, 5), IMAGES[1:5])
        np.testing.assert_array_equal(recording.images(0, 6), IMAGES)
        assert recording.frame_rate is None


def test_all_images_of_a_stack_with_a_single_page_are_read(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", IMAGES, photometric="minisblack", metadata={"axes": "TYX"}, truncate=True)
    with tifffile.TiffFile(tmp_path / "a.tif") as tif:
        assert len(tif.pages) == 1
    recording = open_recording(tmp_path / "a.tif")
    np.testing.assert_array_equal(recording.images(0, 6), IMAGES)


def test_packed_twelve_bits_are_unpacked(tmp_path: Path) -> None:
    write_packed_tiff(tmp_path / "a.tif", IMAGES[0])
    recording = open_recording(tmp_path / "a.tif")
    assert recording.bit_depth == 12
    np.testing.assert_array_equal(recording.images(0, 1)[0], IMAGES[0])


def write_packed_tiff(path: Path, image: np.ndarray) -> None:
    """Write one page of 12 bits per sample without gaps; tifffile itself writes whole bytes only."""
    import struct

    from writers import pack

    data = pack(image, 12)
    height, width = image.shape
    tags = [
        (256, width),
        (257, height),
        (258, 12),
        (259, 1),
        (262, 1),
        (273, 8),
        (277, 1),
        (278, height),
        (279, len(data)),
    ]
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in tags)
    at = 8 + len(data)
    path.write_bytes(struct.pack("<2sHI", b"II", 42, at) + data + struct.pack("<H", len(tags)) + entries + bytes(4))


@pytest.mark.parametrize("planar", ["contig", "separate"])
def test_colour_becomes_grey(tmp_path: Path, planar: str) -> None:
    colour = np.random.default_rng(6).integers(0, 256, (2, 8, 8, 3)).astype(np.uint8)
    data = colour if planar == "contig" else np.moveaxis(colour, -1, 1)
    tifffile.imwrite(tmp_path / "a.tif", data, photometric="rgb", planarconfig=planar)
    recording = open_recording(tmp_path / "a.tif")
    np.testing.assert_allclose(recording.images(0, 2), colour @ [0.299, 0.587, 0.114], rtol=1e-6)


def test_imagej_states_a_rate_only_with_a_unit(tmp_path: Path) -> None:
    def rate(**metadata: object) -> float | None:
        tifffile.imwrite(tmp_path / "a.tif", IMAGES, imagej=True, metadata={"axes": "TYX", **metadata})
        return open_recording(tmp_path / "a.tif").frame_rate

    assert rate(finterval=0.5, tunit="ms") == pytest.approx(2000)
    assert rate(finterval=0.5) is None
    assert rate(fps=7.0) is None


def test_pages_of_different_sizes_are_refused(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif") as tif:
        tif.write(IMAGES[0])
        tif.write(IMAGES[0, :8])
    with pytest.raises(ValueError, match="page 1"):
        open_recording(tmp_path / "a.tif")


@pytest.mark.parametrize("keep", [4, 9, 300, 3000, 0.999])
def test_a_cut_file_is_refused(tmp_path: Path, keep: float) -> None:
    tifffile.imwrite(tmp_path / "a.tif", IMAGES, photometric="minisblack", compression="zlib")
    data = (tmp_path / "a.tif").read_bytes()
    (tmp_path / "a.tif").write_bytes(data[: int(keep if keep >= 1 else keep * len(data))])
    with pytest.raises((ValueError, OSError), match=r"a\.tif"):
        open_recording(tmp_path / "a.tif").images(0, 6)


def test_a_file_cut_while_open_is_refused_and_its_remaining_images_are_read(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, IMAGES, photometric="minisblack")
    with tifffile.TiffFile(path) as tif:
        end = tif.pages[5].dataoffsets[0] + IMAGES[5].nbytes
    recording = open_recording(path)
    with path.open("r+b") as file:
        file.truncate(end - 10)
    np.testing.assert_array_equal(recording.images(0, 5), IMAGES[:5])
    with pytest.raises(OSError, match=r"a\.tif: cannot be read as a TIFF \(the file ends within .*; the file is cut"):
        recording.images(4, 6)


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("kind", ["<u1", "<u2", ">u2", "<i2", "<u4", "<f4", "<f8"])
def test_levels_of_every_type_are_read_as_stored(tmp_path: Path, kind: str, compression: str | None) -> None:
    stored = np.random.default_rng(3).integers(0, 120, (3, 7, 9)).astype(kind)
    order = ">" if kind[0] == ">" else "<"
    tifffile.imwrite(
        tmp_path / "a.tif", stored, photometric="minisblack", compression=compression, byteorder=order, metadata=None
    )
    images = open_recording(tmp_path / "a.tif").images(1, 3)
    assert images.dtype == np.float32
    assert images.flags.c_contiguous
    np.testing.assert_array_equal(images, stored[1:])


def test_a_real_stack_opens(shared_data: Path) -> None:
    path = shared_data / "tiff" / "pims_tiff_stack.tif"
    recording = open_recording(path)
    np.testing.assert_array_equal(recording.images(0, len(recording)), tifffile.imread(path))


def end_chain(path: Path, pages: int) -> None:
    """Make the chain of pages of a little-endian TIFF end after some pages; the other pages stay in the file."""
    data = bytearray(path.read_bytes())
    at = int.from_bytes(data[4:8], "little")
    for _ in range(pages):
        last = at + 2 + 12 * int.from_bytes(data[at : at + 2], "little")
        at = int.from_bytes(data[last : last + 4], "little")
    data[last : last + 4] = bytes(4)
    path.write_bytes(data)


def write_pages(path: Path, **options: Any) -> None:
    """Write one page after the other, each behind its image, without a description."""
    with tifffile.TiffWriter(path) as writer:
        for image in np.tile(IMAGES, (1, 3, 3)):
            writer.write(image, photometric="minisblack", metadata=None, contiguous=False, **options)


def test_a_chain_of_pages_that_ends_before_the_stated_number_is_damaged(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, IMAGES, photometric="minisblack")
    end_chain(path, 2)
    with pytest.raises(OSError, match="2 of the 6 images that the header states are present"):
        open_recording(path)


@pytest.mark.parametrize("options", [{}, {"compression": "zlib"}], ids=["plain", "compressed"])
def test_a_chain_of_pages_that_ends_early_is_noted_where_no_number_is_stated(
    tmp_path: Path, options: dict[str, Any]
) -> None:
    path = tmp_path / "a.tif"
    write_pages(path, **options)
    assert "chain of pages" not in " ".join(open_recording(path).notes)
    end_chain(path, 2)
    with open_recording(path) as recording:
        assert len(recording) == 2
        assert "more would take: if images are missing, its chain of pages is damaged" in " ".join(recording.notes)


@pytest.mark.parametrize(
    ("axes", "shape", "sentence"),
    [
        ("TCYX", (3, 2, 16, 24), "holds 2 channels of 3 images"),
        ("TZYX", (2, 3, 16, 24), r"holds 3 slices in depth \(z\) of 2 images"),
        ("CZYX", (2, 3, 16, 24), "holds 2 channels of 3 images"),
    ],
)
def test_an_ome_tiff_with_several_axes_is_refused(
    tmp_path: Path, axes: str, shape: tuple[int, ...], sentence: str
) -> None:
    images = IMAGES.reshape(shape)
    tifffile.imwrite(tmp_path / "a.ome.tif", images, ome=True, photometric="minisblack", metadata={"axes": axes})
    with pytest.raises(ValueError, match=sentence):
        open_recording(tmp_path / "a.ome.tif")


@pytest.mark.parametrize(("axes", "note"), [("TYX", ""), ("CYX", "6 images channels"), ("ZYX", "6 images slices")])
def test_an_ome_tiff_of_one_axis_is_a_recording_whatever_the_axis_is_called(
    tmp_path: Path, axes: str, note: str
) -> None:
    tifffile.imwrite(tmp_path / "a.ome.tif", IMAGES, ome=True, photometric="minisblack", metadata={"axes": axes})
    with open_recording(tmp_path / "a.ome.tif") as recording:
        np.testing.assert_array_equal(recording.images(0, 6), IMAGES)
        assert note in " ".join(recording.notes)
        assert bool(note) == ("here they are images in order" in " ".join(recording.notes))


@pytest.mark.parametrize("interval", [10**400, 5e-324, 1e308])
def test_a_frame_interval_that_no_camera_has_is_noted(
    tmp_path: Path, interval: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    tifffile.imwrite(tmp_path / "a.tif", IMAGES, imagej=True, metadata={"axes": "TYX"})
    stated = {"images": 6, "finterval": interval, "tunit": "s"}
    monkeypatch.setattr(tifffile.TiffFile, "imagej_metadata", stated)
    with open_recording(tmp_path / "a.tif") as recording:
        assert recording.frame_rate is None
        assert "which no camera has" in " ".join(recording.notes)


@pytest.mark.parametrize("options", [{}, {"compression": "zlib"}], ids=["plain", "compressed"])
def test_pages_are_walked_once(tmp_path: Path, options: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    write_pages(tmp_path / "a.tif", **options)
    walks, walk = [], tiff._page_tags
    monkeypatch.setattr(tiff, "_page_tags", lambda path: walks.append(path) or walk(path))
    assert len(open_recording(tmp_path / "a.tif")) == 6
    assert len(walks) == 1


def test_pages_whose_tags_lie_in_each_other_are_refused_before_they_are_all_read(tmp_path: Path) -> None:
    # 2000 pages of 2000 tags each in 28 kB: the next page begins two bytes behind the last.
    path, tags, pages = tmp_path / "a.tif", 2000, 2000
    data = bytearray(8 + 2 * pages + 12 * tags + 6 + 4 * pages)
    struct.pack_into("<2sHI", data, 0, b"II", 42, 8)
    for k in range(pages):
        struct.pack_into("<H", data, 8 + 2 * k, tags)
    for k in range(0, pages, 2):
        struct.pack_into("<I", data, 8 + 2 * k + 2 + 12 * tags, 8 + 2 * (k + 2))
    path.write_bytes(data)
    with pytest.raises(OSError, match=r"pages take .* bytes, more than the file has"):
        open_recording(path)
