"""Images in MAT files of MATLAB."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from torchsphere.recording import open_recording

IMAGES = np.random.default_rng(3).integers(0, 256, (12, 9, 14)).astype(np.uint8)
#: In MATLAB: rows, columns, number.
STACK = IMAGES.transpose(1, 2, 0)


def write_73(path: Path, **arrays: np.ndarray) -> Path:
    """A file as MATLAB 7.3 writes it: HDF5 behind 512 bytes, with the axes in the opposite order."""
    h5py = pytest.importorskip("h5py", reason="the extra 'export' is not installed")
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in arrays.items():
            file.create_dataset(name, data=np.asarray(values).T, chunks=True if np.ndim(values) > 2 else None)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan  1 00:00:00 2024".ljust(124))
    return path


def write_5(path: Path, **arrays: np.ndarray) -> Path:
    savemat(path, arrays)
    return path


def write_7(path: Path, **arrays: np.ndarray) -> Path:
    savemat(path, arrays, do_compression=True)
    return path


WRITERS = pytest.mark.parametrize("write", [write_5, write_7, write_73])


@WRITERS
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float64])
def test_a_stack_as_matlab_has_it_gives_the_images_upright(tmp_path: Path, write, dtype: type) -> None:
    path = write(tmp_path / "a.mat", frames=STACK.astype(dtype), fps=np.array([[1000.0]]), K=np.eye(3))
    with open_recording(path) as recording:
        assert (recording.shape, recording.frame_rate) == (IMAGES.shape, 1000)
        assert recording.origins["frame_rate"] == "MAT fps"
        assert recording.bit_depth == (8 if dtype is np.uint8 else None)
        for start, stop in ((0, 12), (4, 7), (11, 12)):
            np.testing.assert_array_equal(recording.images(start, stop), IMAGES[start:stop])
        recording.close()
        np.testing.assert_array_equal(recording.images(2, 3), IMAGES[2:3])


@WRITERS
def test_a_name_chooses_one_of_several_and_axes_turn_it(tmp_path: Path, write) -> None:
    path = write(tmp_path / "a.mat", left=STACK, right=IMAGES)
    with pytest.raises(ValueError, match=r"holds 2 arrays of images, .* as in .*a\.mat:/left"):
        open_recording(path)
    np.testing.assert_array_equal(open_recording(f"{path}:left")[:], IMAGES)
    np.testing.assert_array_equal(open_recording(f"{path}:/right", axes="nhw")[:], IMAGES)


@WRITERS
def test_a_file_without_images_lists_what_it_holds(tmp_path: Path, write) -> None:
    path = write(tmp_path / "a.mat", K=np.eye(3), rotations=np.zeros((3, 3, 50)))
    with pytest.raises(ValueError, match=r"holds 0 arrays of images, .* K: float64 \(3, 3\)"):
        open_recording(path)


def test_arrays_that_are_no_levels_are_refused(tmp_path: Path) -> None:
    path = write_5(tmp_path / "a.mat", frames=STACK * (1 + 1j), words="text", cells=np.array([1, "a"], object))
    with pytest.raises(ValueError, match=r"frames is complex128 .*, expected float64 .* of plain grey levels"):
        open_recording(path)[:]
    with pytest.raises(ValueError, match="holds values of type object"):
        open_recording(f"{path}:cells")


def test_cut_files_are_refused(tmp_path: Path) -> None:
    data = write_7(tmp_path / "a.mat", frames=STACK).read_bytes()
    for length in (1, 50, 130, 200, len(data) // 2, len(data) - 9):
        (tmp_path / "b.mat").write_bytes(data[:length])
        with pytest.raises((ValueError, OSError), match=r"b\.mat") as refused:
            open_recording(tmp_path / "b.mat")[:]
        assert "\n" not in str(refused.value)
