"""The page that compares several results: alignment, axes, names, tables, and the page in a browser."""

import dataclasses
import html
import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from result_folders import in_px

from torchsphere.cli.main import main
from torchsphere.measure import Measurement
from torchsphere.report import comparison
from torchsphere.report.comparison import Shot, comparison_html, write_comparison
from torchsphere.results.reader import ResultFolder, read


def data_of(page: str) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    return json.loads(found[1])


def copied(folder: Path, place: Path, *, later_s: float = 0.0, factor: float = 1.0) -> Path:
    """The result as that of a shot that comes later and is faster by a factor."""
    shutil.copytree(folder, place)
    summary = json.loads((place / "summary.json").read_text())
    for one in (summary["impact"], *summary["impacts"]):
        for name in ("contact_start", "contact_end", "peak_time"):
            one[name]["value"] += later_s
        one["speed_before"]["value"] *= factor
    summary["contact_s"] = [t + later_s for t in summary["contact_s"]]
    (place / "summary.json").write_text(json.dumps(summary))
    for name in ("track.csv", "kinematics.csv"):
        lines = (place / name).read_text().splitlines()
        head = lines[0].split(",")
        rows = [line.split(",") for line in lines[1:]]
        for row in rows:
            row[head.index("time_s")] = f"{float(row[head.index('time_s')]) + later_s:.10g}"
            if "vx_m_s" in head:
                row[head.index("vx_m_s")] = f"{float(row[head.index('vx_m_s')]) * factor:.10g}"
        (place / name).write_text("\r\n".join([lines[0], *(",".join(row) for row in rows)]) + "\r\n")
    return place


@pytest.fixture(scope="module")
def two(measured: tuple[Path, Measurement], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The demo's impact, and the same shot 2 ms later and faster by a tenth."""
    folder = tmp_path_factory.mktemp("compared")
    shutil.copytree(measured[0], folder / "one")
    return folder / "one", copied(measured[0], folder / "two", later_s=2e-3, factor=1.1)


def test_shots_are_aligned_at_their_first_touch(two: tuple[Path, Path], tmp_path: Path) -> None:
    data = data_of(write_comparison(two, tmp_path / "page.html").read_text())
    assert data["names"] == ["one", "two"]
    # Files have ten digits: 1e-9 of 2 ms, in ms.
    np.testing.assert_allclose(data["times"][0], data["times"][1], atol=1e-6)
    np.testing.assert_allclose(data["contacts"][0], data["contacts"][1], atol=1e-6)
    assert data["contacts"][0][0] == pytest.approx(0.0, abs=1e-9)
    velocity = next(panel for panel in data["panels"] if panel["key"] == "velocity-x")
    np.testing.assert_allclose(velocity["values"][1], 1.1 * np.array(velocity["values"][0]), rtol=1e-6)
    start = read(two[0]).summary["impact"]["contact_start"]["value"]
    np.testing.assert_allclose(data["times"][0], 1e3 * (read(two[0]).time_s - start), atol=1e-6)


def test_the_table_has_the_numbers_of_each_shot_with_their_deviations(two: tuple[Path, Path], tmp_path: Path) -> None:
    text = write_comparison(two, tmp_path / "page.html").read_text()
    row = re.search(r"Speed before</th>(.*?)</tr>", text, re.DOTALL)
    assert row is not None
    cells = [html.unescape(cell) for cell in re.findall(r"<td>(.*?)</td>", row[1])]
    for folder, cell in zip(two, cells, strict=True):
        speed = read(folder).summary["impact"]["speed_before"]
        value, sd = re.fullmatch(r"([\d.]+) ± ([\d.]+) m/s", cell).groups()  # type: ignore[union-attr]
        assert float(value) == pytest.approx(speed["value"], abs=0.51 * float(sd))
        assert float(sd) == pytest.approx(speed["sd"], rel=0.05)


def test_a_shot_in_the_lab_frame_and_the_same_in_the_camera_frame_coincide(result: ResultFolder) -> None:
    motion = result.motion
    assert motion is not None
    signs = np.array([1.0, -1.0, -1.0])
    turned = {
        name: getattr(motion, name) * signs[: getattr(motion, name).shape[1]]
        for name in ("position_m", "velocity_m_s", "acceleration_m_s2", "force_N", "spin_rad_s")
    }
    settings = result.summary["settings"] | {"lab_frame": True}
    impact = result.summary["impact"]
    velocity = impact["velocity_before"] | {
        "value": [v * s for v, s in zip(impact["velocity_before"]["value"], signs, strict=False)]
    }
    summary = result.summary | {"settings": settings, "impact": impact | {"velocity_before": velocity}}
    lab = dataclasses.replace(result, motion=dataclasses.replace(motion, **turned), summary=summary)
    shots = [Shot("a", result, None, result.axis_signs), Shot("b", lab, None, lab.axis_signs)]
    text = comparison_html(shots, Path("page.html"))
    for panel in data_of(text)["panels"]:
        assert panel["values"][0] == panel["values"][1], panel["key"]
    row = re.search(r"Velocity before \(x, y\)</th>(.*?)</tr>", text, re.DOTALL)
    assert row is not None
    first, second = re.findall(r"<td>(.*?)</td>", row[1])
    assert first == second
    assert "All are shown in the camera frame" in text


def test_a_shot_without_contact_or_without_units_is_named_and_the_others_stay(result: ResultFolder) -> None:
    free = dataclasses.replace(result, summary=result.summary | {"impact": None, "impacts": [], "contact_s": None})
    shots = [
        Shot("hit", result, (1.7e-4, 2.9e-4), np.ones(3)),
        Shot("free", free, None, np.ones(3)),
        Shot("px", in_px(result), None, np.ones(3)),
    ]
    text = comparison_html(shots, Path("page.html"))
    data = data_of(text)
    assert "1 of 3 shots has a contact" in text
    assert "free: no contact was found" in text
    assert "px: velocities are not known" in text
    assert data["times"][1][0] == 0.0
    assert data["times"][2] == []
    assert all(panel["values"][2] == [] for panel in data["panels"])


def test_names_are_as_long_as_it_takes_to_tell_the_shots_apart() -> None:
    folders = [Path("/a/day1/shot"), Path("/a/day2/shot"), Path("/a/day2/other")]
    assert comparison._names(folders) == ["day1/shot", "day2/shot", "day2/other"]


def test_any_name_of_a_shot_stays_text(result: ResultFolder) -> None:
    name = "</script><script>alert(1)</script>"
    text = comparison_html([Shot(name, result, None, np.ones(3)), Shot("b", result, None, np.ones(3))], Path("p.html"))
    assert "alert(1)</script>" not in text
    assert "http://" not in text
    assert "https://" not in text


def test_long_recordings_are_thinned_but_not_around_the_contact(result: ResultFolder) -> None:
    n = 50_000
    time = np.arange(n) / 1e6
    long = dataclasses.replace(result, frame=np.arange(n), time_s=time)
    rows = comparison._rows(Shot("a", long, (0.0200005, 0.0200995), np.ones(3)), 2000)
    assert len(rows) < 2600
    assert set(range(20_000 - 190, 20_101 + 190)) <= set(rows.tolist())
    assert {0, n - 1} <= set(rows.tolist())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["one", "one"], "is named twice"),
        (["one", "nothing"], "does not exist"),
        (["one", "two", "--overlay"], "--overlay is made of one result"),
        (["one", "--out", "page.html"], "a comparison, which takes two results or more"),
        (["one", "two", "--out", "."], "is a folder; give the name of a page"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_a_sentence(
    two: tuple[Path, Path], arguments: list[str], words: str, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(two[0].parent)
    assert main(["report", *arguments]) == 1
    printed = capsys.readouterr()
    assert words in printed.err
    assert printed.out == ""
    assert not Path("comparison.html").exists()
    assert not Path("page.html").exists()


def test_the_page_works_in_a_browser_on_a_phone_and_wide_light_and_dark(
    browser: Any, two: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(two[0].parent)
    assert main(["report", "one", "two", "--quiet"]) == 0
    address = (two[0].parent / "comparison.html").as_uri()
    for width, scheme in ((360, "light"), (1280, "dark")):
        page = browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
        messages: list[str] = []
        requests: list[str] = []
        page.on("console", lambda message, seen=messages: seen.append(message.text))
        page.on("pageerror", lambda error, seen=messages: seen.append(str(error)))
        page.on("request", lambda request, seen=requests: seen.append(request.url))
        page.goto(address)
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        drawn = json.loads(page.get_attribute("#plot-velocity-x", "data-drawn"))
        # At first the page shows two durations on either side of the contact.
        contact = page.evaluate("torchsphere.data.contacts[0]")
        assert drawn["from"] >= -2 * contact[1] - 1e-6
        speeds = [page.text_content(f'[data-value="velocity-x {shot}"]') for shot in (0, 1)]
        first, second = (float(text.split(" ")[0].replace("\u2212", "-")) for text in speeds)
        assert second == pytest.approx(1.1 * first, rel=2e-3)
        # A shot that is hidden does not set the limits.
        page.uncheck('[data-show="1"]')
        assert json.loads(page.get_attribute("#plot-velocity-x", "data-drawn"))["limits"][1] < drawn["limits"][1]
        page.click("#whole")
        whole = json.loads(page.get_attribute("#plot-velocity-x", "data-drawn"))
        assert whole["from"] <= drawn["from"]
        box = page.locator("#plot-velocity-x").bounding_box()
        page.mouse.click(box["x"] + whole["left"] + 0.9 * whole["width"], box["y"] + 80)
        at = page.evaluate("torchsphere.view.at")
        assert at == pytest.approx(whole["from"] + 0.9 * (whole["to"] - whole["from"]), abs=0.02)
        page.focus("#moment")
        page.keyboard.press("Home")
        assert page.evaluate("torchsphere.view.at") == pytest.approx(whole["from"])
        assert page.get_attribute("#shots a", "href") == "one/report.html"
        assert messages == []
        assert requests == [address]
        page.close()


def test_severe_warnings_of_a_shot_are_counted_apart() -> None:
    summary = {"warnings": ["a", "b", "c"], "warning_levels": ["severe", "caution", "note"]}
    assert comparison._warnings(summary) == "3, of them 1 severe: see the report"
    assert comparison._warnings({"warnings": ["a"]}) == "1"
