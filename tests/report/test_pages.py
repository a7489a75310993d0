"""HTML pages: any text stays text, the report of a result, and the index of a batch."""

import csv
import dataclasses
import html
import json
import math
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from torchsphere.cli.main import main
from torchsphere.report import explanations, pages
from torchsphere.results.reader import ResultFolder, read
from torchsphere.synthetic import demo_shot


def filled(data: Any, title: str = "") -> str:
    return pages.page("base.html", title=title, grade="good", verdict="", data=data)


def test_any_text_comes_back_from_the_data_and_cannot_end_its_script() -> None:
    texts = ["</script><script>alert(1)</script>", "<!-- <script>", "&amp; &lt;", "{{ title }}", "'\"\\\u2028", "µ ±"]
    text = filled(texts)
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    assert json.loads(found[1]) == texts
    assert text.count("<script") == text.count("</script>") == 2


def test_a_title_stays_text() -> None:
    assert "<h1>&lt;b&gt; &amp; {{ title }}</h1>" in filled(None, "<b> & {{ title }}")


def test_data_that_json_lacks_is_refused() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        filled({"values": [1.0, float("nan")]})


def test_a_report_loads_no_other_file_and_allows_any_name(result: ResultFolder, tmp_path: Path) -> None:
    name = "</script><script>alert(1)</script><!-- &amp; $title {{ title }} {% raw %}.tif"
    source = result.summary["input"] | {"path": f"/shots/{name}"}
    summary = result.summary | {"input": source, "warnings": [f"A warning of {name}."]}
    text = pages.report_html(dataclasses.replace(result, summary=summary))
    assert "default-src 'none'" in text
    assert "http://" not in text
    assert "https://" not in text
    assert "alert(1)</script>" not in text
    # The script of the data and the script of the page.
    assert text.count("</script>") == 2
    assert f"A warning of {html.escape(name)}." in text


def test_options_of_the_command_line_are_formatted_as_code(result: ResultFolder) -> None:
    summary = result.summary | {"warnings": ["Give --mm-per-px <px>, or --fps."]}
    text = pages.report_html(dataclasses.replace(result, summary=summary))
    assert "<li>Give <code>--mm-per-px</code> &lt;px&gt;, or <code>--fps</code>.</li>" in text


def test_the_report_of_a_recording_without_the_ball_has_words_and_no_nan(tmp_path: Path) -> None:
    images = demo_shot.make_shot().images[:8].copy()
    images[1:] = np.random.default_rng(0).integers(55, 66, images[1:].shape)
    tifffile.imwrite(tmp_path / "shot.tif", images, photometric="minisblack")
    arguments = ["track", str(tmp_path / "shot.tif"), "--out", str(tmp_path / "out"), "--circle", "64.3,92.6,40"]
    assert main([*arguments, "--fps", "36000", "--diameter-mm", "30", "--mass-g", "110", "--quiet"]) == 4
    result = read(tmp_path / "out")
    assert (
        explanations.verdict(result) == "No motion was measured: the ball was found in 1 frame of 8, but not followed."
    )
    # The circle was given, so that the option is no remedy.
    assert not any("--circle" in p.remedy for p in explanations.problems(result))
    assert any("circle that was given" in p.remedy for p in explanations.problems(result))
    assert sum(len(p.remedy) > 0 for p in explanations.problems(result)) == len(explanations.problems(result)) > 0
    text = (tmp_path / "out" / "report.html").read_text()
    assert "nan" not in text.split('id="data"')[0].lower().replace("nano", "")
    assert "not measured: no motion was measured" in text
    assert "steady motion" not in text
    assert "No impact is reported: no motion was measured." in result.summary["warnings"]
    assert not any("steady motion" in sentence for sentence in result.summary["warnings"])


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("index")
    tifffile.imwrite(folder / "shot.tif", demo_shot.make_shot().images[:5], photometric="minisblack")
    arguments = ["track", str(folder / "shot.tif"), "--out", str(folder / "out"), "--circle", "64.3,92.6,40", "--quiet"]
    assert main(arguments) == 0
    return folder / "out"


def batch(folder: Path, done: Path) -> list[dict[str, Any]]:
    """A batch of three recordings, of which one is done, with its ``summary.csv``."""
    shutil.copytree(done, folder / "day 1" / "shot#1")
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


def test_every_recording_has_a_row_and_only_a_result_has_report_and_thumbnail(tmp_path: Path, done: Path) -> None:
    rows = batch(tmp_path, done)
    page = pages.write_index(tmp_path, rows).read_text()
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


def test_report_draws_a_whole_batch_again_from_its_folder(tmp_path: Path, done: Path, capsys) -> None:
    batch(tmp_path, done)
    report = tmp_path / "day 1" / "shot#1" / "report.html"
    before = report.read_bytes()
    report.unlink()
    assert main(["report", str(tmp_path), "--quiet"]) == 0
    assert report.read_bytes() == before
    assert data((tmp_path / "index.html").read_text())["rows"][0]["cells"][3] == 5
    assert not [path.name for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_a_damaged_result_is_named_and_the_index_is_still_written(tmp_path: Path, done: Path, capsys) -> None:
    batch(tmp_path, done)
    (tmp_path / "day 1" / "shot#1" / "track.csv").write_text("frame\n")
    assert main(["report", str(tmp_path), "--quiet"]) == 1
    assert "1 of 3 results could not be drawn" in capsys.readouterr().err
    assert (tmp_path / "index.html").is_file()


def test_an_empty_batch_says_so(tmp_path: Path) -> None:
    assert "There are no recordings yet." in pages.write_index(tmp_path, []).read_text()
