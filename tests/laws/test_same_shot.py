"""The same shot in every file format gives the same track."""

from pathlib import Path

import numpy as np
import pytest
import tifffile

import torchsphere as ts
from torchsphere.synthetic import demo_shot

FRAMES = 12


@pytest.fixture(scope="module")
def images() -> np.ndarray:
    """12-bit levels, so that a format that loses bits fails."""
    return demo_shot.make_shot().images[:FRAMES].astype(np.uint16) * 16


@pytest.fixture(scope="module")
def from_array(images: np.ndarray) -> ts.Track:
    return ts.track(images, sphere_map=False)


def write_tiff(folder: Path, images: np.ndarray) -> Path:
    path = folder / "shot.tif"
    tifffile.imwrite(path, images, photometric="minisblack")
    return path


def write_npy(folder: Path, images: np.ndarray) -> Path:
    np.save(folder / "shot.npy", images)
    return folder / "shot.npy"


def write_mraw(folder: Path, images: np.ndarray) -> Path:
    """Photron header and 12-bit packed raw file: two pixels in three bytes, the first pixel's high bits first."""
    n, height, width = images.shape
    first, second = images.reshape(-1, 2).T
    packed = np.stack((first >> 4, (first & 15) << 4 | second >> 8, second & 255), axis=1).astype(np.uint8)
    (folder / "shot.mraw").write_bytes(packed.tobytes())
    lines = {
        "Record Rate(fps)": 36000,
        "Shutter Speed(s)": "1/81000",
        "Total Frame": n,
        "Start Frame": 0,
        "Image Width": width,
        "Image Height": height,
        "Color Type": "Mono",
        "Color Bit": 12,
        "File Format": "MRaw",
        "EffectiveBit Depth": 12,
        "EffectiveBit Side": "Lower",
    }
    text = "#Camera Information Header\n" + "".join(f"{name} : {value}\n" for name, value in lines.items())
    (folder / "shot.cih").write_text(text)
    return folder / "shot.cih"


def write_video(folder: Path, images: np.ndarray) -> Path:
    """FFV1, which is lossless, in 16-bit grey."""
    av = pytest.importorskip("av", reason="the extra 'video' is not installed")
    path = folder / "shot.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.height, stream.width = images.shape[1:]
        stream.pix_fmt = "gray16le"
        for image in images:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray16le")))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize("write", [write_tiff, write_npy, write_mraw, write_video])
def test_the_same_shot_gives_the_same_track_in_every_format(
    write, tmp_path: Path, images: np.ndarray, from_array: ts.Track
) -> None:
    with ts.open_recording(write(tmp_path, images)) as recording:
        np.testing.assert_array_equal(recording.images(0, FRAMES), images)
        track = ts.track(recording, sphere_map=False)
    assert (from_array.status == "ok").all()
    # The same numbers in the same batches: only rounding may differ.
    np.testing.assert_allclose(track.increment, from_array.increment, rtol=0, atol=1e-6)
    np.testing.assert_allclose(track.position, from_array.position, rtol=0, atol=1e-6)
