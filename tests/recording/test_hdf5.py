"""Images in HDF5 files."""

import gzip
import sys
from pathlib import Path

import numpy as np
import pytest

from torchsphere.recording import open_recording

h5py = pytest.importorskip("h5py", reason="the extra 'export' is not installed")
IMAGES = np.random.default_rng(3).integers(0, 4096, (12, 9, 14)).astype(np.uint16)


def write(path: Path, **datasets: np.ndarray) -> Path:
    with h5py.File(path, "w") as file:
        for name, values in datasets.items():
            file[name.replace("__", "/")] = values
    return path


@pytest.mark.parametrize(
    "options",
    [{}, {"chunks": True}, {"chunks": (1, 9, 14)}, {"chunks": (5, 4, 14), "compression": "gzip", "shuffle": True}],
    ids=["plain", "chunks", "an image each", "packed"],
)
@pytest.mark.parametrize("dtype", ["u1", ">u2", "f4"])
def test_the_only_images_are_read_piece_by_piece(tmp_path: Path, options: dict, dtype: str) -> None:
    images = (IMAGES % 256).astype(dtype)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("camera/images", data=images, **options)
        file["rotations"] = np.zeros((12, 3, 3))
        file["time"] = np.arange(12.0)
    recording = open_recording(tmp_path / "a.h5")
    assert (recording.shape, recording.bit_depth) == (images.shape, 8 if dtype == "u1" else None)
    for start, stop in ((0, 12), (4, 7), (11, 12), (0, 1)):
        np.testing.assert_array_equal(recording.images(start, stop), images[start:stop])
    assert recording.files == (tmp_path / "a.h5",)


@pytest.mark.parametrize("name", ["left", "/left", "group/right"])
def test_a_name_chooses_one_of_several(tmp_path: Path, name: str) -> None:
    path = write(tmp_path / "a.h5", left=IMAGES, group__right=IMAGES[::-1])
    recording = open_recording(f"{path}:{name}")
    np.testing.assert_array_equal(recording[:], IMAGES if "left" in name else IMAGES[::-1])
    assert str(recording.path) == f"{path}:/{name.removeprefix('/')}"


def test_several_are_refused_with_their_shapes_and_an_example(tmp_path: Path) -> None:
    path = write(tmp_path / "a.h5", left=IMAGES, group__right=IMAGES[:4], matrices=np.zeros((12, 3, 3)))
    with pytest.raises(ValueError, match="holds 2 arrays of images") as refused:
        open_recording(path)
    for words in ("left: uint16 (12, 9, 14)", "group/right: uint16 (4, 9, 14)", "name one, as in ", "a.h5:/"):
        assert words in str(refused.value)


def test_a_name_that_is_not_there_is_refused_with_those_that_are(tmp_path: Path) -> None:
    path = write(tmp_path / "a.h5", left=IMAGES)
    with pytest.raises(ValueError, match=r"holds no array 'right'; found left: uint16 \(12, 9, 14\)"):
        open_recording(f"{path}:/right")


@pytest.mark.parametrize(
    "datasets",
    [{}, {"matrices": np.zeros((12, 3, 3))}, {"covariance": np.zeros((12, 5, 5)), "x": np.zeros((7, 7))}],
    ids=["empty", "matrices", "tables"],
)
def test_a_file_of_tables_is_refused(tmp_path: Path, datasets: dict) -> None:
    path = write(tmp_path / "a.h5", **datasets)
    with pytest.raises(ValueError, match="holds 0 arrays of images, expected exactly one"):
        open_recording(path)


@pytest.mark.parametrize("place", ["attribute of the images", "attribute of the group", "attribute", "dataset"])
def test_a_rate_and_an_exposure_that_are_named_so_are_used(tmp_path: Path, place: str) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        images = file.create_dataset("camera/images", data=IMAGES)
        holder = {"attribute of the images": images.attrs, "attribute of the group": file["camera"].attrs}
        target = file if place == "dataset" else holder.get(place, file.attrs)
        target["frame_rate"], target["exposure_s"], target["rate"] = 36000.0, np.array([1e-5]), 25
    recording = open_recording(tmp_path / "a.h5")
    assert (recording.frame_rate, recording.exposure_s) == (36000, 1e-5)
    assert recording.origins["frame_rate"] == "HDF5 frame_rate"


@pytest.mark.parametrize("value", ["1000", np.arange(12.0), b"1000"])
def test_a_rate_that_is_no_number_is_noted(tmp_path: Path, value: object) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["images"] = IMAGES
        file.attrs["fps"] = value
    recording = open_recording(tmp_path / "a.h5")
    assert recording.frame_rate is None
    assert "fps in the file is" in " ".join(recording.notes)


def test_rates_that_contradict_each_other_are_noted(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["images"] = IMAGES
        file.attrs["fps"], file.attrs["frame_rate"] = 25, 1000
    recording = open_recording(tmp_path / "a.h5")
    assert recording.frame_rate == 1000
    assert "fps in the file is 25, and frame_rate is 1000, which is used." in recording.notes


def test_pieces_that_were_never_written_are_noted_and_an_empty_set_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        images = file.create_dataset("images", IMAGES.shape, IMAGES.dtype, chunks=(3, 9, 14))
        images[:7] = IMAGES[:7]
        file.create_dataset("none", IMAGES.shape, IMAGES.dtype, chunks=(3, 9, 14))
    notes = open_recording(tmp_path / "a.h5:/images").notes
    assert "1 of the 4 pieces of the images were never written, and read as their fill value." in notes
    with pytest.raises(OSError, match="none of it was written"):
        open_recording(tmp_path / "a.h5:/none")


def test_images_in_another_file_that_is_missing_are_refused(tmp_path: Path) -> None:
    write(tmp_path / "part.h5", data=IMAGES)
    layout = h5py.VirtualLayout(IMAGES.shape, IMAGES.dtype)
    layout[:] = h5py.VirtualSource("part.h5", "data", IMAGES.shape)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_virtual_dataset("images", layout)
    np.testing.assert_array_equal(open_recording(tmp_path / "a.h5").images(3, 5), IMAGES[3:5])
    (tmp_path / "part.h5").unlink()
    with pytest.raises(OSError, match=r"its images lie in part\.h5, which is missing"):
        open_recording(tmp_path / "a.h5")


def test_cut_and_changed_files_are_refused_or_read(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("images", data=IMAGES, chunks=(3, 9, 14), compression="gzip", fletcher32=True)
    data = (tmp_path / "a.h5").read_bytes()
    rng = np.random.default_rng(0)
    path, refused = tmp_path / "b.h5", []
    cuts = [data[:length] for length in (20, 600, len(data) // 2, len(data) - 1)]
    for content in (*cuts, *(bytes(_flipped(data, rng)) for _ in range(40))):
        path.write_bytes(content)
        try:
            open_recording(path)[:]
        except (ValueError, OSError) as error:
            refused.append(str(error))
    assert len(refused) >= len(cuts)
    assert all(sentence.startswith(str(path)) and "\n" not in sentence for sentence in refused)


def _flipped(data: bytes, rng: np.random.Generator) -> bytearray:
    broken = bytearray(data)
    for at in rng.integers(0, len(data), 8):
        broken[at] ^= 1 << int(rng.integers(0, 8))
    return broken


def test_a_missing_library_names_the_extra_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "a.h5", images=IMAGES)
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(OSError, match=r'run: pip install "torchsphere\[export\]"') as refused:
        open_recording(path)
    assert "damaged" not in str(refused.value)


def test_other_contents_under_the_name_of_hdf5_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.h5").write_bytes(gzip.compress(b"text"))
    with pytest.raises(ValueError, match="looks like a gzip archive, expected an HDF5 file after its name"):
        open_recording(tmp_path / "a.h5")
