"""Damaged recordings of all formats: ``python -m experiments.validation.fuzz``.

Each file is a small recording with bytes changed, removed, inserted or repeated at random places, or cut. The file is
opened and read to its end.

Claim: a damaged recording is refused in a sentence, or read. No other error comes out, no frame is lost without a word,
and no file takes 1 GB of memory. Changed grey levels cannot be seen in formats without a checksum.

A number after the command is that of files per format (1000); 64 more of each format are cut. The run takes some
minutes.
"""

from __future__ import annotations

import logging
import multiprocessing
import resource
import shutil
import struct
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray
from scipy.io import savemat

from experiments.experiment import publish, table
from torchsphere.recording import open_recording

FILES, CUTS, FRAMES, SEED = 1000, 64, 12, 4
#: What became of a file, in the order of the table.
SAME, CHANGED, TOLD, SILENT, REFUSED, FOREIGN = (
    "as written",
    "levels changed",
    "fewer, said",
    "SILENT",
    "refused",
    "FOREIGN",
)
OUTCOMES = (REFUSED, SAME, CHANGED, TOLD, SILENT, FOREIGN)


def _images() -> NDArray[np.uint8]:
    ramp = np.add.outer(np.arange(32), 3 * np.arange(48)) % 251
    noise = np.random.default_rng(SEED).integers(0, 5, (FRAMES, 32, 48))
    return (np.stack([np.roll(ramp, i, 1) for i in range(FRAMES)]) + noise).astype(np.uint8)


def _tiff(**options: Any) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        tifffile.imwrite(path, _images(), photometric="minisblack", **options)

    return write


def _pages(path: Path) -> None:
    with tifffile.TiffWriter(path) as writer:
        for image in _images():
            writer.write(image, photometric="minisblack", metadata=None, contiguous=False)


def _video(codec: str, pixels: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        import av

        with av.open(str(path), "w") as container:
            stream: Any = container.add_stream(codec, rate=Fraction(25))
            stream.height, stream.width, stream.pix_fmt = 32, 48, pixels
            for image in _images():
                container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray").reformat(format=pixels)))
            container.mux(stream.encode(None))

    return write


def _photron(path: Path) -> None:
    n, height, width = _images().shape
    path.with_suffix(".mraw").write_bytes(_images().tobytes())
    size = f"<resolution><width>{width}</width><height>{height}</height></resolution>"
    path.write_text(
        f"<cih><imageDataInfo>{size}<colorInfo><type>Mono</type><bit>8</bit></colorInfo><effectiveBit><depth>8</depth>"
        f"<side>Lower</side></effectiveBit></imageDataInfo><frameInfo><totalFrame>{n}</totalFrame></frameInfo>"
        "<recordInfo><recordRate>20000</recordRate></recordInfo></cih>"
    )


def _cine(path: Path) -> None:
    """A Phantom file of version 1: header, bitmap header, camera settings, table of places, images bottom up."""
    n, height, width = _images().shape
    setup = bytearray(1572)
    struct.pack_into("<2sH", setup, 140, b"ST", len(setup))
    struct.pack_into("<II", setup, 768, 70000, 3)
    table_at, image_bytes = 84 + len(setup), height * width
    first = table_at + 8 * n
    head = struct.pack("<2sHHHiIiIIIIQ", b"CI", 44, 0, 1, -3, n, -3, n, 44, 84, table_at, 0)
    bitmap = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 8, 0, image_bytes, 0, 0, 0, 0)
    places = struct.pack(f"<{n}Q", *(first + k * (8 + image_bytes) for k in range(n)))
    blocks = (struct.pack("<II", 8, image_bytes) + image[::-1].tobytes() for image in _images())
    path.write_bytes(head + bitmap + bytes(setup) + places + b"".join(blocks))


def _hdf5(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file.create_dataset("images", data=_images(), chunks=(3, 32, 48), compression="gzip", fletcher32=True)


def _mat(path: Path) -> None:
    savemat(path, {"images": _images().transpose(1, 2, 0)}, do_compression=True)


#: Name of the format, and of the file, and the function that writes the file.
FORMATS: dict[str, tuple[str, Callable[[Path], None]]] = {
    "TIFF": ("a.tif", _tiff()),
    "TIFF, ImageJ": ("a.tif", _tiff(imagej=True, metadata={"axes": "TYX"})),
    "TIFF, OME": ("a.ome.tif", _tiff(ome=True, metadata={"axes": "TYX"})),
    "TIFF, zlib": ("a.tif", _tiff(compression="zlib")),
    "TIFF, page by page": ("a.tif", _pages),
    "NPY": ("a.npy", lambda path: np.save(path, _images())),
    "NPZ": ("a.npz", lambda path: np.savez_compressed(path, images=_images(), frame_rate=1000.0)),
    "HDF5": ("a.h5", _hdf5),
    "MAT": ("a.mat", _mat),
    "Photron header": ("a.cihx", _photron),
    "Phantom CINE": ("a.cine", _cine),
    "AVI, FFV1": ("a.avi", _video("ffv1", "gray")),
    "AVI, MPEG-4": ("a.avi", _video("mpeg4", "yuv420p")),
    "MP4, MPEG-4": ("a.mp4", _video("mpeg4", "yuv420p")),
    "MOV, MJPEG": ("a.mov", _video("mjpeg", "yuvj420p")),
    "MKV, FFV1": ("a.mkv", _video("ffv1", "gray")),
    "MKV, MPEG-4": ("a.mkv", _video("mpeg4", "yuv420p")),
    "WebM, VP8": ("a.webm", _video("libvpx", "yuv420p")),
}


def mutations(data: bytes, count: int, random: np.random.Generator) -> Iterator[bytes]:
    """Damaged copies of a file: `CUTS` are cut, of ``count`` one to three places are changed, half in the header."""
    for k in range(CUTS):
        yield data[: len(data) * k // CUTS]
    for _ in range(count):
        copy = bytearray(data)
        for _ in range(int(random.integers(1, 4))):
            reach = min(len(copy), 512) if random.random() < 0.5 else len(copy)
            at, length = int(random.integers(0, max(1, reach))), int(random.integers(1, 9))
            kind = random.integers(0, 5)
            if kind == 0:
                copy[at : at + length] = random.bytes(length)
            elif kind == 1:
                copy[at : at + length] = b"\xff" * length if random.random() < 0.5 else bytes(length)
            elif kind == 2:
                del copy[at : at + length]
            elif kind == 3:
                copy[at:at] = copy[at : at + length]
            else:
                copy[at : at + 1] = bytes([copy[at] ^ 1 << int(random.integers(0, 8))]) if at < len(copy) else b""
        yield bytes(copy)


def outcome(path: Path, whole: NDArray[Any]) -> tuple[str, str]:
    """What became of a damaged file, and the words of an error that should not come out."""
    try:
        with open_recording(path) as recording:
            notes = " ".join(recording.notes)
            images = np.concatenate([recording.images(k, k + 1) for k in range(min(len(recording), 4 * FRAMES))])
    except (ValueError, OSError) as error:
        return (
            (REFUSED, "") if str(error).startswith(str(path.parent)) else (FOREIGN, f"{type(error).__name__}: {error}")
        )
    except Exception as error:
        return FOREIGN, f"{type(error).__name__}: {error}"
    if images.shape == whole.shape:
        return (SAME if np.array_equal(images, whole) else CHANGED), ""
    if images.shape[1:] != whole.shape[1:] or len(images) > len(whole):
        return CHANGED, ""
    return (TOLD if "missing" in notes or "room for" in notes else SILENT), f"{len(images)} of {len(whole)} images"


def _try_format(name: str, count: int, found: Any) -> None:
    """Try all damaged copies of one format, in a process of its own, whose memory is that of the format."""
    # Libraries tell each damaged tag.
    warnings.simplefilter("ignore")
    logging.disable()
    file, write = FORMATS[name]
    folder = Path(tempfile.mkdtemp())
    path = folder / file
    write(path)
    with open_recording(path) as recording:
        whole = recording.images(0, len(recording))
    data, random = path.read_bytes(), np.random.default_rng(SEED)
    counts, words = Counter[str](), []
    for copy in mutations(data, count, random):
        path.write_bytes(copy)
        kind, why = outcome(path, whole)
        counts[kind] += 1
        if kind in (SILENT, FOREIGN):
            words.append(why.replace(str(folder), ""))
    shutil.rmtree(folder)
    found.send((dict(counts), words, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3))


def compute(count: int = FILES) -> dict[str, Any]:
    """Counts of outcomes, words of what should not be, and the peak of the memory in MB, by format."""
    context, all_found = multiprocessing.get_context("spawn"), {}
    for name in FORMATS:
        here, there = context.Pipe()
        process = context.Process(target=_try_format, args=(name, count, there))
        process.start()
        there.close()
        try:
            all_found[name] = here.recv()
        except EOFError:
            all_found[name] = {FOREIGN: 1}, ["the process died"], 0.0
        process.join()
        print(
            name, *all_found[name][:1], f"{all_found[name][2]:.0f} MB", *all_found[name][1][:8], sep="\n  ", flush=True
        )
    return all_found


def main() -> None:
    """Try all formats, and write the table of the page."""
    found = compute(int(sys.argv[1]) if len(sys.argv) > 1 else FILES)
    total = Counter[str]()
    lines = []
    for name, (counts, _, peak) in found.items():
        total.update(counts)
        lines.append((name, sum(counts.values()), *(counts.get(kind, 0) for kind in OUTCOMES), f"{peak:.0f}"))
    lines.append(
        ("all", total.total(), *(total[kind] for kind in OUTCOMES), f"{max(f[2] for f in found.values()):.0f}")
    )
    names = ("refused", "as written", "levels changed", "fewer images, said so", "fewer, silently", "other errors")
    text = table(("format", "files", *names, "peak, MB"), lines)
    publish("fuzz", "validation.fuzz", text, "")


if __name__ == "__main__":
    main()
