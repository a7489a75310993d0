"""The types of files by their content, and what a folder is said to hold."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.io import savemat

from torchsphere.recording import open_recording
from torchsphere.recording.refusal import look_of, looks_like, what_lies_in

RNG = np.random.default_rng(5)


def zipped(*names: str) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name in names:
            archive.writestr(name, "content")
    return data.getvalue()


def picture(kind: str, **options: object) -> bytes:
    data = io.BytesIO()
    Image.fromarray(RNG.integers(0, 256, (12, 16), dtype=np.uint8)).save(data, kind, **options)
    return data.getvalue()


def animation() -> bytes:
    data = io.BytesIO()
    frames = [Image.fromarray(RNG.integers(0, 256, (12, 16), dtype=np.uint8)) for _ in range(3)]
    frames[0].save(data, "GIF", save_all=True, append_images=frames[1:])
    return data.getvalue()


def matlab(version: str) -> bytes:
    data = io.BytesIO()
    savemat(data, {"a_1": np.eye(3)}, format=version)
    return data.getvalue()


def ebml(kind: bytes) -> bytes:
    inner = b"\x42\x86\x81\x01" + b"\x42\x82" + bytes([0x80 | len(kind)]) + kind + b"\x42\x87\x81\x02"
    return b"\x1aE\xdf\xa3" + bytes([0x80 | len(inner)]) + inner + bytes(RNG.integers(0, 256, 300, dtype=np.uint8))


def dim(low: int, high: int) -> bytes:
    """Levels of an image in 8 bit, between those of two characters."""
    return RNG.integers(low, high, 6000, dtype=np.uint8).tobytes()


#: Name of the kind, content, and what the content is told to be.
KINDS: dict[str, tuple[bytes, str]] = {
    "text": (b"just some words\n", "text"),
    "text of one line": (b"nothing of the kind", "text"),
    "text that begins as a bitmap": (b"BMW 1602, wheel loads\n", "text"),
    "text with a brand of MP4": (b"The free lunch\n", "text"),
    "CSV": (b"time,x,y\n0.001,-1.5e-3,2.25\n" * 300, "text"),
    "text in UTF-8": ("Gr\u00f6\u00dfe;\u00b5m\n".encode() * 700, "text"),
    "text in UTF-8, cut within a letter": (("1\n" + "12 \u20ac " * 2000).encode(), "text"),
    "text in Latin-1": ("Gr\u00f6\u00dfe;mm\n".encode("latin-1") * 50, "text"),
    "text in UTF-16": ("time;value\r\n1;2\r\n".encode("utf-16"), "text"),
    "XML": (b'<?xml version="1.0"?>\n<a><b>1</b></a>\n', "text"),
    "PDF": (b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n", "a PDF document"),
    "ZIP": (zipped("a.txt"), "a ZIP archive"),
    "NPZ": (zipped("images.npy"), "a ZIP archive (NPZ)"),
    "DOCX": (zipped("[Content_Types].xml", "word/document.xml"), "an Office document"),
    "ODT": (zipped("mimetype", "content.xml"), "an OpenDocument or EPUB file"),
    "levels that are letters": (dim(97, 123), "unknown data"),
    "levels that are digits and signs": (dim(32, 60), "unknown data"),
    "levels that are printable in Latin-1": (dim(161, 255), "unknown data"),
    "levels of 16 bit": (RNG.integers(0, 4096, 3000, dtype="<u2").tobytes(), "unknown data"),
    "zeros": (bytes(5000), "unknown data"),
    "MAT of level 4": (matlab("4"), "a MATLAB file (MAT)"),
    "MAT of level 5": (matlab("5"), "a MATLAB file (MAT)"),
    "MAT 7.3": (b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n", "a MATLAB file (MAT)"),
    "HDF5": (b"\x89HDF\r\n\x1a\n" + bytes(100), "an HDF5 file"),
    "HDF5 behind a block of the user": (bytes(512) + b"\x89HDF\r\n\x1a\n" + bytes(100), "an HDF5 file"),
    "IDE": (ebml(b"mide"), "an EBML file of the type 'mide'"),
    "Matroska": (ebml(b"matroska"), "a Matroska or WebM video"),
    "WebM": (ebml(b"webm"), "a Matroska or WebM video"),
    "JPEG": (picture("JPEG"), "a JPEG image"),
    "PNG": (picture("PNG"), "a PNG image"),
    "BMP": (picture("BMP"), "a BMP image"),
    "PGM": (picture("PPM"), "a PGM or PPM image"),
    "PGM with a comment": (b"P5\n# a camera\n4 2\n255\n" + bytes(8), "a PGM or PPM image"),
    "WebP": (picture("WEBP"), "a WebP image"),
    "TIFF": (picture("TIFF"), "a TIFF image"),
    "GIF": (animation(), "a GIF image"),
    "HEIC": (b"\0\0\0\x18ftypheic" + bytes(40), "a HEIC or AVIF image"),
    "MP4": (b"\0\0\0\x18ftypisom" + bytes(40), "an MP4 or MOV video"),
    "old MOV": (b"\0\0\0\x08wide\0\x10\0\0mdat" + bytes(40), "an MP4 or MOV video"),
    "AVI": (b"RIFF\x24\0\0\0AVI LIST" + bytes(40), "an AVI video"),
    "WAV": (b"RIFF\x24\0\0\0WAVEfmt " + bytes(40), "a sound (WAV)"),
    "CINE": (b"CI\x2c\0" + bytes(40), "a Phantom CINE"),
    "TAR": (b"a.txt".ljust(257, b"\0") + b"ustar\x0000", "a TAR archive"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_is_named_by_its_content(kind: str) -> None:
    content, expected = KINDS[kind]
    found = looks_like(content[:4096])
    assert found.startswith(expected), found
    assert (found == "text") == (expected == "text")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("suffix", [".raw", ".ide", ".jpg"])
def test_the_refusal_of_an_unknown_suffix_names_the_content(tmp_path: Path, kind: str, suffix: str) -> None:
    content, expected = KINDS[kind]
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    with pytest.raises(ValueError, match="looks like") as refused:
        open_recording(path)
    assert f"looks like {expected}" in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "BMP", "PGM", "WebP"])
def test_the_refusal_of_a_single_image_says_how_to_give_many(tmp_path: Path, kind: str) -> None:
    (tmp_path / "a.img").write_bytes(KINDS[kind][0])
    with pytest.raises(ValueError, match="a recording is many images: put those of one recording into a folder"):
        open_recording(tmp_path / "a.img")


def test_the_refusal_of_a_readable_file_with_another_suffix_names_the_right_one(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros((2, 8, 9), np.uint8))
    (tmp_path / "a.npy").rename(tmp_path / "a.dat")
    with pytest.raises(ValueError, match=r"looks like a NumPy array \(NPY\); rename it to end in \.npy"):
        open_recording(tmp_path / "a.dat")


def test_the_refusal_of_levels_without_a_header_says_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "a.raw").write_bytes(KINDS["levels of 16 bit"][0])
    with pytest.raises(ValueError, match="levels without a header cannot be read, so export them"):
        open_recording(tmp_path / "a.raw")


@pytest.mark.parametrize(
    ("name", "error", "words"),
    [
        ("a.mraw", FileNotFoundError, "a.cihx or a.cih is not beside it"),
        ("a.cihx", ValueError, "without a whole <cih>"),
    ],
)
def test_half_of_a_photron_recording_is_refused(tmp_path: Path, name: str, error: type, words: str) -> None:
    (tmp_path / name).write_bytes(dim(0, 256))
    with pytest.raises(error, match=words):
        open_recording(tmp_path / name)


@pytest.mark.parametrize(
    ("names", "folders", "words"),
    [
        ((), 0, ""),
        ((), 1, "a folder"),
        (["a.jpg"], 0, "1 .jpg"),
        (["a.JPG"] * 12 + ["b.txt"] * 3 + ["README"], 2, "12 .jpg, 3 .txt, 1 without a suffix and 2 folders"),
        ([f"a.{letter}" for letter in "abcdefgh"], 0, "1 .a, 1 .b, 1 .c, 1 .d, 1 .e, 1 .f and 2 of other kinds"),
    ],
)
def test_what_a_folder_holds_is_counted_by_kind(names: list[str], folders: int, words: str) -> None:
    assert what_lies_in(names, folders) == words


def test_the_look_at_a_large_file_reads_its_beginning_alone(tmp_path: Path) -> None:
    with (tmp_path / "a").open("wb") as file:
        file.write(b"line\n")
        file.truncate(2**32)
    assert look_of(tmp_path / "a").startswith("unknown data")
