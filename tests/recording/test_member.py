"""Names of one array within a file."""

from pathlib import Path

import pytest

from torchsphere.recording.member import flat_name, joined, split


@pytest.mark.parametrize(
    ("text", "file", "name"),
    [
        ("shot.h5:/camera/images", "shot.h5", "camera/images"),
        ("shot.h5:images", "shot.h5", "images"),
        ("a/b.c/shot.HDF5:/x", "a/b.c/shot.HDF5", "x"),
        ("shot.mat:frames", "shot.mat", "frames"),
        ("shot.npz:/left", "shot.npz", "left"),
        ("shot.h5:/a.h5:/b", "shot.h5", "a.h5:/b"),
        ("C:/data/shot.h5:/x", "C:/data/shot.h5", "x"),
        ("C:\\data\\shot.h5", "C:\\data\\shot.h5", ""),
        ("C:/data/shot.h5", "C:/data/shot.h5", ""),
        ("shot.h5", "shot.h5", ""),
        ("shot.h5:/", "shot.h5:", ""),
        ("shot.npy:/x", "shot.npy:/x", ""),
        ("12:30.tif", "12:30.tif", ""),
    ],
)
def test_a_name_behind_a_colon_is_that_of_an_array(text: str, file: str, name: str) -> None:
    assert split(Path(text)) == (Path(file), name)


def test_a_file_of_such_a_name_is_that_file(tmp_path: Path) -> None:
    path = tmp_path / "shot.h5:x"
    path.touch()
    assert split(path) == (path, "")


def test_an_array_has_a_flat_name_for_files_that_are_made_of_it() -> None:
    path = joined(Path("a/shot.h5"), "camera/images")
    assert split(path) == (Path("a/shot.h5"), "camera/images")
    assert flat_name(path) == "shot-camera-images"
    assert flat_name(Path("a/shot.h5")) == "shot"
