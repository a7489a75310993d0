"""NPY and NPZ."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from torchsphere.recording import open_recording

IMAGES = np.random.default_rng(3).integers(0, 4096, (7, 5, 6)).astype(np.uint16)


@pytest.mark.parametrize("order", ["C", "F"])
def test_an_npy_gives_the_saved_levels(tmp_path: Path, order: str) -> None:
    np.save(tmp_path / "a.npy", np.asarray(IMAGES, order=order))
    recording = open_recording(tmp_path / "a.npy")
    np.testing.assert_array_equal(recording.images(2, 6), IMAGES[2:6])
    assert recording.images(0, 1).dtype == np.float32
    assert recording.frame_rate is None


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_an_npz_is_read_forwards_and_backwards_with_its_scalars(tmp_path: Path, save: object) -> None:
    save(tmp_path / "a.npz", images=IMAGES, frame_rate=500.0, exposure_s=1e-4)  # type: ignore[operator]
    with open_recording(tmp_path / "a.npz") as recording:
        for start, stop in ((0, 2), (5, 7), (1, 4), (0, 7)):
            np.testing.assert_array_equal(recording.images(start, stop), IMAGES[start:stop])
        assert (recording.frame_rate, recording.exposure_s) == (500.0, 1e-4)
        assert recording.origins["frame_rate"] == "NPZ frame_rate"


@pytest.mark.parametrize(
    ("value", "told"),
    [("1/1000", "<U6 ()"), (np.full(7, 1e-4), "float64 (7,)"), (None, "object ()"), (True, "bool ()")],
    ids=["text", "several", "none", "bool"],
)
@pytest.mark.parametrize("name", ["exposure_s", "frame_rate"])
def test_an_npz_scalar_that_is_not_a_number_is_noted_and_not_used(
    tmp_path: Path, name: str, value: object, told: str
) -> None:
    np.savez(tmp_path / "a.npz", images=IMAGES, **{name: value})  # type: ignore[arg-type]
    with open_recording(tmp_path / "a.npz") as recording:
        assert getattr(recording, name) is None
        assert f"{name} in the file is {told}, not a single number, so it is not used" in " ".join(recording.notes)
        np.testing.assert_array_equal(recording.images(0, 2), IMAGES[:2])


def test_the_refusal_of_an_npz_with_several_stacks_names_them(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", left=IMAGES, right=IMAGES)
    with pytest.raises(ValueError, match=r"left.*right"):
        open_recording(tmp_path / "a.npz")


def test_colour_becomes_grey(tmp_path: Path) -> None:
    colour = np.random.default_rng(4).integers(0, 256, (2, 5, 6, 3)).astype(np.uint8)
    np.save(tmp_path / "a.npy", colour)
    recording = open_recording(tmp_path / "a.npy")
    np.testing.assert_allclose(recording.images(0, 2), colour @ [0.299, 0.587, 0.114], rtol=1e-6)
    assert "Rec. 601" in " ".join(recording.notes)


@pytest.mark.parametrize(
    "array",
    [
        np.zeros((4, 4)),
        np.zeros((0, 4, 4)),
        np.zeros((2, 4, 4, 2)),
        np.zeros((2, 4, 4), complex),
        np.full((2, 4, 4), "a"),
        np.full((2, 4, 4), np.nan),
        np.full((2, 4, 4), None, object),
    ],
    ids=["one image", "no image", "two channels", "complex", "text", "nan", "objects"],
)
def test_arrays_other_than_images_are_refused(tmp_path: Path, array: np.ndarray) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(ValueError, match=r"a\.npy"):
        open_recording(tmp_path / "a.npy")


def test_the_refusal_of_an_infinite_value_names_its_image(tmp_path: Path) -> None:
    array = np.zeros((4, 4, 4))
    array[2, 1, 1] = np.inf
    np.save(tmp_path / "a.npy", array)
    recording = open_recording(tmp_path / "a.npy")
    with pytest.raises(ValueError, match=r"image 2 .* replace them in the file"):
        recording.images(0, 4)


@pytest.mark.parametrize(
    ("shape", "dtype"), [((1, 5800, 5800, 4), "u2"), ((1, 8192, 4100), "f8"), ((1, 1 << 14, 1 << 13), "u1")]
)
def test_an_archive_of_images_larger_than_any_camera_s_is_refused_before_it_is_unpacked(
    tmp_path: Path, shape: tuple[int, ...], dtype: str
) -> None:
    path = tmp_path / "a.npz"
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": f"<{dtype}", "fortran_order": False, "shape": shape})
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("a.npy", "w") as member:
        member.write(head.getvalue())
        left = int(np.prod(shape)) * np.dtype(dtype).itemsize
        while left:
            left -= member.write(bytes(min(left, 1 << 24)))
    with pytest.raises(ValueError, match=r"which no camera gives|which no recording has"):
        open_recording(path)


def test_the_directory_of_an_archive_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    np.savez(
        tmp_path / "a.npz", images=np.zeros((2, 3, 4), np.uint8), frame_rate=10.0, **{f"x{i}": 0 for i in range(99)}
    )
    opened = []
    original = zipfile.ZipFile._RealGetContents
    monkeypatch.setattr(zipfile.ZipFile, "_RealGetContents", lambda self: opened.append(1) or original(self))
    assert open_recording(tmp_path / "a.npz").frame_rate == 10
    assert len(opened) == 1
