"""The index page of a batch: what it holds, and the command that draws a whole batch again."""

import csv
import json
import math
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
import tifffile

from torchsphere.cli.main import main
from torchsphere.report import index_page
from torchsphere.synthetic import demo_shot


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("index")
    tifffile.imwrite(folder / "shot.tif", demo_shot.make_shot().images[:5], photometric="minisblack")
    arguments = ["track", str(folder / "shot.tif"), "--out", str(folder / "out"), "--circle", "64.3,92.6,40", "--quiet"]
    assert main(arguments) == 0
    return folder / "out"


def batch(folder: Path, result: Path) -> list[dict[str, Any]]:
    """A batch of three recordings, of which one is done, with its ``summary.csv``."""
    shutil.copytree(result, folder / "day 1" / "shot#1")
    rows = [
        {"recording": "day 1/shot#1.tif", "state": "done", "reason": "", "frames": 5, "ok": 5, "speed_m_s": math.nan},
        {"recording": "</script>.tif", "state": "failed", "reason": "The file is cut; copy it again.", "frames": None},
        {"recording": "late.tif", "state": "pending"},
    ]
    rows[0]["result"] = "day 1/shot#1"
    with (folder / "summary.csv").open("w", newline="") as stream:
        writer = csv.DictWriter(stream, [*rows[0]])
        writer.writeheader()
        writer.writerows(rows)
    return rows


def data(page: str) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    return json.loads(found[1])


def test_every_recording_has_a_row_and_only_a_measured_one_a_report_and_a_picture(tmp_path: Path, result: Path) -> None:
    rows = batch(tmp_path, result)
    page = index_page.write_index(tmp_path, rows).read_text()
    assert "3 recordings: 1 done, 1 failed, 1 pending." in page
    table = data(page)
    assert table["columns"] == ["recording", "state", "reason", "frames", "ok", "speed_m_s"]
    first, second, third = table["rows"]
    # "#" and the space would end or break an address.
    assert first["report"] == "day%201/shot%231/report.html"
    assert first["picture"] == "day%201/shot%231/figures/thumbnail.webp"
    assert first["cells"] == ["day 1/shot#1.tif", "done", None, 5, 5, None]
    assert second["report"] is None
    assert second["picture"] is None
    assert second["cells"][:3] == ["</script>.tif", "failed", "The file is cut; copy it again."]
    assert third["cells"] == ["late.tif", "pending", None, None, None, None]
    assert page.count("</script>") == 2


def test_report_draws_a_whole_batch_again_from_its_folder(tmp_path: Path, result: Path, capsys) -> None:
    batch(tmp_path, result)
    report = tmp_path / "day 1" / "shot#1" / "report.html"
    before = report.read_bytes()
    report.unlink()
    assert main(["report", str(tmp_path), "--quiet"]) == 0
    assert report.read_bytes() == before
    assert data((tmp_path / "index.html").read_text())["rows"][0]["cells"][3] == 5
    assert not [path.name for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_a_damaged_result_is_named_and_the_index_is_written_all_the_same(tmp_path: Path, result: Path, capsys) -> None:
    batch(tmp_path, result)
    (tmp_path / "day 1" / "shot#1" / "track.csv").write_text("frame\n")
    assert main(["report", str(tmp_path), "--quiet"]) == 1
    assert "1 of 3 results could not be drawn" in capsys.readouterr().err
    assert (tmp_path / "index.html").is_file()


def test_an_empty_batch_says_so(tmp_path: Path) -> None:
    assert "There are no recordings yet." in index_page.write_index(tmp_path, []).read_text()
