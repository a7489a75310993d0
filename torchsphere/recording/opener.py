"""Open a recording with the reader of its format."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from torchsphere.recording.arrays import open_npy, open_npz
from torchsphere.recording.folder import open_folder
from torchsphere.recording.phantom import open_phantom
from torchsphere.recording.photron import open_photron
from torchsphere.recording.recording import Recording
from torchsphere.recording.refusal import looks_like
from torchsphere.recording.tiff import open_tiff
from torchsphere.recording.video import open_video
from torchsphere.runtime import steps

# Suffix: the function that opens the file, and the type of its first bytes (empty where the reader checks).
_FORMATS: dict[str, tuple[Callable[[Path], Recording], str]] = {
    ".tif": (open_tiff, "a TIFF image"),
    ".tiff": (open_tiff, "a TIFF image"),
    ".npy": (open_npy, "a NumPy array (NPY)"),
    ".npz": (open_npz, "a ZIP archive (NPZ)"),
    ".cih": (open_photron, ""),
    ".cihx": (open_photron, ""),
    ".mraw": (open_photron, ""),
    ".cine": (open_phantom, "a Phantom CINE"),
    ".avi": (open_video, "an AVI video"),
    ".mp4": (open_video, "an MP4 or MOV video"),
    ".m4v": (open_video, "an MP4 or MOV video"),
    ".mov": (open_video, "an MP4 or MOV video"),
    ".mkv": (open_video, "a Matroska or WebM video"),
    ".webm": (open_video, "a Matroska or WebM video"),
}


def open_recording(path: str | os.PathLike[str]) -> Recording:
    """Open footage of any supported kind; only headers are read.

    Parameters
    ----------
    path : str or path
        A multi-page TIFF, a folder of TIFF or PNG images, an NPY or NPZ array ``(n, h, w)``, a Photron recording
        (.cih, .cihx or .mraw), a Phantom .cine, or a video (.avi, .mp4, .m4v, .mov, .mkv, .webm).

    Returns
    -------
    Recording
        Its ``images(start, stop)`` reads from the file.

    Raises
    ------
    FileNotFoundError
        If the path or a partner file does not exist.
    ValueError
        If the file is of an unsupported type, or of another type than its suffix.
    OSError
        If the file is cut or damaged.
    TypeError
        If ``path`` is not a path.
    """
    place = _as_path(path)
    if place.is_dir():
        return open_folder(place)
    if not place.exists():
        raise FileNotFoundError(f"{place}: does not exist; expected a recording or a folder of images, check the path")
    if not place.is_file():
        raise ValueError(f"{place}: is neither a file nor a folder; expected a recording")
    if place.stat().st_size == 0:
        raise ValueError(f"{place}: is empty; expected a recording, copy it again")
    with place.open("rb") as file:
        look = looks_like(file.read(64))
    if place.suffix.lower() not in _FORMATS:
        single = "; put single images into a folder and open that" if look in ("a PNG image", "a JPEG image") else ""
        raise ValueError(
            f"{place}: looks like {look}; expected a folder of TIFF or PNG images, "
            f"or one of {', '.join(_FORMATS)}{single}"
        )
    opener, expected = _FORMATS[place.suffix.lower()]
    if expected and look != expected:
        raise ValueError(
            f"{place}: looks like {look}, expected {expected} after its name; "
            "give it the right suffix or find the right file"
        )
    steps.tell_if_large([place], "opening %s", place)
    return opener(place)


def _as_path(path: object) -> Path:
    try:
        return Path(path)  # type: ignore[arg-type]
    except TypeError as error:
        usable = bool(getattr(path, "shape", ()))  # images, or an open recording
        raise TypeError(
            f"open_recording: expected the path of a recording or of a folder of images, got {type(path).__name__}; "
            f"{'give it to torchsphere.track as it is' if usable else 'give text or a pathlib.Path'}"
        ) from error
