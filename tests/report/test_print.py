"""Pages on paper: what cannot be pressed is left out, tables stand apart and fit, colours are light."""

from pathlib import Path
from typing import Any

import pytest

from torchsphere.report import pages
from torchsphere.report.comparison import write_comparison

#: Width of A4 without its margins, px.
PAPER_PX = 718


@pytest.fixture
def on_paper(browser: Any) -> Any:
    """Open a page as a printer does."""
    opened = []

    def show(path: Path, scheme: str = "light") -> Any:
        page = browser.new_page(viewport={"width": 1280, "height": 900}, color_scheme=scheme)
        opened.append(page)
        page.goto(path.as_uri())
        page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
        page.set_viewport_size({"width": PAPER_PX, "height": 1000})
        page.emulate_media(media="print", color_scheme=scheme)
        return page

    yield show
    for page in opened:
        page.close()


def pressable(page: Any) -> list[str]:
    """Names of what a reader of the screen presses, as far as it is visible."""
    return page.evaluate(
        # The headings of the index are buttons, and stay.
        "[...document.querySelectorAll('button, input, select, .keys')].filter((e) => !e.closest('thead'))"
        ".filter((e) => e.getClientRects().length).map((e) => e.id || e.className || e.textContent)"
    )


def test_a_printed_report_has_no_controls_and_fits_the_paper(on_paper: Any, results: Path) -> None:
    page = on_paper(results / "si" / "report.html")
    assert pressable(page) == []
    assert page.is_visible("#plot-velocity")
    # All settings are part of a printed record.
    assert page.is_visible(".settings th >> nth=0")
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    for name in ("#frame", "#plot-velocity", "#strip", "#orbit"):
        box = page.locator(name).bounding_box()
        assert box["x"] + box["width"] <= PAPER_PX
        ratio = page.evaluate(f"(() => {{ const c = document.querySelector('{name}'); return c.height / c.width; }})()")
        assert box["height"] / box["width"] == pytest.approx(ratio, rel=0.02)


def test_a_printed_page_is_light_and_the_screen_comes_back_as_it_was(on_paper: Any, results: Path) -> None:
    page = on_paper(results / "si" / "report.html", scheme="dark")
    ground = "getComputedStyle(document.body).backgroundColor"
    assert page.evaluate(ground) == "rgb(255, 255, 255)"
    assert page.evaluate("colour('ink')") == "#1b1f24"
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    page.emulate_media(media="screen", color_scheme="dark")
    assert page.evaluate(ground) != "rgb(255, 255, 255)"
    assert page.is_hidden(".settings th >> nth=0")
    assert page.is_visible("#play")


def test_a_printed_comparison_and_index_have_no_controls_and_fit_the_paper(
    on_paper: Any, results: Path, tmp_path: Path
) -> None:
    write_comparison([results / "si", results / "lab"], tmp_path / "page.html")
    rows = [{"recording": f"shot {i}.tif", "state": "done", "frames": i} for i in range(3)]
    for path in (tmp_path / "page.html", pages.write_index(tmp_path, rows)):
        page = on_paper(path)
        assert pressable(page) == []
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert page.is_visible("thead button:has-text('recording')")


@pytest.mark.parametrize("width", [360, 1280])
def test_the_columns_of_energies_budget_and_ledger_stand_apart(
    browser: Any, measured: tuple[Path, object], width: int
) -> None:
    page = browser.new_page(viewport={"width": width, "height": 900})
    page.goto((measured[0] / "report.html").as_uri())
    tables = page.locator("table.columns")
    assert tables.count() == 3
    gaps = tables.evaluate_all(
        """tables => tables.flatMap((table) => [...table.rows].flatMap((row) => {
          const boxes = [...row.cells].map((cell) => {
            const text = document.createRange();
            text.selectNodeContents(cell);
            return text.getBoundingClientRect();
          }).filter((box) => box.width);
          return boxes.slice(1).map((box, i) => box.left - boxes[i].right);
        }))"""
    )
    assert min(gaps) > 12
    page.close()
