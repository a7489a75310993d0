"""A result folder read back: the numbers that were measured, and damage that is refused."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from torchsphere.cli.main import main
from torchsphere.measure import Measurement
from torchsphere.results.reader import ResultFolder


def test_a_result_folder_reads_back_as_the_measurement(
    measured: tuple[Path, Measurement], result: ResultFolder
) -> None:
    track, motion = measured[1].track, measured[1].motion
    assert motion is not None
    assert result.motion is not None
    # Ten digits are written.
    np.testing.assert_allclose(result.position, track.position, rtol=1e-9)
    np.testing.assert_allclose(result.increment[1:], track.increment, rtol=1e-9)
    assert np.isnan(result.increment[0]).all()
    np.testing.assert_allclose(result.motion.force_N, motion.force_N, rtol=1e-9)
    np.testing.assert_allclose(result.motion.sd_spin_rad_s, motion.sd_spin_rad_s, rtol=1e-9)
    assert result.status.tolist() == track.status.tolist()
    assert result.contact_s == pytest.approx(motion.contact_s)


def test_turned_angles_are_sums_of_increments_up_to_the_first_missing_increment(result: ResultFolder) -> None:
    np.testing.assert_allclose(result.turned_rad[1:], result.increment[1:, 2:].cumsum(0), atol=1e-12)
    assert (result.turned_rad[0] == 0).all()
    increment = result.increment.copy()
    increment[7] = np.nan
    broken = dataclasses.replace(result, increment=increment)
    assert np.isfinite(broken.turned_rad[:7]).all()
    assert np.isnan(broken.turned_rad[7:]).all()


def test_a_folder_that_is_no_result_or_a_damaged_one_is_refused_in_one_sentence(
    measured: tuple[Path, Measurement], tmp_path: Path, capsys
) -> None:
    assert main(["report", str(tmp_path)]) == 1
    assert "no result folder" in capsys.readouterr().err
    copy = tmp_path / "copy"
    shutil.copytree(measured[0], copy)
    for name, damage in (
        ("frames.npz", b"PK\x03\x04 cut"),
        ("summary.json", b'{"input": '),
        ("track.csv", b"a,b\n1\n"),
    ):
        kept = (copy / name).read_bytes()
        (copy / name).write_bytes(damage)
        assert main(["report", str(copy)]) == 1
        sentence = capsys.readouterr().err.strip()
        assert "damaged" in sentence
        assert "\n" not in sentence
        (copy / name).write_bytes(kept)


def test_a_result_that_lacks_frames_or_a_section_is_refused_as_damaged(
    measured: tuple[Path, Measurement], tmp_path: Path, capsys
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(measured[0], copy)
    summary = json.loads((copy / "summary.json").read_text())
    tables = ("track.csv", "kinematics.csv")
    half = {name: b"".join((copy / name).read_bytes().splitlines(True)[:11]) for name in tables}
    whole = (copy / "track.csv").read_bytes()
    for name, damage, reason in (
        ("track.csv", half["track.csv"], "track.csv has 10 of the 26 frames"),
        ("kinematics.csv", half["kinematics.csv"], "kinematics.csv has 10 of the 26 frames"),
        (
            "track.csv",
            whole.replace(b",ok,", b",banana,", 1),
            "the status of frame 0 in track.csv is 'banana', and none",
        ),
        ("track.csv", whole.replace(b",ok,", b",,", 1), "the status of frame 0 in track.csv is '', and none of ok, "),
        ("summary.json", b"[]", "input"),
        ("summary.json", json.dumps(summary | {"circle": None}).encode(), "circle"),
        ("summary.json", json.dumps(summary | {"input": {"path": "shot.tif"}}).encode(), "input"),
    ):
        kept = (copy / name).read_bytes()
        (copy / name).write_bytes(damage)
        assert main(["report", str(copy)]) == 1
        sentence = capsys.readouterr().err.strip()
        assert "damaged" in sentence
        assert reason in sentence
        assert "\n" not in sentence
        (copy / name).write_bytes(kept)
    assert main(["report", str(copy / "elsewhere")]) == 1
    assert "does not exist" in capsys.readouterr().err
