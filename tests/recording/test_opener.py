"""Refusals of files, and the contract of Recording."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest
import tifffile
from writers import write_cine, write_mraw

from torchsphere.recording import Recording, open_recording

IMAGES = np.random.default_rng(10).integers(0, 256, (4, 12, 16)).astype(np.uint8)


def _tiff(folder: Path) -> Path:
    tifffile.imwrite(folder / "a.tif", IMAGES, photometric="minisblack", compression="zlib")
    return folder / "a.tif"


def _plain_tiff(folder: Path) -> Path:
    tifffile.imwrite(folder / "a.tif", IMAGES, photometric="minisblack", imagej=True)
    return folder / "a.tif"


def _png(folder: Path) -> Path:
    (folder / "p").mkdir(exist_ok=True)
    (folder / "p" / "a.png").write_bytes(imagecodecs.png_encode(IMAGES[0]))
    return folder / "p" / "a.png"


def _npy(folder: Path) -> Path:
    np.save(folder / "a.npy", IMAGES)
    return folder / "a.npy"


def _npz(folder: Path) -> Path:
    np.savez_compressed(folder / "a.npz", images=IMAGES, frame_rate=10.0)
    return folder / "a.npz"


def _cine(folder: Path) -> Path:
    return write_cine(folder / "a.cine", IMAGES.astype(int), bits=10)


def _cihx(folder: Path) -> Path:
    return write_mraw(folder / "a", IMAGES.astype(int), bits=12, depth=12)


def _cih(folder: Path) -> Path:
    return write_mraw(folder / "b", IMAGES.astype(int), bits=8, depth=8, text=True)


def _avi(folder: Path) -> Path:
    av = pytest.importorskip("av", reason="PyAV is not installed")
    with av.open(str(folder / "a.avi"), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.height, stream.width, stream.pix_fmt = 12, 16, "gray"
        for image in IMAGES:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray")))
        container.mux(stream.encode(None))
    return folder / "a.avi"


WRITERS = [_tiff, _plain_tiff, _png, _npy, _npz, _cine, _cihx, _cih, _avi]


def _refused(path: Path) -> bool:
    """Whether opening or reading raises one of the two documented types of error; other errors fail the test."""
    target = path.parent if path.suffix == ".png" else path
    try:
        with open_recording(target) as recording:
            for start in range(min(len(recording), 20)):
                recording.images(start, start + 1)
    except (ValueError, OSError) as error:
        text = str(error)
        assert len(text) > 20
        assert "\n" not in text
        return True
    return False


@pytest.mark.parametrize("write", WRITERS)
def test_cut_files_raise_only_value_and_os_errors(tmp_path: Path, write: Callable[[Path], Path]) -> None:
    path = write(tmp_path)
    data = path.read_bytes()
    refused = {}
    for length in sorted({1, 3, 8, 20, 45, 90, 129, len(data) // 2, len(data) - 40, len(data) - 1}):
        path.write_bytes(data[: max(1, length)])
        refused[length] = _refused(path)
    # The last bytes may be padding or an index; a recording needs more than half of its bytes.
    assert all(is_refused for length, is_refused in refused.items() if length <= len(data) // 2), refused


@pytest.mark.parametrize("write", WRITERS)
def test_flipped_bits_raise_only_value_and_os_errors(tmp_path: Path, write: Callable[[Path], Path]) -> None:
    rng = np.random.default_rng(11)
    path = write(tmp_path)
    data = path.read_bytes()
    refused = []
    for _ in range(60):
        broken = bytearray(data)
        for at in rng.integers(0, min(len(data), 400), rng.integers(1, 4)):
            broken[at] ^= 1 << int(rng.integers(0, 8))
        path.write_bytes(broken)
        refused.append(_refused(path))
    # Most flips change bytes that the reader needs, so a reader without any refusal checks nothing.
    assert any(refused)


def test_importing_loads_neither_video_nor_figure_libraries() -> None:
    code = (
        "import sys, torchsphere.recording.opener; print([m for m in ('av', 'cv2', 'matplotlib') if m in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_a_missing_path_and_an_empty_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="does not exist"):
        open_recording(tmp_path / "a.tif")
    (tmp_path / "a.tif").touch()
    with pytest.raises(ValueError, match="is empty"):
        open_recording(tmp_path / "a.tif")


def test_the_refusal_of_a_suffix_lists_the_supported_suffixes(tmp_path: Path) -> None:
    (tmp_path / "a.pdf").write_bytes(b"%PDF-1.7")
    with pytest.raises(ValueError, match=r"a PDF document.*\.cine"):
        open_recording(tmp_path / "a.pdf")


@pytest.mark.parametrize(
    ("name", "content", "look"),
    [
        ("a.tif", imagecodecs.png_encode(IMAGES[0]), "a PNG image"),
        ("a.cine", b"II*\0" + bytes(40), "a TIFF image"),
        ("a.mp4", b"just some words\n", "text"),
        ("a.npy", b"PK\x03\x04" + bytes(40), "a ZIP archive"),
        ("a.cih", b"nothing of the kind", "text"),
        ("a.cihx", b"nothing of the kind", "text"),
    ],
)
def test_the_refusal_of_a_misnamed_file_states_its_type(tmp_path: Path, name: str, content: bytes, look: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match=look):
        open_recording(tmp_path / name)


@pytest.mark.parametrize("span", [(-1, 2), (2, 2), (3, 2), (0, 5), (0.0, 2), ("a", "b")])
def test_a_range_outside_the_recording_is_refused(tmp_path: Path, span: tuple[int, int]) -> None:
    recording = open_recording(_npy(tmp_path))
    with pytest.raises(ValueError, match="the recording has 4"):
        recording.images(*span)


def test_a_recording_cannot_be_changed(tmp_path: Path) -> None:
    recording = open_recording(_npy(tmp_path))
    assert isinstance(recording, Recording)
    assert len(recording) == 4
    with pytest.raises(AttributeError):
        recording.frame_rate = 1.0  # type: ignore[misc]


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="resident memory is read from Linux's /proc")
@pytest.mark.parametrize("suffix", ["npy", "tif", "mraw", "h5"])
def test_memory_does_not_grow_with_the_images_read(tmp_path: Path, suffix: str) -> None:
    images = np.zeros((1500, 128, 128), np.uint16)
    if suffix == "npy":
        np.save(tmp_path / "a.npy", images)
    elif suffix == "tif":
        tifffile.imwrite(tmp_path / "a.tif", images, photometric="minisblack")
    elif suffix == "h5":
        h5py = pytest.importorskip("h5py", reason="the extra 'export' is not installed")
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file.create_dataset("images", data=images, chunks=(20, 64, 128))
    else:
        write_mraw(tmp_path / "a", images, bits=16, depth=12)
    recording = open_recording(tmp_path / f"a.{suffix}")
    del images

    def resident() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    recording.images(0, 10)
    before = resident()
    for start in range(0, 1500, 10):
        recording.images(start, start + 10)
    # The file has 49 MB; ten images as float32 have 0.7 MB.
    assert resident() - before < 10e6


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (None, "got NoneType; give text"),
        (5, "got int; give text"),
        (b"shot.tif", "got bytes; give text"),
        (np.zeros((3, 8, 8)), "got ndarray; give it to torchsphere.track as it is"),
    ],
)
def test_objects_other_than_paths_are_refused_in_a_sentence(given: Any, sentence: str) -> None:
    with pytest.raises(TypeError, match=sentence) as caught:
        open_recording(given)
    assert "expected the path of a recording" in str(caught.value)
    assert "\n" not in str(caught.value)
