"""The page in a browser: drawn on, measured from, by mouse and by keys."""

import json
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from torchsphere.pick.server import PickServer
from torchsphere.pick.session import Places, Session
from torchsphere.recording import open_recording
from torchsphere.request import SETTINGS
from torchsphere.results.reader import read
from torchsphere.settings.configuration import read_config
from torchsphere.synthetic import demo_shot as demo

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed (extra 'dev')")

POLL_S = 0.02


@dataclass
class Opened:
    """A page, its session, its requests and its messages on the console."""

    page: Any
    session: Session
    address: str
    requests: list[str] = field(default_factory=list)
    console_messages: list[str] = field(default_factory=list)

    def state(self, expression: str) -> Any:
        return self.page.evaluate(f"torchsphere.{expression}")

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Where the window shows a place of the recording."""
        box = self.page.locator("#stage").bounding_box()
        view = self.state("view")
        return box["x"] + (x - view["left"]) * view["scale"], box["y"] + (y - view["top"]) * view["scale"]

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        mouse = self.page.mouse
        mouse.move(*self.place(*start))
        mouse.down()
        mouse.move(*self.place(*end), steps=4)
        mouse.up()

    def checked(self, line: str) -> None:
        """Wait until the file of settings has this line."""
        sync_api.expect(self.page.locator("#toml")).to_contain_text(line, timeout=30_000)


@pytest.fixture
def open_page(browser: Any, short: Path, tmp_path: Path) -> Iterator[Any]:
    """Give a function that serves the recording of eight frames and opens its page, once the ball is found."""
    opened = []

    def opener(base: dict[str, Any] | None = None, **context: Any) -> Opened:
        recording = open_recording(short)
        places = Places(short, tmp_path / "result", tmp_path / "shot.toml")
        session = Session(recording, places, {"map": "off", **(base or {})})
        server = PickServer(session)
        thread = threading.Thread(target=server.serve_forever, args=(POLL_S,))
        thread.start()
        page = browser.new_page(**{"viewport": {"width": 1280, "height": 900}, **context})
        found = Opened(page, session, server.address)
        opened.append((found, recording, server, thread))
        page.on("request", lambda request: found.requests.append(request.url))
        page.on("console", lambda message: found.console_messages.append(message.text))
        page.on("pageerror", lambda error: found.console_messages.append(str(error)))
        page.goto(server.address)
        page.wait_for_selector("body[data-circle]:not([data-circle=none])")
        return found

    yield opener
    for found, recording, server, thread in opened:
        found.page.close()
        server.shutdown()
        thread.join()
        server.server_close()
        found.session.close()
        recording.close()
        assert found.console_messages == []
        assert [url for url in found.requests if not url.startswith((found.address, "data:"))] == []


def test_a_recording_is_prepared_measured_and_reported_on_the_page(open_page: Any, demo_shot: demo.Shot) -> None:
    opened = open_page()
    page = opened.page
    assert page.get_attribute("body", "data-circle") == "found"
    # A circle drawn from middle to rim, then fitted to the edge.
    x, y = demo_shot.position[0]
    page.check("#show-pick")
    opened.drag((200, 60), (220, 60))
    drawn = opened.state("state.circle")
    assert drawn["origin"] == "drawn"
    # A px of the screen is half a px of the recording, or less.
    assert [drawn["x"], drawn["y"], drawn["radius"]] == pytest.approx([200, 60, 20], abs=0.6)
    opened.drag((x + 1, y + 1), (x + 1, y + 42))
    assert opened.state("state.circle.radius") == pytest.approx(41, abs=0.6)
    page.keyboard.press("f")
    page.wait_for_selector("body[data-circle=fitted]")
    fitted = opened.state("state.circle")
    # Three standard deviations of the limb of one frame.
    assert [fitted["x"], fitted["y"], fitted["radius"]] == pytest.approx([x, y, demo.RADIUS_PX], abs=0.4)
    sync_api.expect(page.locator("#edge-note")).to_contain_text("pink line")
    # A region around a corner of the target.
    page.check("input[name=tool][value=ignore]", force=True)
    for corner in ((330, 20), (370, 20), (370, 60), (330, 20)):
        page.mouse.click(*opened.place(*corner))
    assert page.locator("#regions li").count() == 1
    page.fill("[name=fps]", "36000")
    page.fill("[name=diameter_mm]", "30")
    page.fill("[name=mass_g]", "110")
    page.fill("#last", "6")
    page.press("#last", "Enter")
    opened.checked('frames = "0:7"')
    page.click("#save")
    sync_api.expect(page.locator("#said")).to_contain_text("The settings were written to")
    settings = read_config(opened.session.places.config, SETTINGS)
    assert settings["fps"] == 36000
    assert settings["diameter_mm"] == 30
    assert settings["mass_g"] == 110
    assert settings["frames"] == (0, 7)
    assert settings["map"] == "off"
    assert settings["circle"] == pytest.approx((x, y, demo.RADIUS_PX), abs=0.4)
    corners = [float(v) for v in settings["ignore"][0].replace(",", " ").split()]
    assert corners == pytest.approx([330, 20, 370, 20, 370, 60], abs=0.6)
    # The measurement, and its report.
    page.click("#track")
    page.wait_for_selector("body[data-job=done]", timeout=120_000)
    assert page.text_content("#verdict") == "All 7 frames were measured."
    assert opened.state("data.status") == [0] * 7
    # The last plot names the abscissa; all show the values under the pointer, and go to its frame.
    turned, last = (page.locator(name).bounding_box()["height"] for name in ("#plot-turned", "#plot-zncc"))
    assert last == turned + 18
    drawn_at = opened.state("drawn.plots.position")
    fourth = drawn_at["left"] + (4 - drawn_at["from"]) / (drawn_at["to"] - drawn_at["from"]) * drawn_at["width"]
    page.locator("#plot-position").hover(position={"x": fourth, "y": 60})
    sync_api.expect(page.locator("#tip")).to_contain_text("Frame 4")
    page.locator("#plot-position").click(position={"x": fourth, "y": 60})
    assert opened.state("state.frame") == 4
    page.keyboard.press("End")
    page.evaluate("torchsphere.seek(6)")
    seen = json.loads(page.get_attribute("#stage", "data-drawn"))
    centre = [seen["measured"][0] / seen["scale"] + seen["left"], seen["measured"][1] / seen["scale"] + seen["top"]]
    # Steps of 0.005 px add up over six frames; the circle was fitted to 0.1 px.
    assert centre == pytest.approx(demo_shot.position[6].tolist(), abs=0.5)
    assert set(seen["axes"]) == {"x", "y", "z"}
    with page.context.expect_page() as popup:
        page.click("#report")
    report = popup.value
    report.wait_for_selector("#frame")
    assert report.url == f"{opened.address}result/report.html"
    assert report.text_content("#verdict") == "All 7 frames were measured."
    report.close()
    assert read(opened.session.places.out).frame.tolist() == [0, 1, 2, 3, 4, 5, 6]


def test_everything_is_done_by_keys(open_page: Any) -> None:
    opened = open_page()
    page = opened.page
    page.locator("#stage").focus()
    for key, frame in (("End", 7), ("ArrowLeft", 6), ("Home", 0), ("ArrowRight", 1), ("PageDown", 7), ("PageUp", 0)):
        page.keyboard.press(key)
        assert opened.state("state.frame") == frame
    page.keyboard.press("ArrowRight")
    page.keyboard.press("+")
    scale = opened.state("view.scale")
    assert scale > 1
    before = opened.state("state.circle")
    page.keyboard.press("Shift+ArrowRight")
    page.keyboard.press("Shift+ArrowUp")
    page.keyboard.press(".")
    after = opened.state("state.circle")
    assert [after[k] - before[k] for k in ("x", "y", "radius")] == pytest.approx([1 / scale, -1 / scale, 1 / scale])
    # A circle drawn in a later frame makes that the first one.
    assert (after["frame"], opened.state("state.first")) == (1, 1)
    page.keyboard.press("ArrowRight")
    page.keyboard.press("]")
    assert opened.state("state.last") == 2
    page.keyboard.press("i")
    for way in ("Shift+ArrowRight", "Shift+ArrowDown", "Shift+ArrowLeft"):
        page.keyboard.press("Enter")
        for _ in range(8):
            page.keyboard.press(way)
    page.keyboard.press("Shift+Enter")
    assert page.locator("#regions input").input_value().count(",") == 3
    opened.checked("ignore = [")
    assert 'frames = "1:3"' in page.text_content("#toml")
    page.locator("#play").focus()
    page.keyboard.press("ArrowRight")
    assert opened.state("state.frame") == 3
    # Each control can be reached, and shows that it is.
    page.evaluate("document.activeElement.blur()")
    reached = set()
    for _ in range(80):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id || document.activeElement.name || ''"))
        outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
        assert outline != "none" or page.evaluate(
            "document.activeElement === document.body || document.activeElement.name === 'tool'"
        )
    wanted = "tool zoom-in stage play slider first begin last end show-axes circle-x find fit clear add-region"
    wanted += " fps diameter_mm mass_g track save replace"
    assert {name.removeprefix("field-") for name in reached} >= set(wanted.split())


def test_the_note_below_the_frame_says_what_a_drag_does_where_a_circle_is(open_page: Any) -> None:
    opened = open_page({"circle": (64.3, 92.6, 40.0)})
    note = opened.page.locator("#tool-note")
    sync_api.expect(note).to_contain_text("inside to move it, by its rim to resize it")
    sync_api.expect(note).to_contain_text("elsewhere")
    opened.drag((66, 93), (76, 93))
    circle = opened.state("state.circle")
    assert [circle["x"], circle["y"], circle["radius"]] == pytest.approx([74.3, 92.6, 40.0], abs=0.6)


def test_what_cannot_be_measured_is_said_beside_the_button_and_at_the_field(open_page: Any) -> None:
    opened = open_page({"circle": (64.3, 92.6, 40.0)})
    page = opened.page
    page.fill("[name=mass_g]", "-5")
    sync_api.expect(page.locator("#refusal")).to_have_text("Mass of the ball = -5: expected a finite, positive number")
    assert page.get_attribute("[name=mass_g]", "aria-invalid") == "true"
    assert page.is_disabled("#track")
    page.fill("[name=mass_g]", "")
    sync_api.expect(page.locator("#refusal")).to_have_text("")
    assert page.is_enabled("#track")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_on_a_narrow_screen_the_page_needs_no_horizontal_scrolling(open_page: Any, scheme: str) -> None:
    opened = open_page(
        {"fps": 36000.0, "circle": (64.3, 92.6, 40.0)}, viewport={"width": 360, "height": 740}, color_scheme=scheme
    )
    page = opened.page
    assert page.get_attribute("body", "data-circle") == "drawn"
    for details in page.locator("details").all():
        details.locator("summary").click()
    assert page.evaluate("document.scrollingElement.scrollWidth <= innerWidth")
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert ground == ("rgb(255, 255, 255)" if scheme == "light" else "rgb(20, 23, 27)")


def test_a_page_whose_command_has_ended_says_so(open_page: Any) -> None:
    opened = open_page({"circle": (64.3, 92.6, 40.0)})
    page = opened.page
    page.route("**/save", lambda route: route.abort())
    page.click("#save")
    sync_api.expect(page.locator("#said")).to_contain_text("The command that serves this page has ended")
    # The browser reports the request itself.
    assert all("ERR_FAILED" in message for message in opened.console_messages)
    opened.console_messages.clear()
