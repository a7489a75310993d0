"""Write a recording's folder: frames, truth, scene. The folder appears whole or not at all."""

from __future__ import annotations

import contextlib
import importlib.metadata
import json
import platform
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from . import preset
from .shot import Shot
from .trajectory import Table
from .truth import truth, write_truth

Frames = Iterable[NDArray[Any]]
#: Called with the folder, the frames, their shape (n, h, w), their type and the frame rate.
Writer = Callable[[Path, Frames, tuple[int, int, int], np.dtype[Any], float], Path]

_PACKAGES = ("mitsuba", "drjit", "karellen-llvm-core", "numpy", "scipy", "tifffile")

#: The file that marks a recording's folder, and the version of its layout.
SCENE, LAYOUT = "scene.json", 1


def write_recording(
    folder: Path, shot: Shot, frames: Frames, *, kind: str = "tiff", overwrite: bool = False, variant: Sequence[str]
) -> Path:
    """Write a recording's folder: the frames, ``truth.csv`` and ``scene.json``.

    Parameters
    ----------
    folder : Path
        Name of the folder; it appears when all files have been written.
    shot : Shot
        The shot that is rendered.
    frames : iterable of ndarray
        Images (h, w), read one at a time.
    kind : str
        One of `WRITERS`.
    overwrite : bool
        Replace an earlier recording.
    variant : sequence of str
        Mitsuba's variant and why it was chosen.

    Returns
    -------
    Path
        The file, or folder, of the frames.

    Raises
    ------
    OSError
        If the folder cannot be written, or exists already.
    """
    sensor, camera = shot.setup.sensor, shot.setup.camera
    dtype = np.dtype(np.uint8 if sensor.bit_depth <= 8 else np.uint16)
    with whole_folder(folder, overwrite) as new:
        shape = shot.frames, camera.height, camera.width
        file = WRITERS[kind](new, _checked(frames, shape, dtype), shape, dtype, shot.frame_rate_hz)
        write_truth(new / "truth.csv", truth(shot))
        _write_scene(new, shot, file.name, variant)
    return folder / file.name


def check_folder(folder: Path, overwrite: bool) -> None:
    """Refuse a folder with other files.

    Raises
    ------
    OSError
        Unless the folder is new or empty, or holds an earlier recording that may be replaced.
    """
    if not folder.exists():
        return
    if not folder.is_dir():
        raise FileExistsError(f"{folder} is a file; give the name of a folder for the recording")
    if not any(folder.iterdir()):
        return
    if not overwrite:
        raise FileExistsError(f"{folder} exists and is not empty; give another folder, or --overwrite to replace it")
    if not (folder / SCENE).is_file():
        raise FileExistsError(f"{folder} holds files that are no recording of this renderer; they are not overwritten")


@contextlib.contextmanager
def whole_folder(folder: Path, overwrite: bool) -> Iterator[Path]:
    """A new folder beside ``folder``, which takes its place when the block ends without an error."""
    check_folder(folder, overwrite)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as place:
        new, old = Path(place, "new"), Path(place, "old")
        new.mkdir()
        yield new
        check_folder(folder, overwrite)
        if folder.exists():
            folder.replace(old)
        try:
            new.replace(folder)
        except OSError:
            # The earlier recording must not be lost.
            if old.exists():
                old.replace(folder)
            raise


def _checked(frames: Frames, shape: tuple[int, int, int], dtype: np.dtype[Any]) -> Iterator[NDArray[Any]]:
    """The frames; refused if one has another shape or type, or if their number is wrong."""
    count = 0
    for frame in frames:
        if frame.shape != shape[1:] or frame.dtype != dtype:
            raise ValueError(f"frame {count} is {frame.shape} {frame.dtype}, expected {shape[1:]} {dtype}")
        count += 1
        yield frame
    if count != shape[0]:
        raise ValueError(f"{count} frames were rendered, expected {shape[0]}")


def _write_tiff(
    folder: Path, frames: Frames, shape: tuple[int, int, int], dtype: np.dtype[Any], frame_rate_hz: float
) -> Path:
    path = folder / "frames.tif"
    # Readers of stacks know ImageJ's names: seconds from frame to frame, and frames per second.
    timing = {"axes": "TYX", "finterval": 1.0 / frame_rate_hz, "tunit": "s", "fps": frame_rate_hz}
    with warnings.catch_warnings(), tifffile.TiffWriter(path, imagej=True) as writer:
        # Beyond 4 GB ImageJ writes a single page followed by all frames; its readers know this layout.
        warnings.filterwarnings("ignore", message=".*truncating ImageJ file")
        writer.write(iter(frames), shape=shape, dtype=dtype, photometric="minisblack", metadata=timing)
    return path


def _write_npy(
    folder: Path, frames: Frames, shape: tuple[int, int, int], dtype: np.dtype[Any], frame_rate_hz: float
) -> Path:
    path = folder / "frames.npy"
    with path.open("wb") as stream:
        header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(stream, header)
        for frame in frames:
            stream.write(np.ascontiguousarray(frame).tobytes())
    return path


def _write_png(
    folder: Path, frames: Frames, shape: tuple[int, int, int], dtype: np.dtype[Any], frame_rate_hz: float
) -> Path:
    import imagecodecs

    path = folder / "frames"
    path.mkdir()
    digits = max(5, len(str(shape[0] - 1)))
    for number, frame in enumerate(frames):
        (path / f"frame_{number:0{digits}d}.png").write_bytes(imagecodecs.png_encode(frame))
    return path


#: Writers by their name on the command line.
WRITERS: dict[str, Writer] = {"tiff": _write_tiff, "npy": _write_npy, "png": _write_png}


def _write_scene(folder: Path, shot: Shot, frames: str, variant: Sequence[str]) -> None:
    table = preset.table(shot)
    if isinstance(shot.trajectory, Table):
        # The folder holds everything that is needed to render the recording again.
        shutil.copyfile(shot.trajectory.file, folder / "motion.csv")
        table["trajectory"]["file"] = "motion.csv"
    scene = {
        "layout": LAYOUT,
        "name": shot.name,
        "frames": frames,
        "frame_rate_hz": shot.frame_rate_hz,
        "variant": variant[0],
        "variant_reason": variant[1],
        "versions": {"python": platform.python_version()} | {name: _version(name) for name in _PACKAGES},
        "shot": table,
    }
    text = json.dumps(scene, indent=2, ensure_ascii=False, allow_nan=False)
    (folder / SCENE).write_text(text + "\n", encoding="utf-8")


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None
