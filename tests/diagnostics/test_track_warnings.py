"""Warnings on the local polynomials: windows that are too long, and motions that are too fast for them."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import tifffile
from tracks import falling_track, made_track
from writers import write_mraw

import torchsphere as ts
from torchsphere.diagnostics.track_warnings import bandwidth_warnings, track_warnings, window_warnings
from torchsphere.recording import open_recording
from torchsphere.request import Request
from torchsphere.runtime.warning_levels import CAUTION, NOTE, SEVERE, level_of


@pytest.fixture
def falling() -> ts.Track:
    return falling_track()


def warnings_of(track: ts.Track, method: str, window: int) -> tuple[str, ...]:
    return window_warnings(track, ts.kinematics(track, frame_rate=1e3, m_per_px=5e-4, method=method, window=window))


def test_a_window_longer_than_the_measured_frames_gives_a_warning_with_advice(falling: ts.Track) -> None:
    (sentence,) = warnings_of(falling, "savitzky-golay", 11)
    assert "takes 11 frames measured in a row, and there are 9 at most" in sentence
    assert sentence.endswith(
        "velocities, accelerations and spins are empty; give `window` = 9 or less, or `method` = smoother."
    )
    assert warnings_of(falling, "savitzky-golay", 9) == warnings_of(falling, "smoother", 11) == ()
    # Frames 4 to 8 are left in a row.
    gap = falling.increment.copy()
    gap[3] = np.nan
    (sentence,) = warnings_of(dataclasses.replace(falling, increment=gap), "savitzky-golay", 7)
    assert "there are 5 at most" in sentence
    assert "`window` = 5 or less" in sentence
    # Frames 0 to 3: no window beyond the order of 3 is left.
    gap[4:] = np.nan
    (sentence,) = warnings_of(dataclasses.replace(falling, increment=gap), "savitzky-golay", 7)
    assert sentence.endswith(
        "there are 4 at most, so that velocities, accelerations and spins are empty; give `method` = smoother."
    )
    pairs = falling.increment.copy()
    pairs[::2] = np.nan
    (sentence,) = warnings_of(dataclasses.replace(falling, increment=pairs), "differences", 7)
    assert sentence.startswith("The method differences takes 3 frames measured in a row, and there are 2 at most")
    nothing = dataclasses.replace(falling, increment=np.full_like(gap, np.nan))
    assert warnings_of(nothing, "differences", 7) == ()


def test_a_window_too_long_for_the_rotation_alone_warns_of_the_spins(falling: ts.Track) -> None:
    rotation = falling.increment.copy()
    rotation[5:, 2:] = np.nan
    (sentence,) = warnings_of(dataclasses.replace(falling, increment=rotation), "savitzky-golay", 7)
    assert sentence.endswith(
        "there are 6 at most, so that spins are empty; give `window` = 5 or less, or `method` = smoother."
    )
    # Another sentence reports a rotation that was not measured at all.
    rotation[:, 2:] = np.nan
    assert warnings_of(dataclasses.replace(falling, increment=rotation), "savitzky-golay", 7) == ()


@pytest.mark.parametrize("method", ["savitzky-golay", "differences", "smoother"])
def test_polynomials_through_an_impact_warn_that_they_flatten_it(method: str) -> None:
    velocity = np.interp(np.arange(40), [18, 22], [3.0, -1.0])
    steps = np.stack((velocity, *np.zeros((4, 40))), 1)
    sd, circle = np.array([0.01, 0.01, 1e-4, 1e-4, 1e-4]), ts.Circle(50.0, 40.0, 20.0, 0.0, 0.0, 0.0)
    known = {"frame_rate": 1000.0, "m_per_px": 5e-4, "method": method}
    sentences = bandwidth_warnings(ts.kinematics(made_track(steps, sd, circle), **known))
    assert len(sentences) == (method != "smoother")
    assert all(f"the method {method} do not hold what its polynomials" in sentence for sentence in sentences)
    steady = np.tile(steps[:1], (40, 1)) + sd * np.random.default_rng(1).normal(size=(40, 5))
    assert bandwidth_warnings(ts.kinematics(made_track(steady, sd, circle), **known)) == ()
    nothing = np.full_like(steps, np.nan)
    assert bandwidth_warnings(ts.kinematics(made_track(nothing, sd, circle), **known)) == ()


def test_what_a_file_says_is_a_note_but_what_makes_its_motion_wrong(tmp_path: Path, falling: ts.Track) -> None:
    images = np.zeros((4, 8, 8), np.uint8)
    header = write_mraw(tmp_path / "a", images.astype(int), bits=8, depth=8, text=True, Save_Step="2", Start_Frame="5")
    (folder := tmp_path / "images").mkdir()
    for number, image in zip((1, 2, 3, 6), images, strict=True):
        tifffile.imwrite(folder / f"b{number}.tif", image)
    for path, severe in ((header, "not 20000 but 10000"), (folder, "2 of the numbered images are missing")):
        with open_recording(path) as recording:
            found = track_warnings(Request(input=path, out="out"), recording, falling, recording.frame_rate)
        levels = {sentence: level_of(sentence) for sentence in found}
        assert [sentence for sentence in levels if levels[sentence] == SEVERE and severe in sentence]
        assert NOTE in levels.values()
        assert CAUTION not in levels.values()
