"""Results in a Python session: tables, figures, HTML, and folders that are saved and loaded."""

import dataclasses
import html.parser
import logging
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import torchsphere as ts
from torchsphere.dynamics.impact_estimate import Estimate
from torchsphere.measure import Measurement
from torchsphere.recording.refusal import LibraryMissingError
from torchsphere.results.columns import unit_of
from torchsphere.results.reader import KINEMATICS_COLUMNS, TRACK_COLUMNS, read

#: Elements that have no end.
VOID = {"img"}


class Wellformed(html.parser.HTMLParser):
    """Checks that each element ends."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: Any) -> None:
        """An element of SVG that ends where it begins."""

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def track(measured: tuple[Path, Measurement]) -> ts.Track:
    return measured[1].track


@pytest.fixture(scope="module")
def motion(track: ts.Track) -> ts.Kinematics:
    return ts.kinematics(track)


@pytest.fixture(scope="module")
def impact(motion: ts.Kinematics) -> ts.Impact:
    found, reason = ts.impact(motion)
    assert found is not None, reason
    return found


@pytest.fixture(scope="module")
def saved(motion: ts.Kinematics, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return motion.save(tmp_path_factory.mktemp("saved") / "shot")


def shot_of(measured: tuple[Path, Measurement]) -> Path:
    return measured[0].parent / "shot.tif"


def test_each_result_has_html_with_a_figure_and_a_table(
    measured: tuple[Path, Measurement], track: ts.Track, motion: ts.Kinematics, impact: ts.Impact, saved: Path
) -> None:
    with ts.open_recording(shot_of(measured)) as recording:
        texts = {"Recording": recording._repr_html_()}
    texts |= {type(one).__name__: one._repr_html_() for one in (track.circle, track, motion, impact, ts.load(saved))}
    for name, text in texts.items():
        # A notebook is saved with all of this.
        assert len(text) < 100_000, name
        assert "<table" in text
        assert "<img" in text
        assert not re.search(r"\bnan\b", re.sub(r"base64,[^\"]*", "", text), re.IGNORECASE), name
        assert "http" not in text
        parser = Wellformed()
        parser.feed(text)
        assert parser.open == [], name
    assert "36,000 frames/s" in texts["Kinematics"]
    assert "Largest force" in texts["Impact"]


def test_html_has_the_names_of_files_as_text(measured: tuple[Path, Measurement]) -> None:
    with ts.open_recording(shot_of(measured)) as recording:
        odd = dataclasses.replace(recording, path=Path("<b>&.tif"), _reader=recording._reader)
    assert "&lt;b&gt;&amp;.tif" in odd._repr_html_()


def test_html_of_a_lost_ball_and_of_an_unreadable_recording_has_no_figure_but_words(
    measured: tuple[Path, Measurement], track: ts.Track
) -> None:
    lost = dataclasses.replace(
        track,
        position=np.full_like(track.position, np.nan),
        increment=np.full_like(track.increment, np.nan),
        status=np.full(len(track.status), "lost"),
    )
    assert "not measured" in lost._repr_html_()

    def fails(first: int, last: int) -> Any:
        raise OSError("cut")

    with ts.open_recording(shot_of(measured)) as recording:
        text = dataclasses.replace(recording, _reader=fails)._repr_html_()
    assert "<img" not in text
    assert "26 of 384 x 192 px" in text


def test_texts_are_short(track: ts.Track, motion: ts.Kinematics, impact: ts.Impact, saved: Path) -> None:
    for one in (track.circle, track, motion, impact, ts.load(saved)):
        assert len(repr(one)) < 1500
    assert repr(track.circle).startswith("<Circle 170.30,98.60,40.00 px in frame 0")


def test_a_data_frame_has_the_columns_of_the_csv_file_and_their_units(track: ts.Track, motion: ts.Kinematics) -> None:
    pytest.importorskip("pandas", reason="pandas is not installed (extra 'export')")
    frame = track.to_pandas()
    assert list(frame.columns) == list(TRACK_COLUMNS)
    assert frame.attrs["units"]["x_px"] == "px"
    np.testing.assert_array_equal(frame["dx_px"][1:], track.increment[:, 0])
    np.testing.assert_allclose(frame["time_s"], np.arange(26) / 36_000.0)
    table = motion.to_pandas()
    assert {column for names in KINEMATICS_COLUMNS.values() for column in names} <= set(table.columns)
    np.testing.assert_array_equal(table["sd_fy_N"], motion.sd_force_N[:, 1])


def test_a_data_set_has_units_and_covariances(track: ts.Track, motion: ts.Kinematics) -> None:
    pytest.importorskip("xarray", reason="xarray is not installed (extra 'export')")
    data = track.to_xarray()
    assert data["x_px"].attrs["units"] == "px"
    assert data["covariance"].dims == ("frame", "component", "other_component")
    np.testing.assert_array_equal(data["covariance"].sel(frame=3), track.covariance[2])
    moved = motion.to_xarray()
    assert moved["vx_m_s"].attrs["units"] == unit_of("vx_m_s") == "m/s"
    np.testing.assert_array_equal(moved["time_s"], motion.time_s)


@pytest.mark.parametrize(("method", "library"), [("to_pandas", "pandas"), ("to_xarray", "xarray")])
def test_a_missing_library_is_named_with_what_installs_it(
    track: ts.Track, method: str, library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(LibraryMissingError, match=rf"{method} needs {library}.*pip install 'torchsphere\[export\]'"):
        getattr(track, method)()


def test_figures_of_the_report_are_drawn_without_a_folder(
    track: ts.Track, motion: ts.Kinematics, impact: ts.Impact
) -> None:
    figure = motion.plot()
    assert isinstance(figure, Figure)
    labels = [axis.get_ylabel() for axis in figure.axes]
    assert {"position (mm)", "velocity (m/s)", "force (kN)", "spin (rad/s)"} <= set(labels)
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert "step (px per frame)" in [axis.get_ylabel() for axis in track.plot().axes]
    assert track.plot("quality").axes
    force = impact.plot()
    assert "penetration" in force.axes[0].get_xlabel()
    with pytest.raises(ValueError, match=r"plot\('spin'\): expected one of motion, rotation, quality"):
        motion.plot("spin")


def test_a_saved_folder_is_that_of_the_command_line(
    measured: tuple[Path, Measurement], saved: Path, motion: ts.Kinematics
) -> None:
    folder, _ = measured
    for name in ("track.csv", "kinematics.csv", "force_path.csv"):
        assert (saved / name).read_bytes() == (folder / name).read_bytes(), name
    mine, theirs = read(saved).summary, read(folder).summary
    for name in ("impact", "impacts", "circle", "scale", "frame_rate", "frame_rate_origin", "mean_motion"):
        assert mine[name] == theirs[name], name
    assert mine["input"]["sha256"] == theirs["input"]["sha256"]
    assert (saved / "report.html").is_file()
    with pytest.raises(FileExistsError, match="overwrite=True to replace it"):
        motion.save(saved)


def test_with_the_recording_the_folder_keeps_images(
    measured: tuple[Path, Measurement], track: ts.Track, tmp_path: Path
) -> None:
    with ts.open_recording(shot_of(measured)) as recording:
        folder = track.save(tmp_path / "px", recording=recording)
        with pytest.raises(ValueError, match="has 5 images, and the track 26 of 26"):
            track.save(tmp_path / "other", recording=recording[:5])
    assert not (tmp_path / "other").exists()
    assert not (folder / "kinematics.csv").exists()
    loaded = ts.load(folder)
    assert loaded.motion is None
    assert loaded.plot("path").axes
    with pytest.raises(ValueError, match="no impact of this result has a force"):
        loaded.plot("force_path")


def test_a_loaded_track_gives_the_same_motion_and_loaded_numbers_are_those_of_the_files(
    saved: Path, track: ts.Track, motion: ts.Kinematics, impact: ts.Impact
) -> None:
    loaded = ts.load(saved)
    for name in ("position", "increment", "covariance", "zncc", "iterations", "status", "sd_growth", "sd_steady"):
        np.testing.assert_array_equal(getattr(loaded.track, name), getattr(track, name), err_msg=name)
    np.testing.assert_allclose(loaded.track.orientation, track.orientation, atol=1e-12)
    again = ts.kinematics(loaded.track)
    np.testing.assert_array_equal(again.velocity_m_s, motion.velocity_m_s)
    np.testing.assert_array_equal(again.sd_force_N, motion.sd_force_N)
    assert loaded.motion is not None
    # The file has ten digits.
    np.testing.assert_allclose(loaded.motion.velocity_m_s, motion.velocity_m_s, rtol=1e-9, atol=1e-9)
    assert loaded.impact is not None
    for field in dataclasses.fields(impact):
        value = getattr(impact, field.name)
        if isinstance(value, Estimate):
            np.testing.assert_array_equal(getattr(loaded.impact, field.name).value, value.value)
    assert loaded.impact.ball == impact.ball
    assert loaded.impacts[0].summary()["energy_balance"] == impact.summary()["energy_balance"]
    assert loaded.impact.motion is loaded.motion


def test_what_a_folder_does_not_keep_is_said(saved: Path, tmp_path: Path) -> None:
    loaded = ts.load(saved)
    found, reason = ts.impact(loaded.motion)
    assert found is None
    assert "loaded from a result folder" in reason
    assert loaded.motion is not None
    with pytest.raises(ValueError, match="the motion was loaded"):
        loaded.motion.save(tmp_path / "again")
    assert loaded.impact is not None
    with pytest.raises(ValueError, match="the impact was loaded"):
        loaded.impact.plot()
    with pytest.raises(ValueError, match="this is no result folder"):
        ts.load(tmp_path)


def test_an_array_is_saved_without_a_file_and_its_motion_needs_no_further_number(tmp_path: Path, caplog: Any) -> None:
    from torchsphere.synthetic import demo_shot

    images = demo_shot.make_shot().images[:6]
    with caplog.at_level(logging.CRITICAL, "torchsphere"):
        track = ts.track(images, (64.3, 92.6, 40.0), map="off", fps=36_000.0, diameter_mm=30.0)
        folder = ts.kinematics(track).save(tmp_path / "array", report=False, export="mat")
    summary = read(folder).summary
    assert summary["input"]["path"] == "array"
    assert (summary["input"]["width_px"], summary["input"]["frames"]) == (384, 6)
    assert summary["frame_rate_origin"] == "given"
    assert (folder / "result.mat").is_file()
    assert ts.load(folder).track.calibration == track.calibration
