"""The report in a browser, opened from its file: frames by keys, slider and clicks, and the ball in space."""

import io
from typing import Any

import numpy as np
import pytest
from PIL import Image
from report_pages import FIRST
from scipy.spatial.transform import Rotation

from torchsphere.synthetic.demo_shot import RADIUS_PX, Shot

#: Length of the drawn axes, radii.
AXIS_LENGTH = 1.3


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


def test_circle_and_axes_are_drawn_at_the_true_position_and_orientation(open_result: Any, demo_shot: Shot) -> None:
    report = open_result("si")
    left, top = report.page.evaluate("torchsphere.data.images.box.slice(0, 2)")
    for frame in (0, 6, 11):
        report.page.evaluate(f"torchsphere.seek({frame})")
        drawn = report.drawn("#frame")
        x, y, radius = np.array(drawn["circle"]) / drawn["scale"]
        # Steps of 0.005 px add up over eleven frames.
        np.testing.assert_allclose((x + left, y + top), demo_shot.position[FIRST + frame], atol=0.05)
        assert radius == pytest.approx(RADIUS_PX, abs=1e-6)
        turned = demo_shot.orientation[FIRST + frame] @ demo_shot.orientation[FIRST].T
        for k, name in enumerate("xyz"):
            tip = (np.array(drawn["axes"][name]) / drawn["scale"] - (x, y)) / (AXIS_LENGTH * radius)
            # 0.2 deg: the largest error of eleven steps of 0.02 deg.
            np.testing.assert_allclose(tip, turned[:2, k], atol=np.radians(0.2))
            if abs(turned[2, k]) > 0.01:
                assert drawn["front"][name] == (turned[2, k] < 0)
    assert abs(turned[0, 1]) > 0.03  # there is a rotation to see


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
