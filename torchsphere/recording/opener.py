"""Open a recording with the reader of its format."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from torchsphere.recording import hdf5, matlab, member
from torchsphere.recording.arrays import open_npy, open_npz
from torchsphere.recording.display import as_shown
from torchsphere.recording.folder import KINDS, open_folder
from torchsphere.recording.phantom import open_phantom
from torchsphere.recording.photron import open_photron, with_header_beside
from torchsphere.recording.recording import Recording
from torchsphere.recording.refusal import HDF5, ISO_VIDEO, MATLAB, MATROSKA, NPZ, ZIP, look_of
from torchsphere.recording.tiff import open_tiff
from torchsphere.recording.video import open_video
from torchsphere.runtime import steps
from torchsphere.settings.choices import AXES
from torchsphere.settings.limits import SettingError, require_one_of

# Suffix: the function that opens the file, and the types of its content (empty where the reader checks).
_FORMATS: dict[str, tuple[Callable[..., Recording], tuple[str, ...]]] = {
    ".tif": (open_tiff, ("a TIFF image",)),
    ".tiff": (open_tiff, ("a TIFF image",)),
    ".npy": (open_npy, ("a NumPy array (NPY)",)),
    ".npz": (open_npz, (NPZ, ZIP)),
    ".h5": (hdf5.open_hdf5, (HDF5,)),
    ".hdf5": (hdf5.open_hdf5, (HDF5,)),
    ".mat": (matlab.open_matlab, (MATLAB, HDF5)),
    ".cih": (open_photron, ()),
    ".cihx": (open_photron, ()),
    ".mraw": (open_photron, ()),
    ".cine": (open_phantom, ("a Phantom CINE",)),
    ".avi": (open_video, ("an AVI video",)),
    ".mp4": (open_video, (ISO_VIDEO,)),
    ".m4v": (open_video, (ISO_VIDEO,)),
    ".mov": (open_video, (ISO_VIDEO,)),
    ".mkv": (open_video, (MATROSKA,)),
    ".webm": (open_video, (MATROSKA,)),
}

#: Suffixes of files that can be opened, and of arrays, whose axes may be given.
SUFFIXES = tuple(_FORMATS)
ARRAYS = (".npy", *member.SUFFIXES)


def open_recording(
    path: str | os.PathLike[str],
    *,
    axes: str | None = None,
    pixel_aspect: float | None = None,
    bayer: str | None = None,
) -> Recording:
    """Open footage of any supported kind; only headers are read, and of arrays a few images.

    The images are as a player shows them: turned and mirrored as the file states, and with square pixels.

    Parameters
    ----------
    path : str or path
        A multi-page TIFF, a folder of images (TIFF, PNG, BMP, PGM, JPEG, WebP), an NPY, NPZ, HDF5 or MAT array of
        images, a Photron recording (.cihx, .cih or .mraw), a Phantom .cine, or a video (.avi, .mp4, .m4v, .mov, .mkv,
        .webm). ``file.h5:/camera/images`` names one array of a file that holds several, and so with .mat and .npz.
    axes : str, optional
        Order of the axes of an array: number (n), height (h) and width (w), as in "hwn". By default "nhw", and "hwn" in
        a MAT file. Axes that seem to have another order are told in `Recording.notes`, unless they are given.
    pixel_aspect : float, optional
        Width of a stored pixel over its height, where the file does not state it, or not rightly.
    bayer : str, optional
        Colours of the 2 x 2 pixels of a raw colour mosaic, row by row: "RGGB", "BGGR", "GRBG" or "GBRG".

    Returns
    -------
    Recording
        Its ``images(start, stop)`` reads from the file.

    Raises
    ------
    FileNotFoundError
        If the path or a partner file does not exist.
    ValueError
        If the file is of an unsupported type, or of another type than its suffix, or an argument is out of its range;
        if ``axes`` are given for a file that is no array.
    OSError
        If the file is cut or damaged.
    TypeError
        If ``path`` is not a path.
    """
    if axes is not None:
        require_one_of(AXES)("axes", axes)
    return as_shown(_opened(_as_path(path), axes), pixel_aspect, bayer)


def _opened(place: Path, axes: str | None) -> Recording:
    """The recording as it is stored."""
    if place.is_dir():
        _require_no_axes(place, axes)
        return with_header_beside(open_folder(place))
    place, name = member.split(place)
    suffix = place.suffix.lower()
    _require_content(place, suffix)
    if suffix not in ARRAYS:
        _require_no_axes(place, axes)
    opener, looks = _FORMATS[suffix]
    look = look_of(place)
    if looks and look not in looks:
        raise ValueError(
            f"{place}: looks like {look}, expected {looks[0]} after its name; "
            "give it the right suffix or find the right file"
        )
    of_array = {"axes": axes} if suffix in ARRAYS else {}
    of_several = {"name": name} if suffix in member.SUFFIXES else {}
    steps.tell_if_large([place], "opening %s", place)
    recording = opener(place, **of_array, **of_several)
    return with_header_beside(recording) if opener is open_tiff else recording


def stacks_of(path: Path) -> list[str]:
    """Names of the arrays of images in an HDF5 or MAT file; raises ValueError or OSError for other files."""
    return matlab.stacks_of(path) if path.suffix.lower() == ".mat" else hdf5.stacks_of(path)


def _require_no_axes(place: Path, axes: str | None) -> None:
    if axes is not None:
        raise SettingError(
            f"`axes` = {axes} was given for {place}, which is no array; leave it out: it turns NPY, NPZ, HDF5 and MAT"
        )


def _require_content(place: Path, suffix: str) -> None:
    """Raise FileNotFoundError or ValueError unless a file is there, is not empty, and has the suffix of a format."""
    if not place.exists():
        raise FileNotFoundError(f"{place}: does not exist; expected a recording or a folder of images, check the path")
    if not place.is_file():
        raise ValueError(f"{place}: is neither a file nor a folder; expected a recording")
    if place.stat().st_size == 0:
        raise ValueError(f"{place}: is empty; expected a recording, copy it again")
    if suffix in _FORMATS:
        return
    look = look_of(place)
    names = [suffix for suffix, (_, looks) in _FORMATS.items() if look in looks]
    if names:
        raise ValueError(f"{place}: looks like {look}; rename it to end in {' or '.join(names)}")
    kinds = ", ".join(kind.name for kind in KINDS)
    expected = f"expected a folder of images ({kinds}), or one of {', '.join(_FORMATS)}"
    if look in [kind.look for kind in KINDS]:
        raise ValueError(
            f"{place}: looks like {look}, and a recording is many images: put those of one recording into a folder, "
            f"and give that; {expected}"
        )
    if look.startswith("unknown data"):
        expected += "; levels without a header cannot be read, so export them with the program of the camera"
    raise ValueError(f"{place}: looks like {look}; {expected}")


def _as_path(path: object) -> Path:
    try:
        return Path(path)  # type: ignore[arg-type]
    except TypeError as error:
        usable = bool(getattr(path, "shape", ()))  # images, or an open recording
        raise TypeError(
            f"open_recording: expected the path of a recording or of a folder of images, got {type(path).__name__}; "
            f"{'give it to torchsphere.track as it is' if usable else 'give text or a pathlib.Path'}"
        ) from error
