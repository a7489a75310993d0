"""A recording's folder: its files; it appears whole or not at all."""

import json
from collections.abc import Iterator
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
import tifffile

from render import preset
from render.output import write_recording
from render.shot import Shot

VARIANT = ("none", "these frames were made by a test")


def tiny(*changes: str) -> Shot:
    return preset.load("example", ["frames=3", "camera.width=32", "camera.height=24", *changes])


def frames(shot: Shot, stop: int | None = None) -> Iterator[np.ndarray]:
    """Random frames; raises an error in place of frame `stop`."""
    sensor, camera = shot.setup.sensor, shot.setup.camera
    rng = np.random.default_rng(1)
    for number in range(shot.frames):
        if number == stop:
            raise RuntimeError("the renderer broke")
        grey = rng.integers(0, sensor.full_scale + 1, (camera.height, camera.width))
        yield grey.astype(np.uint8 if sensor.bit_depth == 8 else np.uint16)


def write(folder: Path, shot: Shot, kind: str = "tiff", overwrite: bool = False) -> Path:
    return write_recording(folder, shot, frames(shot), kind=kind, overwrite=overwrite, variant=VARIANT)


def read(path: Path) -> np.ndarray:
    if path.suffix == ".tif":
        return tifffile.imread(path)
    if path.suffix == ".npy":
        return np.load(path)
    return np.stack([imagecodecs.png_decode(file.read_bytes()) for file in sorted(path.iterdir())])


@pytest.mark.parametrize("kind", ["tiff", "npy", "png"])
@pytest.mark.parametrize("bit_depth", [8, 12])
def test_frames_read_back_as_they_were_rendered(tmp_path: Path, kind: str, bit_depth: int) -> None:
    shot = tiny(f"sensor.bit_depth={bit_depth}")
    back = read(write(tmp_path / "out", shot, kind))
    expected = np.stack(list(frames(shot)))
    assert back.dtype == expected.dtype
    assert np.array_equal(back, expected)
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {"truth.csv", "scene.json"}


def test_a_single_frame_is_a_stack_too(tmp_path: Path) -> None:
    path = write(tmp_path / "out", preset.load("example", ["frames=1", "camera.width=32", "camera.height=24"]))
    assert tifffile.imread(path).squeeze().shape == (24, 32)


def test_the_tiff_states_its_frame_rate(tmp_path: Path) -> None:
    with tifffile.TiffFile(write(tmp_path / "out", tiny())) as tif:
        said = tif.imagej_metadata or {}
        assert len(tif.pages) == 3
    assert said["fps"] == 36_000
    assert said["finterval"] == pytest.approx(1 / 36_000, rel=1e-12)
    assert said["tunit"] == "s"


def test_scene_json_holds_every_parameter_and_makes_the_same_shot(tmp_path: Path) -> None:
    shot = tiny("camera.model=pinhole", "trajectory.start_m=[0,0,0.3]")
    write(tmp_path / "out", shot)
    scene = json.loads((tmp_path / "out" / "scene.json").read_text())
    assert (scene["variant"], scene["variant_reason"]) == VARIANT
    assert {"mitsuba", "drjit", "numpy"} <= set(scene["versions"])
    assert scene["frame_rate_hz"] == 36_000
    assert scene["frames"] == "frames.tif"
    assert scene["shot"]["pattern"]["seed"] == 1
    again = preset.load(str(tmp_path / "out" / "scene.json"))
    assert (again.setup, again.trajectory, again.frames) == (shot.setup, shot.trajectory, shot.frames)


def test_a_table_of_motion_comes_with_the_recording(tmp_path: Path) -> None:
    (tmp_path / "given").mkdir()
    (tmp_path / "given" / "m.csv").write_text(
        "time_s,x_m,y_m,z_m,rx_rad,ry_rad,rz_rad\n0,0,0,0,0,0,0\n1,0.001,0,0,0,0,0.1\n"
    )
    text = 'frame_rate_hz=10\nframes=3\n[camera]\nwidth=32\nheight=24\n[trajectory]\nkind="table"\nfile="m.csv"\n'
    (tmp_path / "given" / "shot.toml").write_text(text)
    shot = preset.load(str(tmp_path / "given" / "shot.toml"))
    write(tmp_path / "out", shot)
    again = preset.load(str(tmp_path / "out" / "scene.json"))
    assert np.array_equal(again.trajectory(shot.times_s).position_m, shot.trajectory(shot.times_s).position_m)


@pytest.mark.parametrize("kind", ["tiff", "npy", "png"])
@pytest.mark.parametrize("stop", [0, 2])
def test_a_failure_in_the_middle_leaves_nothing(tmp_path: Path, kind: str, stop: int) -> None:
    shot = tiny()
    with pytest.raises(RuntimeError, match="the renderer broke"):
        write_recording(tmp_path / "out", shot, frames(shot, stop), kind=kind, variant=VARIANT)
    assert list(tmp_path.iterdir()) == []


def test_a_failure_leaves_an_earlier_recording_as_it_was(tmp_path: Path) -> None:
    shot = tiny()
    path = write(tmp_path / "out", shot)
    before = path.read_bytes()
    with pytest.raises(RuntimeError):
        write_recording(tmp_path / "out", shot, frames(shot, 1), overwrite=True, variant=VARIANT)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_too_few_frames_or_frames_of_another_size_are_no_recording(tmp_path: Path) -> None:
    shot = tiny()
    with pytest.raises(ValueError, match="2 frames were rendered, expected 3"):
        write_recording(tmp_path / "out", shot, list(frames(shot))[:2], kind="npy", variant=VARIANT)
    with pytest.raises(ValueError, match="frame 0 is"):
        write_recording(tmp_path / "out", tiny("camera.width=33"), frames(shot), variant=VARIANT)
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_already_is_kept_unless_it_is_a_recording_to_be_replaced(tmp_path: Path) -> None:
    shot = tiny()
    write(tmp_path / "out", shot, "npy")
    with pytest.raises(FileExistsError, match="--overwrite"):
        write(tmp_path / "out", shot)
    write(tmp_path / "out", shot, overwrite=True)
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"frames.tif", "truth.csv", "scene.json"}
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.txt").write_text("all of it")
    with pytest.raises(FileExistsError, match="no recording of this renderer"):
        write(tmp_path / "other", shot, overwrite=True)
    assert (tmp_path / "other" / "thesis.txt").read_text() == "all of it"
    (tmp_path / "file").write_text("")
    with pytest.raises(FileExistsError, match="is a file"):
        write(tmp_path / "file", shot, overwrite=True)


def test_frames_are_written_as_they_come(tmp_path: Path) -> None:
    """Memory stays constant: a frame is written before the next is asked for."""
    shot, alive = tiny("frames=40"), []

    def counted() -> Iterator[np.ndarray]:
        import weakref

        for _ in range(shot.frames):
            frame = np.zeros((24, 32), np.uint8)
            alive.append(weakref.ref(frame))
            assert sum(ref() is not None for ref in alive) <= 3
            yield frame
            del frame

    for kind in ("tiff", "npy", "png"):
        write_recording(tmp_path / kind, shot, counted(), kind=kind, variant=VARIANT)
        alive.clear()
