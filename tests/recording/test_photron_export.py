"""Images that Photron's software exported, with its header beside them."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
from writers import write_mraw

from torchsphere.archive.scan import files_of, scan
from torchsphere.recording import open_recording

IMAGES = np.random.default_rng(4).integers(0, 255, (5, 6, 8)).astype(np.uint8)


def write_export(folder: Path, header: str, *, text: bool = True, single: bool = True, **more: str) -> Path:
    """Write TIFF images with a header of that name, and return what is to be opened."""
    folder.mkdir(exist_ok=True)
    write_mraw(folder / "x", IMAGES, bits=8, depth=8, text=text, File_Format="Tiff", **more)
    (folder / "x.mraw").unlink()
    (folder / ("x.cih" if text else "x.cihx")).rename(folder / header)
    if not single:
        tifffile.imwrite(folder / "shot.tif", IMAGES, photometric="minisblack")
        return folder / "shot.tif"
    for number, image in enumerate(IMAGES):
        tifffile.imwrite(folder / f"shot{number:06d}.tif", image)
    return folder


@pytest.mark.parametrize(
    ("header", "text", "single"),
    [("shot.cih", True, True), ("shot.cihx", False, True), ("shot.cih", True, False), ("other.CIH", True, True)],
)
def test_the_header_gives_rate_exposure_and_trigger(tmp_path: Path, header: str, text: bool, single: bool) -> None:
    place = write_export(tmp_path / "shot", header, text=text, single=single)
    with open_recording(place) as recording:
        np.testing.assert_array_equal(recording.images(0, 5), IMAGES)
        assert recording.frame_rate == 20_000
        assert recording.exposure_s == pytest.approx(1 / 15_371 if text else 1 / 50_000)
        assert recording.trigger_offset_frames == (12 if text else -7)
        assert header in recording.origins["frame_rate"]
        assert "no frame rate" not in " ".join(recording.notes)
        assert recording.files[-1].name == header


def test_a_header_beside_the_folder_with_its_name_counts(tmp_path: Path) -> None:
    folder = write_export(tmp_path / "shot", "shot.cih")
    (folder / "shot.cih").rename(tmp_path / "shot.cih")
    with open_recording(folder) as recording:
        assert recording.frame_rate == 20_000


@pytest.mark.parametrize(
    ("more", "word"),
    [({"Image_Width": "16"}, "16 px wide"), ({"Record_Rate(fps)": "x"}, "no frame rate")],
    ids=["other size", "no rate"],
)
def test_the_header_of_other_images_is_said_and_not_used(tmp_path: Path, more: dict[str, str], word: str) -> None:
    with open_recording(write_export(tmp_path / "shot", "shot.cih", **more)) as recording:
        assert recording.frame_rate is None
        assert word in " ".join(recording.notes)


def test_a_damaged_header_is_said_and_the_images_open(tmp_path: Path) -> None:
    folder = write_export(tmp_path / "shot", "shot.cih")
    (folder / "shot.cih").write_bytes(b"\0" * 40)
    with open_recording(folder) as recording:
        assert recording.frame_rate is None
        assert "was not used" in " ".join(recording.notes)


def test_missing_images_are_said(tmp_path: Path) -> None:
    with open_recording(write_export(tmp_path / "shot", "shot.cih", Total_Frame="9")) as recording:
        assert "states 9 images, and 5 are here" in " ".join(recording.notes)


def test_two_headers_are_none_and_that_of_raw_images_is_theirs(tmp_path: Path) -> None:
    folder = write_export(tmp_path / "shot", "a.cih")
    (folder / "b.cih").write_bytes((folder / "a.cih").read_bytes())
    assert open_recording(folder).frame_rate is None
    (folder / "b.mraw").write_bytes(IMAGES.tobytes())
    assert open_recording(folder).frame_rate == 20_000


def test_an_archive_measures_the_images_and_not_their_header(tmp_path: Path) -> None:
    folder = write_export(tmp_path / "shot", "shot.cih")
    beside = write_export(tmp_path / "beside", "shot.cih", single=False)
    found = scan(tmp_path)
    assert found.recordings == (beside, folder)
    assert not found.notes
    # A changed header is another input.
    before = {place: files_of(place) for place in (folder, beside)}
    for place in (folder, beside.parent):
        header = place / "shot.cih"
        header.write_text(header.read_text("latin-1") + "Comment : changed\n", "latin-1")
    assert all(files_of(place) != before[place] for place in (folder, beside))
