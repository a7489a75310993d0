"""The same shot in every file format gives the same images and the same track."""

from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image
from scipy.io import savemat

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


def write_turned(folder: Path, images: np.ndarray) -> Path:
    np.save(folder / "shot.npy", np.moveaxis(images, 0, 2))
    return folder / "shot.npy"


def write_hdf5(folder: Path, images: np.ndarray) -> Path:
    h5py = pytest.importorskip("h5py", reason="the extra 'export' is not installed")
    with h5py.File(folder / "shot.h5", "w") as file:
        file.create_dataset("camera/left", data=images, chunks=(5, 64, 128), compression="gzip")
        file["camera/right"] = images[::-1]
    return Path(f"{folder}/shot.h5:/camera/left")


def write_mat(folder: Path, images: np.ndarray) -> Path:
    savemat(folder / "shot.mat", {"frames": np.moveaxis(images, 0, 2)}, do_compression=True)
    return folder / "shot.mat"


def write_mat_73(folder: Path, images: np.ndarray) -> Path:
    """HDF5 with the axes in the opposite order, as MATLAB 7.3 writes it."""
    h5py = pytest.importorskip("h5py", reason="the extra 'export' is not installed")
    with h5py.File(folder / "shot.mat", "w", userblock_size=512) as file:
        file.create_dataset("frames", data=np.moveaxis(images, 0, 2).T, chunks=True, compression="gzip")
    with (folder / "shot.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124))
    return folder / "shot.mat"


def write_pgm(folder: Path, images: np.ndarray) -> Path:
    for k, image in enumerate(images):
        head = f"P5 {image.shape[1]} {image.shape[0]} 4095\n".encode()
        (folder / f"img{k}.pgm").write_bytes(head + image.astype(">u2").tobytes())
    return folder


def write_png(folder: Path, images: np.ndarray) -> Path:
    for k, image in enumerate(images):
        Image.fromarray(image).save(folder / f"img{k}.png")
    return folder


def write_bmp(folder: Path, images: np.ndarray) -> Path:
    for k, image in enumerate(images):
        Image.fromarray(image).save(folder / f"img{k}.bmp")
    return folder


def write_webp(folder: Path, images: np.ndarray) -> Path:
    for k, image in enumerate(images):
        Image.fromarray(image).save(folder / f"img{k}.webp", lossless=True)
    return folder


def write_jpeg(folder: Path, images: np.ndarray) -> Path:
    for k, image in enumerate(images):
        Image.fromarray(image).save(folder / f"img{k}.jpg", quality=90)
    return folder


def write_packed_video(folder: Path, images: np.ndarray) -> Path:
    """Levels of 8 bit with colour between them, as many USB cameras send them."""
    av = pytest.importorskip("av", reason="the extra 'video' is not installed")
    path = folder / "shot.avi"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("rawvideo", rate=25)
        stream.height, stream.width = images.shape[1:]
        stream.pix_fmt = "yuyv422"
        for image in images:
            frame = av.VideoFrame(image.shape[1], image.shape[0], "yuyv422")
            frame.planes[0].update(np.stack((image, np.full_like(image, 128)), -1).tobytes())
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize(
    ("write", "options"),
    [
        (write_turned, {"axes": "hwn"}),
        *((write, {}) for write in (write_hdf5, write_mat, write_mat_73, write_pgm, write_png)),
    ],
)
def test_the_same_shot_in_12_bit_gives_the_same_images(
    write, options: dict[str, str], tmp_path: Path, images: np.ndarray
) -> None:
    with ts.open_recording(write(tmp_path, images), **options) as recording:
        np.testing.assert_array_equal(recording.images(0, FRAMES), images)
        np.testing.assert_array_equal(recording.images(7, 9), images[7:9])


@pytest.mark.parametrize("write", [write_bmp, write_webp, write_packed_video])
def test_the_same_shot_in_8_bit_gives_the_same_images(write, tmp_path: Path, images: np.ndarray) -> None:
    levels = (images // 16).astype(np.uint8)
    with ts.open_recording(write(tmp_path, levels)) as recording:
        # WebP has colours, whose weights add up to 1 but for rounding.
        np.testing.assert_allclose(recording.images(0, FRAMES), levels, rtol=1e-6)


def test_the_same_shot_after_a_compression_with_losses_gives_the_same_track_within_its_errors(
    tmp_path: Path, images: np.ndarray, from_array: ts.Track
) -> None:
    levels = (images // 16).astype(np.uint8)
    with ts.open_recording(write_jpeg(tmp_path, levels)) as recording:
        assert 0.3 < np.abs(recording.images(0, FRAMES) - levels).mean() < 3
        track = ts.track(recording, sphere_map=False)
    assert (track.status == "ok").all()
    sd = np.sqrt(np.diagonal(track.covariance, axis1=1, axis2=2))
    # All 55 numbers; of normal errors one in 16,000 is beyond 4 standard deviations.
    assert (np.abs(track.increment - from_array.increment) < 4 * sd).all()
    assert (sd >= 0.9 * np.sqrt(np.diagonal(from_array.covariance, axis1=1, axis2=2))).all()


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
