"""The report in a browser, opened from its file: keys, slider, clicks and drags."""

import csv
import dataclasses
import io
import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image
from scipy.spatial.transform import Rotation

from torchsphere.cli.main import main
from torchsphere.report import pages
from torchsphere.report.comparison import write_comparison
from torchsphere.results.reader import read
from torchsphere.synthetic import demo_shot

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (extra 'dev')")

FIRST, LAST = 34, 45
AXIS_LENGTH = 1.3


@dataclass
class Opened:
    """A page, its result, its requests and its messages on the console."""

    page: Any
    folder: Path
    requests: list[str] = field(default_factory=list)
    console_messages: list[str] = field(default_factory=list)

    def table(self, name: str) -> list[dict[str, str]]:
        with (self.folder / name).open(newline="") as stream:
            return list(csv.DictReader(stream))

    def at(self) -> int:
        return int(self.page.evaluate("torchsphere.state.stop"))

    def drawn(self, canvas: str) -> dict[str, Any]:
        return json.loads(self.page.get_attribute(canvas, "data-drawn"))

    def text(self, value: str) -> float:
        """A number of the page."""
        return float(self.page.text_content(f'[data-value="{value}"]').replace("\u2212", "-"))


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if program is None:
        pytest.skip("there is no Chromium to open the report with; install the package 'chromium'")
    with sync_api.sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield launched
        launched.close()


@pytest.fixture(scope="module")
def shot() -> demo_shot.Shot:
    return demo_shot.make_shot()


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory, shot: demo_shot.Shot) -> Path:
    """Results of twelve frames after the demo's impact: in SI units, in the lab frame, in px, and of a lost ball."""
    folder = tmp_path_factory.mktemp("browser")
    images = shot.images[FIRST : LAST + 1].copy()
    tifffile.imwrite(folder / "shot.tif", images, photometric="minisblack")
    images[5:] = np.random.default_rng(0).integers(55, 66, images[5:].shape)
    tifffile.imwrite(folder / "gone.tif", images, photometric="minisblack")
    x, y = shot.position[FIRST]
    options = ["--circle", f"{x},{y},{demo_shot.RADIUS_PX}", "--map", "off", "--quiet"]
    si = ["--fps", "36000", "--diameter-mm", "30", "--mass-g", "110"]
    for name, source, more in (
        ("si", "shot.tif", si),
        ("lab", "shot.tif", [*si, "--lab-frame"]),
        ("px", "shot.tif", []),
        ("gone", "gone.tif", si),
    ):
        assert main(["track", str(folder / source), "--out", str(folder / name), *options, *more]) == 0
    return folder


@pytest.fixture
def open_result(browser: Any, results: Path) -> Iterator[Any]:
    pages = []

    def opener(name: str, width: int = 1280, height: int = 900, scheme: str = "light") -> Opened:
        page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
        opened = Opened(page, results / name)
        page.on("request", lambda request: opened.requests.append(request.url))
        page.on("console", lambda message: opened.console_messages.append(message.text))
        page.on("pageerror", lambda error: opened.console_messages.append(str(error)))
        page.goto((results / name / "report.html").as_uri())
        pages.append(opened)
        return opened

    yield opener
    for opened in pages:
        assert opened.console_messages == []
        outside = [url for url in opened.requests if not url.startswith(("file:", "data:"))]
        assert outside == []
        assert sum(url.startswith("file:") for url in opened.requests) == 1
        opened.page.close()


def test_keys_and_slider_lead_through_the_frames_and_the_numbers_follow(open_result: Any) -> None:
    report = open_result("si")
    page, table = report.page, report.table("kinematics.csv")
    columns = {
        "velocity x": ("vx_m_s", 1),
        "force y": ("fy_N", 1e-3),
        "spin z": ("wz_rad_s", 1),
        "position x": ("x_m", 1e3),
    }
    for key, frame in (("End", 11), ("ArrowLeft", 10), ("Home", 0), ("ArrowRight", 1), ("PageDown", 11), ("PageUp", 1)):
        page.keyboard.press(key)
        assert report.at() == frame
        assert page.input_value("#slider") == str(frame)
        assert page.text_content("#now").startswith(f"Frame {frame}, time ")
        for shown, (column, factor) in columns.items():
            value, sd = float(table[frame][column]) * factor, float(table[frame][f"sd_{column}"]) * factor
            # The page rounds to the second digit of the standard deviation.
            assert abs(report.text(shown) - value) <= 0.051 * sd
    page.fill("#slider", "7")
    assert report.at() == 7
    box = page.locator("#slider").bounding_box()
    page.mouse.click(box["x"] + box["width"] - 3, box["y"] + box["height"] / 2)
    assert report.at() == 11
    page.keyboard.press("ArrowLeft")
    assert report.at() == 10


def test_space_plays_to_the_end_and_stops(open_result: Any) -> None:
    report = open_result("si")
    report.page.keyboard.press(" ")
    assert report.page.get_attribute("#play", "aria-pressed") == "true"
    report.page.wait_for_selector("#play[aria-pressed=false]")
    assert report.at() == 11


@pytest.mark.parametrize("plot", ["plot-velocity", "plot-zncc", "strip"])
def test_a_click_or_a_drag_in_a_plot_goes_to_that_moment(open_result: Any, plot: str) -> None:
    report = open_result("si")
    canvas = report.page.locator(f"#{plot}")
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    scale = report.page.evaluate("torchsphere.drawn")
    across = scale["strip"] if plot == "strip" else scale["plots"][plot.removeprefix("plot-")]

    def place(frame: int) -> tuple[float, float]:
        share = (1e3 * frame / 36_000 - across["from"]) / (across["to"] - across["from"])
        return box["x"] + across["left"] + share * across["width"], box["y"] + box["height"] / 2

    report.page.mouse.move(*place(4))
    report.page.mouse.down()
    assert report.at() == 4
    report.page.mouse.move(*place(9))
    assert report.at() == 9
    report.page.mouse.up()
    report.page.mouse.move(*place(2))
    assert report.at() == 9


def test_circle_and_axes_are_drawn_at_the_true_position_and_orientation(open_result: Any, shot: demo_shot.Shot) -> None:
    report = open_result("si")
    left, top = report.page.evaluate("torchsphere.data.images.box.slice(0, 2)")
    for frame in (0, 6, 11):
        report.page.evaluate(f"torchsphere.seek({frame})")
        drawn = report.drawn("#frame")
        x, y, radius = np.array(drawn["circle"]) / drawn["scale"]
        # Steps of 0.005 px add up over eleven frames.
        np.testing.assert_allclose((x + left, y + top), shot.position[FIRST + frame], atol=0.05)
        assert radius == pytest.approx(demo_shot.RADIUS_PX, abs=1e-6)
        turned = shot.orientation[FIRST + frame] @ shot.orientation[FIRST].T
        for k, name in enumerate("xyz"):
            tip = (np.array(drawn["axes"][name]) / drawn["scale"] - (x, y)) / (AXIS_LENGTH * radius)
            # 0.2 deg: the largest error of eleven steps of 0.02 deg.
            np.testing.assert_allclose(tip, turned[:2, k], atol=np.radians(0.2))
            if abs(turned[2, k]) > 0.01:
                assert drawn["front"][name] == (turned[2, k] < 0)
    assert turned[0, 1] < -0.03  # there is a rotation to see


def test_axes_and_graticule_have_pixels_and_can_be_hidden(open_result: Any) -> None:
    report = open_result("si")
    report.page.evaluate("torchsphere.seek(6)")
    # The first view of a frame decodes it.
    report.page.evaluate("pictures.get(data.images.frames[6]).decode()")
    report.page.evaluate("drawFrame()")
    drawn = report.drawn("#frame")

    def painted(what: str, colour: tuple[int, int, int]) -> int:
        """Pixels of about that colour around the arrow of the x axis beyond the ball, or within the ball."""
        seen = Image.open(io.BytesIO(report.page.locator("#frame").screenshot())).convert("RGB")
        centre, radius = np.array(drawn["circle"][:2]), drawn["circle"][2]
        middle = centre + 0.88 * (np.array(drawn["axes"]["x"]) - centre) if what == "arrow" else centre
        half = 4 if what == "arrow" else radius * 0.6
        part = np.asarray(seen.crop([round(v) for v in (*(middle - half), *(middle + half))])).astype(int)
        return int((np.abs(part - colour).max(-1) < 60).sum())

    orange, yellow = (255, 140, 66), (255, 216, 77)
    assert painted("arrow", orange) >= 8
    assert painted("ball", yellow) >= 100
    report.page.uncheck("#show-axes")
    report.page.uncheck("#show-graticule")
    assert painted("arrow", orange) == 0
    assert painted("ball", yellow) < 20


@pytest.mark.parametrize(("name", "axes"), [("si", (1, 1, 1)), ("lab", (1, -1, -1))])
def test_the_ball_in_space_turns_with_mouse_and_keys_and_returns(
    open_result: Any, name: str, axes: tuple[int, int, int]
) -> None:
    report = open_result(name)
    page = report.page
    page.evaluate("torchsphere.seek(9)")
    canvas = page.locator("#orbit")
    canvas.scroll_into_view_if_needed()
    first = report.drawn("#orbit")
    box = canvas.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 40, y - 20, steps=4)
    page.mouse.up()
    dragged = report.drawn("#orbit")
    # 0.01 rad per px: the front follows the mouse.
    assert dragged["view"]["yaw"] == pytest.approx(first["view"]["yaw"] - 0.4)
    assert dragged["view"]["pitch"] == pytest.approx(first["view"]["pitch"] - 0.2)
    row = report.table("track.csv")[9]
    ball = Rotation.from_quat([float(row[k]) for k in ("qx", "qy", "qz", "qw")]).as_matrix()
    # About the screen's upward direction and then about its right: x' = R_x(pitch) R_y(yaw) x.
    view = Rotation.from_euler("yx", [dragged["view"]["yaw"], dragged["view"]["pitch"]]).as_matrix()
    middle = dragged["size"] / 2
    for k, axis in enumerate("xyz"):
        tip = (np.array(dragged["axes"][axis]) - middle) / (1.25 * dragged["radius"])
        np.testing.assert_allclose(tip, (view @ ball)[:2, k], atol=1e-5)
    # The spin of the results' frame, brought into the camera's.
    spins = [[float(r[f"w{k}_rad_s"]) for k in "xyz"] for r in report.table("kinematics.csv")]
    spin = view @ (np.array(spins[9]) * axes) / np.linalg.norm(spins, axis=1).max()
    np.testing.assert_allclose((np.array(dragged["spin"]) - middle) / (1.4 * dragged["radius"]), spin[:2], atol=1e-4)
    canvas.focus()
    page.keyboard.press("ArrowLeft")
    assert report.drawn("#orbit")["view"]["yaw"] == pytest.approx(dragged["view"]["yaw"] + 0.1)
    assert report.at() == 9
    page.click("#orbit-reset")
    assert report.drawn("#orbit") == first
    page.click("#orbit-camera")
    assert report.drawn("#orbit")["view"] == {"yaw": 0, "pitch": 0}


@pytest.mark.parametrize("name", ["si", "px", "gone"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_on_a_narrow_screen_the_page_needs_no_horizontal_scrolling(open_result: Any, name: str, scheme: str) -> None:
    report = open_result(name, width=360, height=740, scheme=scheme)
    for frame in (0, 3, 11):
        report.page.evaluate(f"torchsphere.seek({frame})")
        assert report.page.evaluate("document.scrollingElement.scrollWidth <= innerWidth")


def test_without_a_scale_steps_are_shown_in_px_as_in_the_table(open_result: Any) -> None:
    report = open_result("px")
    report.page.keyboard.press("End")
    row = report.table("track.csv")[11]
    assert abs(report.text("velocity dx") - float(row["dx_px"])) <= 0.051 * float(row["sd_dx_px"])
    turn, sd = (np.degrees(float(row[name])) for name in ("wy_rad", "sd_wy_rad"))
    assert abs(report.text("spin y") - turn) <= 0.051 * sd
    assert "the frame rate is not known" in report.page.text_content(".problems")
    assert report.page.text_content("#now") == "Frame 11: ok"


def test_the_report_of_a_lost_ball_has_words_and_no_number(open_result: Any) -> None:
    report = open_result("gone")
    assert "5 of 12 frames were measured in full, 7 were not." in report.page.text_content("#verdict")
    assert "What to do" in report.page.text_content(".problems")
    report.page.keyboard.press("End")
    assert "NaN" not in report.page.inner_text("body")
    assert "null" not in report.page.inner_text("main")
    drawn = report.drawn("#frame")
    assert drawn["circle"] is None
    assert drawn["axes"] is None
    assert report.drawn("#orbit")["axes"] is None
    assert "not measured" in report.page.text_content("#values")
    status = report.table("track.csv")[11]["status"].replace("_", " ")
    assert report.page.text_content("#now").endswith(f": {status}")
    assert status in report.page.text_content("#legend")


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
