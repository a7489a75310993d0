"""A result folder read back: the numbers that were measured, and damage that is refused."""

import dataclasses
import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from torchsphere.cli.main import main
from torchsphere.measure import Measurement
from torchsphere.report.pages import report_html
from torchsphere.results.reader import ResultFolder, read
from torchsphere.results.sampled_frames import load


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


WRONG = ("text", -1, 1e308, 10**400, [], {}, [[None]], True, None)


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The path of each value within a JSON object."""
    yield path
    inner = value.items() if isinstance(value, dict) else enumerate(value[:2]) if isinstance(value, list) else ()
    for key, each in inner:
        yield from places(each, (*path, key))


def replaced(value: Any, path: tuple[Any, ...], other: Any) -> Any:
    """The object with another value at a path."""
    if not path:
        return other
    copy = value.copy()
    copy[path[0]] = replaced(value[path[0]], path[1:], other)
    return copy


def test_any_value_in_any_field_of_a_summary_is_drawn_or_refused_in_a_sentence(
    measured: tuple[Path, Measurement], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(measured[0], copy)
    # The figures take most of the time, and the page shows all fields.
    monkeypatch.setattr("torchsphere.report.draw.draw", lambda folder: report_html(read(folder)))
    summary = json.loads((copy / "summary.json").read_text())
    everywhere = list(places(summary))
    assert len(everywhere) > 100
    codes = set()
    # All values in all places take minutes; here each eighth place gets one of them.
    for number, path in list(enumerate(everywhere))[::8]:
        damaged = replaced(summary, path, WRONG[number // 8 % len(WRONG)])
        (copy / "summary.json").write_text(json.dumps(damaged))
        codes.add(main(["report", str(copy), "--quiet"]))
        printed = capsys.readouterr().err
        assert printed == "" or (printed.startswith(f"torchsphere: {copy}: the result") and printed.count("\n") == 1)
    assert codes == {0, 1}


@pytest.mark.parametrize("text", ["[" * 100_000, '{"input": ' * 50_000], ids=["lists", "tables"])
def test_a_summary_nested_without_end_is_refused(measured: tuple[Path, Measurement], tmp_path: Path, text: str) -> None:
    shutil.copytree(measured[0], tmp_path / "copy")
    (tmp_path / "copy" / "summary.json").write_text(text)
    with pytest.raises(ValueError, match="the result is damaged"):
        read(tmp_path / "copy")


def refusal_of(reader: Callable[[Path], Any], path: Path) -> str | None:
    """The sentence in which a file is refused; None where it is read."""
    try:
        reader(path)
    except ValueError as refusal:
        return str(refusal)
    return None


CELLS = ("", "x", "nan", "-1", "1e308", "9" * 400, "\0", '"', "é", "x" * 140_000)


@pytest.mark.parametrize("name", ["track.csv", "kinematics.csv", "force_path.csv"])
def test_any_cell_of_a_table_is_drawn_or_refused_in_a_sentence(
    measured: tuple[Path, Measurement], tmp_path: Path, name: str, capsys
) -> None:
    shutil.copytree(measured[0], tmp_path / "copy")
    rows = [line.split(",") for line in (measured[0] / name).read_text(encoding="utf-8").splitlines()]
    random = np.random.default_rng(2)
    for number, cell in enumerate(2 * CELLS):
        row = int(random.integers(len(rows))) if number < len(CELLS) else 0
        damaged = replaced(rows, (row, int(random.integers(len(rows[row])))), cell)
        (tmp_path / "copy" / name).write_text("\r\n".join(map(",".join, damaged)) + "\r\n", encoding="utf-8")
        sentence = refusal_of(read, tmp_path / "copy")
        assert sentence is None or sentence.startswith(f"{tmp_path / 'copy'}: the result is damaged (")


def test_damaged_images_are_refused_whatever_their_archive_raises(
    measured: tuple[Path, Measurement], tmp_path: Path
) -> None:
    data = (measured[0] / "frames.npz").read_bytes()
    directory = data.rindex(b"PK\x01\x02")
    random, refused = np.random.default_rng(3), 0
    for number in range(60):
        # The version that reading needs stands at byte 6 of an entry of the directory.
        at = directory + 6 if number == 0 else int(random.integers(len(data) - 900, len(data)))
        (tmp_path / "frames.npz").write_bytes(data[:at] + b"\x9d" + data[at + 1 :])
        sentence = refusal_of(load, tmp_path / "frames.npz")
        refused += sentence is not None
        assert sentence is None or "the kept images are damaged" in sentence
    assert refused > 10


@pytest.mark.parametrize(
    "scale", ["text", 5, [], {}, {"m_per_px": None}, {"m_per_px": "0.1"}, {"m_per_px": 1e-4, "sd_m_per_px": [1]}, True]
)
def test_a_broken_scale_is_one_sentence_that_names_it(
    measured: tuple[Path, Measurement], tmp_path: Path, scale: Any, capsys
) -> None:
    for name in ("track.csv", "kinematics.csv"):
        shutil.copy(measured[0] / name, tmp_path / name)
    summary = json.loads((measured[0] / "summary.json").read_text())
    (tmp_path / "summary.json").write_text(json.dumps(summary | {"scale": scale}))
    assert main(["report", str(tmp_path)]) == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    said = f"torchsphere: {tmp_path}: the result is damaged (summary.json tells no size of a pixel as its scale, but "
    assert printed.err.startswith(said)
    assert printed.err.count("\n") == 1
    assert not (tmp_path / "report.html").exists()
