"""Plots and tables of a report in a browser: values at the pointer, zoom, several shots, a batch."""

import dataclasses
import itertools
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from torchsphere.report import pages
from torchsphere.report.comparison import write_comparison
from torchsphere.results.reader import read


def test_a_strip_below_each_plot_has_the_standard_deviation_on_its_own_scale(open_result: Any) -> None:
    report = open_result("si")
    table = report.table("kinematics.csv")
    for panel, columns, factor in (
        ("velocity", ("sd_vx_m_s", "sd_vy_m_s"), 1),
        ("force", ("sd_fx_N", "sd_fy_N"), 1e-3),
    ):
        below = report.drawn(f"#plot-{panel}")["below"]
        largest = max(float(row[column]) * factor for row in table for column in columns)
        assert below["most"] == pytest.approx(1.1 * largest, rel=1e-2)
        assert below["bottom"] < report.page.locator(f"#plot-{panel}").bounding_box()["height"]
    # The correlation has no standard deviation.
    assert report.drawn("#plot-zncc")["below"] is None
    assert report.drawn("#plot-turned")["below"]["most"] > 0


def test_a_plot_without_values_gives_the_reason_and_no_axes(browser: Any, results: Path, tmp_path: Path) -> None:
    result = read(results / "si")
    assert result.motion is not None
    nothing = np.full_like(result.motion.spin_rad_s, np.nan)
    motion = dataclasses.replace(result.motion, spin_rad_s=nothing, sd_spin_rad_s=nothing)
    smooth = dataclasses.replace(result, motion=motion, status=np.full(len(result.status), "weak_texture"))
    (tmp_path / "report.html").write_text(pages.report_html(smooth), encoding="utf-8")
    opened = browser.new_page(viewport={"width": 360, "height": 900})
    # Texts in the canvases.
    opened.add_init_script(
        "window.written = []; const fill = CanvasRenderingContext2D.prototype.fillText;"
        "CanvasRenderingContext2D.prototype.fillText = function (text, ...rest) {"
        " window.written.push([this.canvas.id, text]); return fill.call(this, text, ...rest); };"
    )
    opened.goto((tmp_path / "report.html").as_uri())
    written = [text for canvas, text in opened.evaluate("window.written") if canvas == "plot-spin"]
    assert "put spots of 3 to 5 px on the ball" in " ".join(written)
    assert "sd" not in written
    assert not any(text.replace(".", "").isdigit() for text in written)
    opened.close()


def test_every_control_is_reached_by_the_tab_key_and_shows_its_focus(open_result: Any) -> None:
    report = open_result("si")
    reached = []
    for _ in range(30):
        report.page.keyboard.press("Tab")
        reached.append(report.page.evaluate("document.activeElement.id || document.activeElement.tagName"))
        outline = report.page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
        assert outline == "solid" or reached[-1] == "BODY"
    overlays = ["show-circle", "show-axes", "show-graticule", "show-path"]
    assert reached[:6] == ["play", "slider", *overlays]
    # Of the buttons that zoom out, none can be pressed while all is shown. Then come the links to the files.
    rest = [name for name in reached[6:] if name not in ("A", "zoom-contact")]
    assert rest[:5] == ["zoom-in", "orbit", "orbit-reset", "orbit-camera", "SUMMARY"]
    assert "A" in reached


def test_a_batch_of_many_is_sorted_searched_and_paged(browser: Any, results: Path, tmp_path: Path) -> None:
    shutil.copytree(results / "si", tmp_path / "shot 1")
    rows = [{"recording": f"shot {i}.tif", "state": "done", "frames": (7 * i) % 501} for i in range(501)]
    rows[1]["result"] = "shot 1"
    rows[3] |= {"state": "failed", "reason": "The file is cut.", "frames": None}
    page = browser.new_page(viewport={"width": 360, "height": 740})
    console_messages: list[str] = []
    page.on("console", lambda message: console_messages.append(message.text))
    page.goto(pages.write_index(tmp_path, rows).as_uri())
    assert page.locator("tbody tr").count() == 200
    assert page.evaluate("document.scrollingElement.scrollWidth <= innerWidth")
    assert page.locator("img").evaluate("image => image.decode().then(() => image.naturalWidth)") > 0
    page.click("thead button:has-text('frames')")
    frames = page.locator("tbody tr td:nth-child(5)").all_inner_texts()
    assert frames == [str(v) for v in sorted(row["frames"] for row in rows if row["frames"] is not None)[:200]]
    assert page.get_attribute("thead th:nth-child(5)", "aria-sort") == "ascending"
    page.click("thead button:has-text('frames')")
    assert page.locator("tbody tr td:nth-child(5)").first.inner_text() == "500"
    page.click("#next")
    page.click("#next")
    assert page.text_content("#page") == "401 to 501 of 501"
    # Rows without a value are last in both directions.
    assert page.locator("tbody tr").last.inner_text().startswith("\tshot 3.tif\tfailed\tThe file is cut.")
    page.fill("#search", "cut")
    assert page.locator("tbody tr").count() == 1
    page.fill("#search", "shot 1.tif")
    page.click("tbody a")
    page.wait_for_selector("#verdict:has-text('All 12 frames')")
    assert console_messages == []
    page.close()


def test_severe_warnings_stand_in_the_state_and_can_be_chosen(browser: Any, tmp_path: Path) -> None:
    rows = [{"recording": f"{k}.tif", "state": "done", "severe_warnings": severe} for k, severe in enumerate((0, 3, 1))]
    rows.append({"recording": "3.tif", "state": "failed", "severe_warnings": None})
    page = browser.new_page()
    page.goto(pages.write_index(tmp_path, rows).as_uri())
    assert page.locator(".state").all_inner_texts() == ["done", "done, 3 severe", "done, 1 severe", "failed"]
    assert page.text_content("#verdict") == "4 recordings: 3 done (2 of them with severe warnings), 1 failed."
    page.select_option("#state", "done, severe")
    assert page.locator(".state").all_inner_texts() == ["done, 3 severe", "done, 1 severe"]
    page.select_option("#state", "done")
    assert page.locator(".state").count() == 3
    page.close()


def test_the_plots_zoom_by_buttons_keys_and_a_drag_and_return(open_result: Any) -> None:
    report = open_result("si")
    page = report.page
    whole = report.drawn("#plot-velocity")
    page.click("#zoom-in")
    halved = report.drawn("#plot-velocity")
    assert halved["to"] - halved["from"] == pytest.approx(0.5 * (whole["to"] - whole["from"]))
    # The limits follow what is in view.
    assert page.evaluate("data.panels.every((p) => !p.limits || p.limits[0] < p.limits[1])")
    assert " to " in page.text_content("#zoom-note")
    page.keyboard.press("0")
    assert report.drawn("#plot-velocity")["to"] == whole["to"]
    assert page.is_disabled("#zoom-whole")
    box = page.locator("#plot-velocity").bounding_box()
    page.locator("#plot-velocity").scroll_into_view_if_needed()
    box = page.locator("#plot-velocity").bounding_box()
    stop = report.at()
    page.keyboard.down("Shift")
    page.mouse.move(box["x"] + whole["left"] + 0.25 * whole["width"], box["y"] + 60)
    page.mouse.down()
    page.mouse.move(box["x"] + whole["left"] + 0.75 * whole["width"], box["y"] + 60, steps=3)
    page.mouse.up()
    page.keyboard.up("Shift")
    chosen = report.drawn("#plot-spin")
    span = whole["to"] - whole["from"]
    assert chosen["from"] == pytest.approx(whole["from"] + 0.25 * span, abs=0.02 * span)
    assert chosen["to"] == pytest.approx(whole["from"] + 0.75 * span, abs=0.02 * span)
    assert report.at() == stop
    page.keyboard.press("0")
    page.keyboard.press("+")
    page.keyboard.press("-")
    assert page.is_disabled("#zoom-whole")


@pytest.mark.parametrize("width", [1280, 360])
def test_the_pointer_shows_the_values_of_its_frame_within_the_page(open_result: Any, width: int) -> None:
    report = open_result("si", width=width)
    page, row = report.page, report.table("kinematics.csv")[8]
    plot = page.locator("#plot-velocity")
    plot.scroll_into_view_if_needed()
    scale, box = report.drawn("#plot-velocity"), plot.bounding_box()
    share = (1e3 * float(row["time_s"]) - scale["from"]) / (scale["to"] - scale["from"])
    page.mouse.move(box["x"] + scale["left"] + share * scale["width"], box["y"] + 60)
    tip = page.locator("#tip")
    assert tip.is_visible()
    text = tip.inner_text().replace("\u2212", "-")
    assert text.startswith(f"Frame {row['frame']}, ")
    assert f"x {float(row['vx_m_s']):.1f}"[:5] in text
    assert "\u00b1" in text
    assert tip.bounding_box()["x"] >= 0
    assert tip.bounding_box()["x"] + tip.bounding_box()["width"] <= width
    page.mouse.move(2, 2)
    assert tip.is_hidden()


def test_a_comparison_is_drawn_and_follows_a_click(browser: Any, results: Path, tmp_path: Path) -> None:
    write_comparison([results / "si", results / "lab"], tmp_path / "page.html")
    page, said = browser.new_page(), []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.goto((tmp_path / "page.html").as_uri())
    plot = page.locator("#plots canvas").first
    plot.click()
    assert plot.bounding_box()["height"] > 50
    assert page.locator("#plots canvas").count() >= 4
    assert said == []
    page.close()


def test_shots_that_coincide_are_told_apart_by_marks_side_by_side(browser: Any, results: Path, tmp_path: Path) -> None:
    for name in ("again", "third"):
        shutil.copytree(results / "si", tmp_path / name)
    write_comparison([results / "si", tmp_path / "again", tmp_path / "third"], tmp_path / "page.html")
    for width, scheme in ((1280, "light"), (360, "dark")):
        page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
        page.goto((tmp_path / "page.html").as_uri())
        marks = json.loads(page.get_attribute("#plot-velocity-x", "data-drawn"))["marks"]
        # Three marks of each shot or more, and none on another.
        assert all(sum(shot == k for shot, _, _ in marks) >= 3 for k in range(3))
        places = sorted(x for _, x, _ in marks)
        assert min(b - a for a, b in itertools.pairwise(places)) > 15
        # What is seen where a mark lies has the colour of its shot.
        colours = """marks => marks.map(([shot, x, y]) => {
          const canvas = document.getElementById("plot-velocity-x"), ratio = window.devicePixelRatio || 1;
          const [r, g, b] = canvas.getContext("2d").getImageData(x * ratio, y * ratio, 1, 1).data;
          return "#" + [r, g, b].map((v) => v.toString(16).padStart(2, "0")).join("") === shotColour(shot);
        })"""
        cursor = json.loads(page.get_attribute("#plot-velocity-x", "data-drawn"))["cursor"]
        seen = page.evaluate(colours, [m for m in marks if abs(m[1] - cursor) > 4])
        assert all(seen)
        # A shot alone needs none.
        page.uncheck('[data-show="1"]')
        page.uncheck('[data-show="2"]')
        assert "marks" not in json.loads(page.get_attribute("#plot-velocity-x", "data-drawn"))
        page.close()


def test_a_ball_without_rotation_has_neither_graticule_nor_axes(browser: Any, results: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(results / "si", tmp_path / "plain")
    head, first, *rest = (folder / "track.csv").read_text().splitlines()
    cut = [",".join([*line.split(",")[:-4], *["nan"] * 4]) for line in rest]
    (folder / "track.csv").write_text("\n".join([head, first, *cut]) + "\n")
    page = browser.new_page()
    (tmp_path / "report.html").write_text(pages.report_html(read(folder)))
    page.goto((tmp_path / "report.html").as_uri())
    drawn = json.loads(page.get_attribute("#frame", "data-drawn"))
    assert drawn["circle"] is not None
    assert drawn["axes"] is None
    assert json.loads(page.get_attribute("#orbit", "data-drawn"))["axes"] is None
    assert page.is_hidden("#show-graticule")
    page.close()
